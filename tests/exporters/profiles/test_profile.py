"""Controller profiles: what has no default is asked, wrong names meet the nearest right one, active
tables are proven by their hash."""

import re
import tomllib

import msgspec
import numpy as np
import pytest

from stepdiag.base.errors import SafetyError, UsageError
from stepdiag.exporters.profiles.file import load_profile, parse_profile, quick_profile
from stepdiag.exporters.profiles.registry import CONTROLLERS, controller_named
from stepdiag.exporters.profiles.template import profile_template
from testkit.exact.machines import MACHINES, profile_of, profile_text
from testkit.exact.results import VOLUME

SIEMENS = controller_named("siemens")


def siemens_text(**replaced: str) -> str:
    text = profile_text(
        "siemens",
        steps_mm=(100.0, 100.0, 50.0),
        references_mm=(0.0, 0.0, 0.0),
        direction="mean",
    )
    for old, new in replaced.items():
        text = re.sub(rf"^{old} = .*$", f"{old} = {new}", text, count=1, flags=re.MULTILINE)
    return text


@pytest.mark.parametrize("name", sorted(CONTROLLERS))
class TestTemplates:
    def test_an_unanswered_template_lists_its_questions(self, name):
        """Nothing is guessed: the refusal says all that is still to be answered."""
        with pytest.raises(
            UsageError,
            match=r"machine\.name.*machine\.measured_with.*axes\.X\.name.*axes\.Z\.reference_mm",
        ):
            parse_profile(
                profile_template(controller_named(name)),
                "p.toml",
                controller_named(name),
                VOLUME,
            )

    def test_every_commented_line_of_the_common_part_is_a_known_field(self, name):
        """Whoever takes the # away gets a valid profile."""
        text = profile_template(controller_named(name)).partition(f"[{name}]")[0]
        text = re.sub(r"^# (?=\[\[|\w+ = )", "", text, flags=re.MULTILINE)
        for question, answer in (
            ('name = "?"', 'name = "AX"'),
            ('measured_with = "?"', 'measured_with = "off"'),
            ('"?"', "1.0"),
        ):
            text = text.replace(question, answer)
        text = re.sub(r"(\[axes\.(\w)\]\nname = )\"AX\"", r'\1"AX\2"', text)
        machine = MACHINES[name]
        profile = parse_profile(
            text + "\n" + machine.section,
            "p.toml",
            controller_named(name),
            VOLUME,
            machine.files,
        )
        assert profile.axis("Y").name == "AXY"

    def test_every_commented_option_is_a_known_field(self, name):
        controller = controller_named(name)
        lines = [line.removeprefix("# ") for line in controller.options_template.splitlines()]
        section = tomllib.loads(
            "\n".join(line for line in lines if re.match(r"\[|\w+ = ", line))
        )[name]
        assert set(section) <= {
            field.encode_name for field in msgspec.structs.fields(controller.options)
        }


class TestMessages:
    @pytest.mark.parametrize(
        ("field", "value", "found"),
        [
            (
                "measured_with",
                '"maybe"',
                r"p\.toml: machine\.measured_with: expected .*off.*found \"maybe\"",
            ),
            (
                "step_mm",
                '"wide"',
                r"p\.toml: axes\.X\.step_mm: expected a number.*found \"wide\"",
            ),
            ("step_mm", "0.0", r"p\.toml: axes\.X\.step_mm"),
            ("step_mm", "nan", r"p\.toml: axes\.X\.step_mm"),
            ("reference_mm", "inf", r"p\.toml: axes\.X\.reference_mm"),
            (
                "controller",
                '"fanuc"',
                r"p\.toml: machine\.controller: expected siemens, found fanuc",
            ),
            ("measuring_system", "3", r"p\.toml: siemens\.measuring_system"),
        ],
    )
    def test_a_wrong_value_is_named_with_its_field(self, field, value, found):
        with pytest.raises(UsageError, match=found):
            parse_profile(siemens_text(**{field: value}), "p.toml", SIEMENS, VOLUME)

    def test_a_sign_test_of_no_table_of_this_control_is_refused(self):
        """A record that no table takes as evidence would leave the files _UNTESTED_SIGN without a
        word."""
        record = '[[sign_test]]\nkind = "siemens"\ndate = 2026-01-31\nverdict = "as-error"\n'
        expected = (
            r"p\.toml: sign_test\[0\]\.kind: expected eec or cec or cec-product, "
            r".*siemens.*stepdiag signtest"
        )
        with pytest.raises(UsageError, match=expected):
            parse_profile(siemens_text() + record, "p.toml", SIEMENS, VOLUME)

    @pytest.mark.parametrize(
        ("old", "new", "found"),
        [
            (
                "measuring_system",
                "mesuring_system",
                r"siemens\.mesuring_system.*did you mean measuring_system",
            ),
            (
                "reference_mm",
                "referenz_mm",
                r"axes\.X\.referenz_mm.*did you mean reference_mm",
            ),
            ("[siemens]", "[simens]", r"simens.*did you mean siemens"),
            (
                "measured_with",
                "measured_wiht",
                r"machine\.measured_wiht.*did you mean measured_with",
            ),
        ],
    )
    def test_an_unknown_key_meets_the_nearest_known_one(self, old, new, found):
        with pytest.raises(UsageError, match=found):
            parse_profile(siemens_text().replace(old, new, 1), "p.toml", SIEMENS, VOLUME)

    def test_a_missing_answer_is_asked_for(self):
        text = re.sub(r"^measuring_system = .*$", "", siemens_text(), flags=re.MULTILINE)
        with pytest.raises(
            UsageError,
            match=r"siemens\.measuring_system: expected a whole number from 1 to 2, found nothing",
        ):
            parse_profile(text, "p.toml", SIEMENS, VOLUME)

    def test_no_toml_is_refused_with_its_place(self):
        with pytest.raises(UsageError, match=r"p\.toml.*line 2"):
            parse_profile("[machine]\nname = \n", "p.toml", SIEMENS, VOLUME)

    def test_an_absent_profile_is_a_refusal(self, tmp_path):
        with pytest.raises(UsageError, match="readable profile"):
            load_profile(tmp_path / "none.toml", SIEMENS, VOLUME)

    def test_an_absent_table_file_is_a_refusal(self, tmp_path):
        path = tmp_path / "p.toml"
        path.write_text(siemens_text(existing='["AX_EEC.INI"]'), encoding="utf-8")
        with pytest.raises(UsageError, match=r"machine\.existing.*AX_EEC\.INI"):
            load_profile(path, SIEMENS, VOLUME)


class TestGrid:
    def test_runs_over_the_measured_volume_by_default(self):
        assert profile_of("siemens", VOLUME).grid_mm("Z").tolist() == [
            -100.0,
            -50.0,
            0.0,
            50.0,
            100.0,
        ]

    def test_a_step_that_does_not_fit_is_refused_with_one_that_does(self):
        """controllers.md 3.2: the grid must be integral; 400 mm in steps of 60 is not."""
        profile = quick_profile(SIEMENS, VOLUME, 60.0)
        with pytest.raises(SafetyError, match=r"57\.14") as refusal:
            profile.grid_mm("X")
        assert refusal.value.code == "grid-unfit.step"

    def test_a_decimal_step_fits_in_spite_of_binary_fractions(self):
        """400 mm in steps of 0.1 mm are 4000 sections, although 0.1 is no binary number."""
        grid = quick_profile(SIEMENS, VOLUME, 0.1).grid_mm("X")
        assert len(grid) == 4001
        assert np.isclose(grid[-1], 200.0)


class TestActiveTables:
    """controllers.md 9, rules 5 and 6: the tables that were active while measuring, or no merge."""

    def test_measured_with_a_table_that_is_not_given_is_refused(self):
        with pytest.raises(SafetyError) as refusal:
            parse_profile(siemens_text(measured_with='"on"'), "p.toml", SIEMENS, VOLUME)
        assert refusal.value.code == "active-table-unfit.unknown"
