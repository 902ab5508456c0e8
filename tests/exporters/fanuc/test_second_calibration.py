"""FANUC, a second calibration: the machine was measured with its old tables on, and the new ones
have a finer step."""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from stepdiag.base.errors import SafetyError
from stepdiag.base.result.members import ActiveFile, Facts
from stepdiag.base.result.result import Result
from stepdiag.exporters.export.export import export
from stepdiag.exporters.fanuc.control import Fanuc
from stepdiag.exporters.fanuc.straightness import SETS
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.safety.verify import Figures, verify_files
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table, mean_correction_um
from testkit.exact.machines import EOB, new_punch_file, profile_of
from testkit.exact.results import VOLUME, made_result
from testkit.examples import few

FINE = replace(VOLUME, increments=20)
NAMES = ("EXX", "EYY", "EZZ", "EXY", "EXZ", "EYZ")
SQUARE = {"EXY": ("C0Y", -1e3), "EXZ": ("B0Z", 1e3), "EYZ": ("A0Z", -1e3)}
ACCEPT = (
    "slope-steep",
    "change-large",
    "sign-untested.recalled",
    "function-left-out.report",
    "slope-steep.neighbour",
)
CONTROL = Fanuc()


def delivered() -> ControlFile:
    """The punched file of a control with the straightness option, all zero."""
    keys = [
        key for one in SETS for key in (one.moving, one.compensated, *one.points, *one.values)
    ]
    lines = [line for line in new_punch_file().split(EOB) if line not in (b"", b"%")]
    return ControlFile(
        name="PITCH.TXT",
        data=EOB.join([b"%", *lines, *(b"N%05dQ1P0" % key for key in sorted(keys)), b"%"])
        + EOB,
    )


def profile(sections: int, own: ControlFile, state: str) -> Profile:
    plain = profile_of("fanuc", FINE, sections=sections)
    machine = msgspec.structs.replace(
        plain.machine, functions=list(NAMES), measured_with=state
    )
    options = msgspec.structs.replace(
        plain.options, straightness_option=True, detection_unit_um=0.1
    )
    return replace(plain, existing=(own,), machine=machine, options=options)


def measured(seed: int, active: Sequence[Table], own: ControlFile | None) -> Result:
    """What a perfect survey finds of one machine, with the old tables on where there are any."""
    rng = np.random.default_rng(seed)
    size, waves, shift = (
        rng.uniform(2.0, 12.0, (2, 6)),
        rng.uniform(1.0, 4.0, 6),
        rng.uniform(0.0, 6.0, 6),
    )
    errors, square = {}, {"C0Y": 0.0, "B0Z": 0.0, "A0Z": 0.0}
    for index, name in enumerate(NAMES):
        axis = "XYZ".index(name[2])
        at = FINE.nodes_mm(axis)
        share = (at - at[0]) / (at[-1] - at[0])
        points = np.tile(np.array(FINE.origin_mm, dtype=float), (len(at), 1))
        points[:, axis] = at
        moved = mean_correction_um([table for table in active if table.name == name], points)[
            :, "XYZ".index(name[1])
        ]
        bend = np.sin(waves[index] * np.pi * share + shift[index])
        error = (
            size[0, index] * bend
            + 0.3 * size[1, index] * np.sin(2.7 * waves[index] * np.pi * share)
            + moved
        )
        error -= error[0]
        if name in SQUARE:
            slope = error[-1] / (at[-1] - at[0])
            error = error - slope * (at - at[0])
            square[SQUARE[name][0]] = SQUARE[name][1] * slope
        errors[name] = error
    files = (
        ()
        if own is None
        else (
            ActiveFile(
                name=own.name, sha256=hashlib.sha256(own.data).hexdigest(), date="", source=""
            ),
        )
    )
    survey = Facts(compensation="on" if own else "off", active_files=files)
    return replace(
        made_result(errors, squareness=square, u_um=0.1, volume=FINE), survey=survey
    )


@few(5, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    seed=st.integers(0, 10_000),
    sections=st.sampled_from([8, 10, 16]),
    finer=st.sampled_from([2, 3, 4]),
)
def test_a_finer_step_is_no_other_machine(seed, sections, finer, tmp_path_factory):
    """Four points of straightness lie at other places than before: the residual alone cannot be
    held there, the whole error can."""
    folder: Path = tmp_path_factory.mktemp("out")
    first = profile(sections, delivered(), "off")
    export(measured(seed, (), None), "fanuc", first, accept=ACCEPT, out_dir=folder / "first")
    own = ControlFile(
        name="PITCH.TXT", data=(folder / "first" / "PITCH_UNTESTED_SIGN.TXT").read_bytes()
    )
    second = profile(sections * finer, own, "on")
    residual = measured(seed, CONTROL.parse([own], first), own)
    report = export(residual, "fanuc", second, accept=ACCEPT, out_dir=folder / "second")
    assert report.prediction is not None
    before, after = report.prediction.figures(rigid_motion=False)
    assert isinstance(after, Figures)
    assert after.rms_um <= before.rms_um * 1.02 + 0.3
    new = ControlFile(
        name="PITCH.TXT", data=(folder / "second" / "PITCH_UNTESTED_SIGN.TXT").read_bytes()
    )
    assert verify_files(residual, [new], second).right
    turned = [replace(table, value_um=-table.value_um) for table in report.tables]
    assert not verify_files(residual, CONTROL.render(turned, second), second).right


def test_old_pitch_data_without_their_interval_are_refused():
    """A file of pitch data alone does not hold 3624: read at the new step, the old table would lie
    elsewhere."""
    lines = [b"N1%04dQ0P%d" % (point, point % 3) for point in range(700)]
    own = ControlFile(name="PITCH.TXT", data=EOB.join([b"%", *lines, b"%"]) + EOB)
    with pytest.raises(
        SafetyError, match=r"parameter 3624.*no interval for A1, A2, A3"
    ) as refusal:
        CONTROL.standing([own], (), profile(8, own, "on"))
    assert refusal.value.code == "template-missing.parameters"
