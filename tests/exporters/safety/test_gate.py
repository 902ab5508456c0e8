"""The last gate: text that a control would read otherwise than it was meant is never written,
whoever made it."""

from dataclasses import replace

import msgspec
import pytest

from stepdiag.base.errors import DataError, SafetyError
from stepdiag.base.findings import Finding
from stepdiag.base.messages import message
from stepdiag.exporters.export.export import export
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.linuxcnc.control import LinuxCnc
from stepdiag.exporters.profiles.registry import CONTROLLERS, controller_named
from stepdiag.exporters.safety.checks import Case, refuse
from stepdiag.exporters.safety.gate import gate_findings, require_clean
from stepdiag.exporters.safety.restore import restore_files
from stepdiag.exporters.safety.standing import Standing
from stepdiag.exporters.siemens.control import Siemens
from stepdiag.exporters.tables.curves import curves_of
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME, made_result

RESULT = made_result(
    {"EXX": [0, 3, 8, 12, 20], "EYX": [0, 1.5, 2, 1, 0]}, squareness={"C0Y": 20.0}
)


@pytest.mark.parametrize("name", sorted(CONTROLLERS))
def test_what_every_controller_writes_passes(name):
    controller, profile = controller_named(name), profile_of(name, VOLUME)
    plan = controller.plan(curves_of(RESULT, profile.machine.functions), profile)
    settled = replace(profile, options=plan.options or profile.options)
    files = controller.render(
        plan.tables, settled, ["UNTESTED SIGN"] if name != "fanuc" else []
    )
    require_clean(
        [*files, *restore_files(controller, plan.tables, settled)], profile.existing
    )


@pytest.mark.parametrize(
    "text",
    [
        "$A[0]=nan",
        "0.0 inf 0.0",
        "$A[0]=1e-05",
        "-2.5E3 0 0",
        "x=1234567890123",
        "0.12345678901",
        "$A[0]=.5",
        "--5",
        "\xe4",
    ],
)
def test_what_a_control_could_misread_is_refused_with_its_line(text):
    file = ControlFile(name="T.INI", data=f"0.0 0.0\n{text}\n".encode("latin-1"))
    with pytest.raises(SafetyError, match="line 2: ") as refusal:
        require_clean([file])
    assert refusal.value.code == "file-unsound.text"
    require_clean([replace(file, role="note")])
    require_clean([file], own=[file])


@pytest.mark.parametrize(
    ("control", "old", "new"),
    [
        (Siemens, b"=0.0080", b"=nan"),
        (Siemens, b"=0.0080", b"=8e-3"),
        (Siemens, b"=0.0080", b"=0.0090"),
        (Siemens, b"=0.0080", b"=8.0000"),
        (LinuxCnc, b"0.0 0.008 0.008", b"-150.0 -149.992 -149.992"),
    ],
)
def test_nothing_is_written_of_a_text_that_went_wrong(
    control, old, new, tmp_path, monkeypatch
):
    """A renderer that errs: no number, a power of ten, another number, one beyond the limits,
    positions that fall."""
    rendered = control.render

    def wrong(self, tables, profile, notes=()):
        return tuple(
            replace(file, data=file.data.replace(old, new))
            for file in rendered(self, tables, profile, notes)
        )

    monkeypatch.setattr(control, "render", wrong)
    name = control().name
    with pytest.raises((SafetyError, DataError)):
        export(RESULT, name, profile_of(name, VOLUME), out_dir=tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_a_table_beyond_the_travel_is_refused(tmp_path):
    profile = profile_of("siemens", VOLUME)
    axes = profile.axes | {
        "X": msgspec.structs.replace(profile.axes["X"], travel_mm=(0.0, 200.0))
    }
    with pytest.raises(SafetyError) as refusal:
        export(RESULT, "siemens", replace(profile, axes=axes), out_dir=tmp_path / "out")
    assert refusal.value.code == "beyond-travel"


def test_an_old_table_in_a_written_file_stays_within_the_limits():
    control, profile = controller_named("siemens"), profile_of("siemens", VOLUME)
    plan = control.plan(curves_of(RESULT, ["EXX", "EYX"]), profile)
    new, old = plan.tables
    large = replace(old, value_um=old.value_um * 1000.0)
    case = Case(controller=control, profile=profile, result=RESULT, tables=[new])
    keys = [
        [
            each.key
            for each in gate_findings(case, Standing(before=(kept,), after=read, new=read))
        ]
        for kept in (old, large)
        for read in [(new, kept)]
    ]
    assert ["value-large.limit" in each for each in keys] == [False, True]


def test_a_refusal_by_the_verdict_on_a_table_has_the_code_of_the_verdict():
    words = message("of-table", label="EXX", what=message("nothing-like-what-result"))
    wrong = Finding(code="unlike", severity="error", text="EXX is unlike", message=words)
    with pytest.raises(SafetyError) as refused:
        refuse([wrong], (), "files")
    assert refused.value.code == "unlike"
