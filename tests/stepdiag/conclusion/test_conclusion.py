"""One conclusion, and the same figures wherever it is read."""

import json
import re
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import message
from stepdiag.base.result.interval import Interval
from stepdiag.base.result.members import Budget
from stepdiag.base.result.result import Quantity, Result, parse_result
from stepdiag.conclusion import (
    Export,
    conclude,
    conclusion_document,
    conclusion_in,
    conclusion_json,
    contributions_of,
    export_of,
    loadable,
    render,
    words_of,
)
from stepdiag.conclusion.intervals import Reach, reach_in, reach_of
from stepdiag.exporters.export.export import export
from stepdiag.report.document import build_report
from stepdiag.report.exported import exported_in, exported_of
from stepdiag.solver.methods.solve import solve
from stepdiag.texts import LANGUAGES
from testkit.cli import stepdiag
from testkit.exact.madeup import made_up_result
from testkit.exact.members import members
from testkit.exact.results import VOLUME, made_result
from testkit.exact.surveys import DIAGONALS, LINEAR, Bench
from testkit.examples import spread
from testkit.german import is_english


def predicted(
    rms: tuple[float, float, float], largest: tuple[float, float, float]
) -> dict[str, Any]:
    """Return a ``predicted`` of contract 4 whose after-values are these (value, low, high)."""

    def figure(value: float, low: float, high: float) -> dict[str, float]:
        return {"value": value, "low": low, "high": high}

    both = {
        "before": {"rms_um": figure(10.0, 9.0, 11.0), "largest_um": figure(24.0, 21.0, 27.0)},
        "after": {"rms_um": figure(*rms), "largest_um": figure(*largest)},
    }
    return {"without_rigid_motion": both, "as_it_is": both}


def reach_of_json(document: dict[str, Any]) -> Reach:
    """Return the reach of a ``predicted`` of contract 4."""
    return reach_of(members(predicted=document)["predicted"])


class TestTheLargestShare:
    @pytest.mark.parametrize(
        ("source", "words"),
        [
            ("between the targets", "Drive 20 increments"),
            ("readings", "Drive each setup once more"),
            ("not measured", "Add the missing runs"),
            ("angles", "Measure the angles with a 4-DOF head"),
            ("drift", "Drive each setup out and back once more"),
            ("growth", "Warm the machine up"),
            ("air", "of the material and the air"),
        ],
    )
    def test_is_named_with_what_makes_it_smaller(self, source: str, words: str) -> None:
        """3 um of 5 in all, by squares 9 of 25: 36 %; what has no knob is in the whole alone."""
        shares = {"readings": 0.0, "wander": 0.0, "sizes of these": 4.0, source: 3.0}
        result = replace(
            made_result(),
            budget=Budget(
                assumptions={}, shares={"volume": shares}, combined={"volume": 5.0}
            ),
        )
        increments = result.volume.increments
        said = [
            render(one, "en")
            for one in conclude(result).reached
            if one.key == "reach_largest"
        ]
        assert len(said) == 1
        assert "36 %" in said[0]
        assert words.replace("20", f"{2 * increments}") in said[0]

    def test_is_not_named_without_a_budget_of_the_volume(self) -> None:
        for budget in (
            None,
            Budget(assumptions={}, shares={"EXX": {"readings": 1.0}}, combined={"EXX": 1.0}),
        ):
            assert not [
                one
                for one in conclude(replace(made_result(), budget=budget)).reached
                if one.key == "reach_largest"
            ]


class TestWhatIsWrong:
    def test_is_ranked_by_what_it_moves_the_tool(self) -> None:
        """25 urad over 400 mm are 10 µm; they come before 12 µm/m over 500 mm (6 µm) and after a
        shape of 16 um."""
        result = replace(
            made_up_result(amplitude_um=8.0, scales=True), squareness=leaning(25.0)
        )
        ranked = contributions_of(result)
        assert [one.effect_um for one in ranked] == sorted(
            (one.effect_um for one in ranked), reverse=True
        )
        c0y = next(one for one in ranked if one.name == "C0Y")
        assert c0y.effect_um == pytest.approx(25.0 * 400.0 * 1e-3)
        assert next(
            one for one in ranked if one.name == "scale X"
        ).effect_um == pytest.approx(12.0 * 500.0 * 1e-3)

    @pytest.mark.parametrize(("value", "towards"), [(25.0, "−X"), (-25.0, "+X")])
    def test_says_which_way_an_axis_leans(self, value: float, towards: str) -> None:
        """dX = -C0Y y (contract 1): a positive C0Y takes the tool to -X as Y grows."""
        result = replace(
            made_up_result(amplitude_um=0.0, u_um=0.01, reversal=False),
            squareness=leaning(value),
        )
        (_, sentence), *_ = conclude(result).wrong
        assert f"C0Y, towards {towards}" in render(sentence, "en")
        assert "Y steht um 25,00 µrad schief zu X" in render(sentence, "de")

    def test_what_lies_within_its_uncertainty_is_not_wrong(self) -> None:
        """3 urad with u = 2 urad say nothing of the machine."""
        doubtful = {name: Quantity(value=3.0, u=2.0) for name in ("C0Y", "B0Z", "A0Z")}
        result = replace(
            made_up_result(amplitude_um=0.0, u_um=0.5, reversal=False), squareness=doubtful
        )
        assert conclude(result).wrong == ()


def leaning(c0y_urad: float) -> dict[str, Quantity]:
    """Return squarenesses of which only Y to X is not zero."""
    return {
        "C0Y": Quantity(value=c0y_urad, u=0.2),
        "B0Z": Quantity(value=0.0, u=0.2),
        "A0Z": Quantity(value=0.0, u=0.2),
    }


class TestReach:
    def test_is_an_interval_and_rounding_never_narrows_it(self) -> None:
        """1.31 .. 2.64 is written 1.3 to 2.7."""
        exports = [
            Export(
                controller="siemens",
                reach=reach_of_json(predicted((1.9, 1.31, 2.64), (4.0, 3.0, 6.01))),
            )
        ]
        words = words_of(conclusion_document(conclude(made_up_result(), exports)), "en")
        assert (
            words["reached"][1]
            == "After compensation, predicted: 1.3 to 2.7 µm (rms, k = 2), largest vector up to "
            "6.1 µm."
        )

    def test_a_result_of_version_1_promises_nothing(self) -> None:
        """Without a stated interval the figure is a bound from below, and says so."""
        document = predicted((0.1, 0.1, 0.1), (0.2, 0.2, 0.2))
        for when in ("before", "after"):
            for figure in document["without_rigid_motion"][when].values():
                figure["low"] = figure["high"] = None
        words = words_of(
            conclusion_document(
                conclude(
                    made_up_result(),
                    [Export(controller="fanuc", reach=reach_of_json(document))],
                )
            ),
            "en",
        )
        assert "at best 0.1 µm" in words["reached"][1]
        assert "Only a new survey shows the result" in words["reached"][1]

    @given(st.floats(0.0, 500.0), st.floats(0.0, 500.0))
    def test_the_written_interval_holds_the_computed_one(
        self, low: float, width: float
    ) -> None:
        """Whatever the figures, what is read contains what was computed."""
        shown = Interval(value_um=low, low_um=low, high_um=low + width).shown()
        assert float(shown[0]) <= low + 1e-6
        assert float(shown[1]) >= low + width - 1e-6

    @given(
        st.recursive(
            st.none() | st.floats() | st.text(),
            lambda inner: st.dictionaries(
                st.sampled_from(
                    [
                        "without_rigid_motion",
                        "as_it_is",
                        "before",
                        "after",
                        "rms_um",
                        "largest_um",
                        "value",
                        "low",
                        "high",
                    ]
                ),
                inner,
            ),
        )
    )
    def test_a_strange_prediction_is_none_rather_than_an_error(
        self, document: object
    ) -> None:
        """A result of a stranger may hold anything under ``predicted``."""
        assert reach_in(made_up_result(predicted=document)).rms_before.value_um >= 0.0

    def test_says_where_files_harm_in_the_words_of_the_export(self, tmp_path: Path) -> None:
        """The warning of `verify` and export stands beside what compensation reaches, in every
        language; without one nothing is added."""
        bump = np.where(np.arange(9) == 4, 9.0, 0.0)
        bumped = made_result({"EXX": bump.tolist()}, volume=replace(VOLUME, increments=8))
        written = export(bumped, "siemens", None, step_mm=100.0, out_dir=tmp_path)
        reached = conclude(bumped, [export_of(written)]).reached
        told = [one.text for one in written.findings if one.code == "stretch-worse"]
        assert [render(one, "en") for one in reached[2:]] == [
            f"The files for siemens do not reduce the error everywhere: {text}."
            for text in told
        ]
        assert len(told) == 2
        german = render(reached[2], "de")
        assert (
            "X -100 bis -50 mm: auf dieser Strecke wäre die Abweichung der Maschine" in german
        )
        assert not is_english(german)
        concluded = exported_in(bumped, [tmp_path], None).concluded
        assert concluded is not None
        assert list(map(str, concluded.harmed)) == told


class TestWhatToLoad:
    def test_nothing_before_its_sign_test(self) -> None:
        """The next step is the sign test, and the control is named."""
        found = conclude(
            made_up_result(scales=True),
            [Export(controller="siemens", untested=("EEC", "CEC"))],
        )
        assert [render(one, "en") for one in found.load] == [
            "siemens: load nothing before the sign test of EEC, CEC."
        ]
        assert render(found.next_step, "en").startswith("Make the sign test on siemens")

    def test_nothing_while_findings_are_errors(self) -> None:
        """What must be driven again comes before any export."""
        broken = replace(
            made_up_result(),
            findings=(
                Finding(code="contradiction-ambiguous", severity="error", text="ppp: 5 ppm"),
            ),
        )
        assert render(
            conclude(broken, [Export(controller="siemens")]).next_step, "en"
        ).startswith("Repeat each pass")

    def test_a_refused_export_says_so(self) -> None:
        """Nothing of it is loaded."""
        refusal = message(
            "refusal", where="p.toml: machine.name", expected="'A'", found="'B'"
        )
        why = message("refusal-with-code", refusal=refusal, code="other-machine")
        found = conclude(made_up_result(), [Export(controller="fanuc", refused=why)])
        assert str(why) in render(found.load[0], "en")
        assert "gefunden 'B' [other-machine]" in render(found.load[0], "de")
        assert not is_english(render(found.load[0], "de"))
        assert "refused" in render(found.load[0], "en")
        assert "fanuc" in render(found.next_step, "en")


class TestNextStep:
    """What is last said is what helps: no export, and no reason to be cleared, where a table lacks
    what was not measured."""

    @pytest.mark.parametrize("refused", [True, False])
    @pytest.mark.parametrize(
        ("setups", "runs"),
        [
            (("ppp", "npp"), "pnp, ppn, linear-y, linear-z"),
            (("linear-x", "linear-y", "linear-z"), "ppp, npp, pnp, ppn"),
            (("ppp", "npp", "pnp", "linear-x"), None),
        ],
    )
    def test_names_the_runs_that_make_everything_known(
        self, setups: tuple[str, ...], runs: str | None, *, refused: bool
    ) -> None:
        """Whoever drives them besides has all scales, squarenesses and functions."""
        bench = Bench(increments=3)
        exports = (
            [Export(controller="siemens", refused="squareness.C0Y: found null")]
            if refused
            else []
        )
        found = conclude(solve(bench.survey(setups)), exports)
        assert found.next_step.key == "next_runs"
        named = found.next_step.arguments["runs"].split(", ")
        assert runs is None or named == runs.split(", ")
        assert f"({', '.join(named)})" in render(found.next_step, "de")
        assert not set(named) & set(setups)
        whole = solve(bench.survey((*setups, *named)))
        assert conclude(whole).next_step.key == "next_export"
        promised = [render(one, "en") for one in found.reached]
        assert ("No file may be loaded" in promised[1]) == refused

    def test_one_run_where_one_scale_is_known(self) -> None:
        """The diagonals tell the sum of the scales: beside X one more run, along the shorter axis,
        tells both others."""
        bench = Bench(increments=3)
        found = conclude(solve(bench.survey((*DIAGONALS, "linear-x"))))
        assert found.next_step.arguments == {"runs": "linear-z"}
        assert (
            conclude(solve(bench.survey((*DIAGONALS, "linear-x", "linear-z")))).next_step.key
            == "next_export"
        )

    def test_another_reason_of_a_refusal_comes_first(self) -> None:
        """Without scales a table can be made: what refused it is something else."""
        found = conclude(
            made_up_result(), [Export(controller="fanuc", refused="p.toml: no such axis")]
        )
        assert found.next_step.key == "next_refused"

    def test_all_driven_and_yet_unknown_is_driven_again(self) -> None:
        """There is no further run to name."""
        lacking = {**leaning(5.0), "B0Z": Quantity(value=None, u=None)}
        result = replace(
            made_up_result(scales=True),
            squareness=lacking,
            setups={name: {} for name in DIAGONALS},
        )
        assert conclude(result).next_step.key == "next_unknown"


class TestOnePlace:
    def test_report_export_report_terminal_and_file_say_the_same_figures(
        self, tmp_path: Path
    ) -> None:
        """One survey, five places, one pair of digits."""
        result = made_up_result(scales=True)
        written = export(
            result,
            "siemens",
            None,
            step_mm=25.0,
            out_dir=tmp_path / "files",
            today=date(2026, 1, 1),
        )
        exported = exported_of(written)
        assert exported.concluded is not None
        concluded = conclude(result, [exported.concluded])
        (tmp_path / "conclusion.json").write_text(
            conclusion_json(concluded), encoding="utf-8"
        )
        words = words_of(conclusion_in(tmp_path) or {}, "en")
        after = re.search(r"at best ([\d.]+) µm", words["reached"][1])
        assert after is not None
        assert after[1] in build_report(result, source="r", exported=[exported]).html
        line = next(
            line
            for line in written.text.splitlines()
            if "without rigid motion, after" in line
        )
        assert f" {after[1]} or more" in line
        (tmp_path / "result.json").write_text(result.to_json(), encoding="utf-8")
        told = stepdiag("verify", tmp_path / "result.json", tmp_path / "files").out
        assert f"{after[1]} or more" in told

    def test_no_factor_anywhere(self, tmp_path: Path) -> None:
        """A factor with decimals is a promise that nothing covers."""
        result = made_up_result(scales=True)
        written = export(
            result,
            "siemens",
            None,
            step_mm=25.0,
            out_dir=tmp_path / "files",
            today=date(2026, 1, 1),
        )
        (tmp_path / "result.json").write_text(result.to_json(), encoding="utf-8")
        told = stepdiag("verify", tmp_path / "result.json", tmp_path / "files").out
        everything = (
            written.text
            + build_report(result, source="r", exported=[exported_of(written)]).html
            + told
        )
        assert not re.search(r"factor (of )?\d|\d x\b|improvement", everything)

    @pytest.mark.parametrize(
        "result",
        [made_up_result(), made_up_result(scales=True, angles=True)],
        ids=["four diagonals", "all"],
    )
    def test_every_sentence_reads_in_every_language(self, result: Result) -> None:
        """No placeholder is left, German writes its comma, English its point."""
        document = json.loads(
            conclusion_json(
                conclude(result, [Export(controller="siemens", untested=("EEC",))])
            )
        )
        for language in LANGUAGES:
            text = " ".join(
                sentence
                for section in words_of(document, language).values()
                for sentence in section
            )
            assert "{" not in text
            assert not re.search(r"\d\.\d" if language == "de" else r"\d,\d", text)


def test_another_file_of_that_name_is_no_conclusion(tmp_path: Path) -> None:
    """Cut off, of another format, or not there: none, and no error."""
    assert conclusion_in(tmp_path) is None
    for text in ("{", "[]", '{"format": "stepdiag-conclusion", "version": 99}'):
        (tmp_path / "conclusion.json").write_text(text, encoding="utf-8")
        assert conclusion_in(tmp_path) is None


class TestBasis:
    """What tables and U rest on is said where they are read, and only what the result says."""

    SCALES: ClassVar = {axis: {"value": 3.2, "u": 1.5, "unit": "um/m"} for axis in "XYZ"}
    LENGTHS: ClassVar = {
        "tables": "as_measured",
        "material_c": [23.4] * 3,
        "as_measured": SCALES,
        "at_20_c": SCALES,
    }

    def said(self, language="en", **extra):
        return words_of(
            conclusion_document(conclude(replace(made_up_result(), **members(**extra)))),
            language,
        )["basis"]

    def test_which_lengths_the_tables_correct(self) -> None:
        (text,) = self.said(lengths=self.LENGTHS)
        assert text.startswith(
            "Lengths are valid for 23.40 °C, as measured. The tables contain the scales for this "
            "temperature, X +3.2 ± 3.0"
        )
        (text,) = self.said(lengths={**self.LENGTHS, "tables": "at_20_c"})
        assert text.startswith("Lengths are converted from 23.40 °C to 20 °C")
        (text,) = self.said(lengths={**self.LENGTHS, "material_c": None})
        assert "the temperature of the machine was not measured for all stops" in text
        (text,) = self.said("de", lengths=self.LENGTHS)
        assert "für 23,40 °C" in text
        assert "X +3,2 ± 3,0" in text

    def test_what_u_takes_for_granted(self) -> None:
        (text,) = self.said(assumed=Assumptions(angles_urad=7.5, index=3e-7).stated())
        assert "angular errors 7.5 µrad (range)" in text
        assert "air and wavelength 0.3 ppm" in text
        (text,) = self.said(tool={"up_to_um_per_100_mm": 3.21})
        assert "A tool tip 100 mm away can have errors that differ by up to 3.2 µm" in text

    def test_the_file_says_the_same_as_the_result(self) -> None:
        """The index is some 1e-7: of the six decimals that a file keeps it left 0 ppm."""
        result = solve(Bench(increments=3).survey())
        said, of_file = (
            conclude(each).basis for each in (result, parse_result(result.to_json()))
        )
        assert said == of_file
        assert any("0.2" in sentence.arguments.get("index_ppm", "") for sentence in of_file)

    def test_air_that_was_assumed_is_said_as_such(self) -> None:
        conditions = {
            "air_temperature_c": [20.1, 20.4],
            "assumed": {"air_pressure_hpa": 1013.25},
        }
        (text,) = self.said(conditions=conditions)
        assert "the survey file assumes p = 1013.25 hPa" in text
        (text,) = self.said("de", conditions=conditions)
        assert "nimmt die Vermessungsdatei p = 1013,25 hPa an" in text
        (text,) = self.said(lengths={**self.LENGTHS, "tables": "at_20_c", "material_c": None})
        assert "U contains its uncertainty" in text

    def test_an_older_or_foreign_result_says_nothing(self) -> None:
        assert self.said() == []
        for foreign in (
            {"lengths": 3, "assumed": [], "tool": None},
            {"conditions": {"assumed": 3}},
            {"lengths": {"tables": ["x"], "material_c": "warm"}, "assumed": {"a": {}}},
        ):
            assert self.said(**foreign) == []


class TestWhatWasNotMeasured:
    """An interval that is wide for what nobody measured says so: it is no spread of the
    readings."""

    SAID = "The interval of the prediction is therefore wide"

    @pytest.mark.parametrize(
        ("setups", "said"),
        [(LINEAR, True), (DIAGONALS, True), ((*DIAGONALS, *LINEAR), False)],
    )
    def test_makes_the_interval_wide_and_that_is_said(
        self, setups: tuple[str, ...], said: bool
    ) -> None:
        unknown = [
            render(each, "en")
            for each in conclude(solve(Bench(increments=4).survey(setups))).unknown
        ]
        assert any(self.SAID in one for one in unknown) is said

    def test_is_said_of_no_interval_that_is_not_there(self) -> None:
        result = replace(solve(Bench(increments=4).survey(LINEAR)), posterior=None)
        assert not any(self.SAID in render(each, "en") for each in conclude(result).unknown)


class TestUnseenSlip:
    SLIP: ClassVar[dict[str, Any]] = {
        "setup": "npp",
        "pass": 1,
        "stop": 4,
        "half_um": 2.5,
        "nearly_um": 4.0,
        "volume_um": 1.2,
    }

    def said(self, **changed: Any) -> list[str]:
        slip = {**self.SLIP, **changed}
        extra = {
            "unseen_slip": {"diagonals": slip},
            "predicted": predicted((1.9, 1.3, 2.7), (4.0, 3.0, 6.0)),
        }
        return [
            render(each, "en")
            for each in conclude(replace(made_up_result(), **members(**extra))).unknown
            if "slip" in each.key
        ]

    def test_is_said_with_the_sizes_that_are_noticed(self) -> None:
        (words,) = self.said()
        assert (
            "2.5 µm in diagonal X+Y-Z- to X-Y+Z+ (npp), pass 1 out, stop 5 stays undetected"
            in words
        )
        assert "A slip of 4.0 µm is nearly always detected (95 %)" in words

    def test_is_said_with_its_passes_where_it_makes_more_than_the_readings_do(self) -> None:
        """0.5 µm of 1.9 that are left, but the readings make 0.2 of the volume: the stated u has
        that and not the slip."""
        slip, passes = self.said(volume_um=0.5, readings_um=0.2, passes=["npp/1", "ppp/2"])
        assert (
            "2.5 µm in diagonal X+Y-Z- to X-Y+Z+ (npp), pass 1 out, stop 5 stays undetected"
            in slip
        )
        assert "an undetected slip in npp (pass 1); ppp (pass 2) cause" in passes
        assert "(0.2 µm, k = 1)" in passes
        assert self.said(volume_um=0.5, readings_um=0.2, passes="nonsense") == [slip]

    @pytest.mark.parametrize(("increments", "passes"), [(2, (1,)), (4, (1, 2, 3, 4))])
    def test_never_goes_away_when_readings_get_noisier_and_makes_no_uncertainty_smaller(
        self, increments: int, passes: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """With readings to 1 µm of four passes on one count 6 µm went unsaid, that are noticed in
        half of the surveys."""
        sizes = []
        for noise_um in spread((0.05, 0.2, 1.0, 5.0), 3):
            bench = Bench(
                seed=3,
                increments=increments,
                diagonal_noise_um=noise_um,
                linear_noise_um=noise_um,
                angle_urad=2.0,
            )
            readings = bench.survey(
                (*DIAGONALS, *LINEAR), passes=passes, joined=len(passes) > 1
            )
            result = solve(readings)
            assert "unknown_slip" in {each.key for each in conclude(result).unknown}
            sizes.append(result.unseen_slip.diagonals.half_um)
        assert sizes == sorted(sizes)
        monkeypatch.setattr("stepdiag.solver.methods.estimate.slips_report", lambda *_: None)
        without = solve(readings)
        assert without.unseen_slip is None
        for each in ("errors", "squareness", "scale"):
            told, alone = getattr(result, each), getattr(without, each)
            known = [name for name in alone if alone[name].u is not None]
            assert all(
                np.all(np.asarray(told[name].u) >= np.asarray(alone[name].u))
                for name in known
            )

    def test_of_any_size_is_always_said(self) -> None:
        (words,) = self.said(half_um=None, nearly_um=None, volume_um=None)
        assert (
            "The readings cannot show a slip of the laser's count in diagonal X+Y-Z- to X-Y+Z+ "
            "(npp), pass 1 out, stop 5" in words
        )


def test_a_proof_run_concludes_with_its_verdict_alone() -> None:
    """One diagonal and one line state nothing about a machine's errors, and promise nothing."""
    verdict = finding("warning", message("proof.open", open=["EXX not decided"]))
    result = replace(made_up_result(), findings=(verdict,))
    concluded = conclude(result)
    assert (concluded.next_step.key, concluded.reach) == ("next_proof", None)
    assert not any(
        (
            concluded.wrong,
            concluded.unknown,
            concluded.reached,
            concluded.verdict,
            concluded.basis,
            concluded.load,
        )
    )
    assert "EXX not decided" in render(concluded.next_step, "en")


def test_files_that_only_a_proof_run_can_judge_are_loaded_for_it() -> None:
    (sentence,) = loadable([Export(controller="siemens", unproven=True)])
    assert sentence.key == "load_proof"
