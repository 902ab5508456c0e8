"""The test whether the two runs of a sign test are evidence for the sense of a table.

Three faults cause the same difference of the two runs: a bump that moves the axis in the wrong
direction, exchanged runs, and a laser that counts backwards. The error curve of the axis, known
from a survey, separates these faults:

    off = known curve,              on = known curve + sense * bump

The run without the bump must follow the known curve with its sign, and only the other run may
contain the bump. A run may also have an origin and a slope, from the alignment of laser or dial. On
a control with slopes only, the slope itself is tested. The record of a test is evidence only for
the machine, control and measuring system in the record.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date

import numpy as np

from stepdiag.base.errors import DataError
from stepdiag.base.messages import Message, message
from stepdiag.base.result.result import Result
from stepdiag.base.volume import Vector, rms
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.safety.identity import same_name
from stepdiag.exporters.safety.sign_run import SignRun
from stepdiag.exporters.safety.sign_test import Bump, Verdict
from stepdiag.exporters.tables.controller import Controller
from stepdiag.exporters.tables.fit import fitted
from stepdiag.exporters.tables.merge import merged
from stepdiag.exporters.tables.profile import Profile, SignTestRecord

FEWEST = 7
"""Least number of positions of a run, to estimate four unknowns: origin, slope, curve and bump."""
FOLLOWS_UM, FOLLOWS = 2.0, 0.6
"""Largest difference between a run and the known curve, in um and as a share of the curve. The run
and the survey may differ in their line in the volume and in temperature.
"""
HALF = 0.5
"""Share above which a run contains the bump or the curve."""
NOISE_UM = 0.1
"""Least scatter of readings in um."""
SURE = 0.3
"""Largest standard uncertainty of the share of a curve at which its sign is known. The share is 1
for a laser that counts forwards, and -1 for a laser that counts backwards.
"""


def known_um(
    result: Result, controller: Controller, profile: Profile, test: Bump, position_mm: Vector
) -> Vector:
    """Return the error of the machine without any compensation at positions, in um, from a result.

    Raises ``DataError`` for a function that the result does not identify.
    """
    name, _, by = test.function.partition("*")
    fit = fitted(result, [name], profile.machine.squareness_into)
    on = profile.machine.measured_with == "on"
    (curve,) = (
        merged(fit.curves, controller.standing(profile.existing, (), profile), profile)
        if on
        else fit.curves
    )
    known = curve.at(position_mm)
    for product in fitted(result).products if by else ():
        if test.lever is not None and (
            product.output_axis,
            product.input_axis,
            product.by_axis,
        ) == (name[1], name[2], by):
            share = (test.lever[1] - product.middle_mm) / product.half_mm
            known = known + share * np.interp(
                position_mm, product.position_mm, product.value_um
            )
    return np.asarray(known)


def require_sound(test: Bump, run: SignRun, known: Vector) -> None:
    """Raise ``DataError``, with the name of the fault, unless the run with the table off follows
    the ``known`` error (um) and only the other run contains the bump.

    The faults are exchanged runs, a bump in both runs, a laser or dial that counts backwards, a run
    of another axis or machine, and a curve too flat to show the direction of a dial.
    """
    at = run.position_mm
    if len(at) < FEWEST:
        raise _refused(
            message("at-least-positions", count=FEWEST),
            message("so-many-positions", count=len(at)),
        )
    ramp = test.beyond_mm is None
    free = np.column_stack([np.ones(len(at)), *([] if ramp else [at - np.mean(at)])])
    bump = test.moved_um(at)
    follows = message("run-follows", name=test.function, size_um=rms(_without(free, known)))
    share, u = _share(known, np.column_stack([bump, free]), run.off_um)
    if share < -HALF and share + 2.0 * u < 0.0:
        raise _refused(follows, message("run-backwards", share=share))
    off, on = (_share(bump, free, values - known)[0] for values in (run.off_um, run.on_um))
    if abs(off) > HALF:
        raise _refused(
            message("bump-in-run-on"),
            message("runs-exchanged") if abs(on) <= HALF else message("bump-in-both"),
        )
    miss_um = rms(_without(free, run.off_um - known))
    if (
        miss_um > max(FOLLOWS_UM, FOLLOWS * rms(_without(free, known)))
        or abs(share - 1.0) > HALF + 2.0 * u
    ):
        raise _refused(follows, message("run-unlike", miss_um=miss_um))
    if not run.grows and (u > SURE or share < HALF):
        raise _refused(follows, message("curve-flat", name=test.function))


def _share(column: Vector, beside: Vector, values: Vector) -> tuple[float, float]:
    own, rest = _without(beside, column), _without(beside, values)
    size = float(own @ own)
    if size < NOISE_UM**2:
        return 0.0, np.inf
    share = float(own @ rest) / size
    scatter = float(np.sum((rest - share * own) ** 2)) / max(
        len(values) - beside.shape[1] - 1, 1
    )
    return share, float(np.sqrt(max(scatter, NOISE_UM**2) / size))


def _without(columns: Vector, values: Vector) -> Vector:
    return np.asarray(values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0])


def _refused(expected: Message, found: Message) -> DataError:
    return DataError(
        message("sign-test"), expected=expected, found=found, remedy=message("runs-again")
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """Machine, control and measuring system of a sign test ("" for a control without a choice of
    measuring system).
    """

    machine: str
    control: str
    system: str

    def covers(self, record: SignTestRecord) -> bool:
        """Return whether a record is about this machine, control and measuring system, and contains
        the hashes of its bump and its runs.
        """
        same = (
            same_name(record.machine, self.machine)
            and record.control == self.control
            and record.measuring_system == self.system
        )
        return same and bool(record.bump_sha256 and record.runs_sha256)


def subject(control: str, profile: Profile) -> Subject:
    return Subject(
        machine=profile.machine.name,
        control=control,
        system=str(getattr(profile.options, "measuring_system", "")),
    )


def record(
    test: Bump, shown: Verdict, about: Subject, day: date, runs: Sequence[ControlFile]
) -> SignTestRecord:
    """Return the record of a test. Raises ``DataError`` for an undecided test."""
    if shown.sense is None:
        raise DataError(
            message("sign-test"), expected=message("test-decides"), found=shown.words
        )
    return SignTestRecord(
        kind=shown.kind,
        date=day,
        verdict=shown.sense,
        machine=about.machine,
        control=about.control,
        measuring_system=about.system,
        function=test.function,
        bump_sha256=_hashes([file for file in test.files if file.role == "data"]),
        runs_sha256=_hashes(runs),
    )


def _hashes(files: Sequence[ControlFile]) -> list[str]:
    return [hashlib.sha256(file.data).hexdigest() for file in files]
