"""The effect of files on the error of a machine. The files are parsed as written and applied by the
control's law.

The error field comes from the solver's rigid-body model with its Abbe arms; the correction comes
only from the bytes of the files. Each statistic is given in two forms: relative to the low corner
of the volume, and without the best fitting rigid motion, which depends on the place of the
workpiece.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from stepdiag.base.compensation import stated_in
from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.findings import Finding, error, warning
from stepdiag.base.messages import message
from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.base.result.interval import Predicted
from stepdiag.base.result.prediction import predicted
from stepdiag.base.result.result import DISPLACEMENTS, Result
from stepdiag.base.result.stretches import harmed
from stepdiag.base.result.waves import coarse_functions, hiding_functions
from stepdiag.base.volume import Vector, Volume, anywhere_mm, grid_points_mm
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.linuxcnc.control import LinuxCnc
from stepdiag.exporters.profiles.file import quick_profile
from stepdiag.exporters.profiles.registry import CONTROLLERS
from stepdiag.exporters.safety.checks import LIMITS, Case, run_checks
from stepdiag.exporters.safety.compensation import require_agreement
from stepdiag.exporters.safety.identity import require_same_machine
from stepdiag.exporters.safety.levers import require_levers
from stepdiag.exporters.safety.standing import Standing, identifies, standing_findings
from stepdiag.exporters.safety.state import proof_needed, states
from stepdiag.exporters.safety.verdicts.judge import judge, judge_missing
from stepdiag.exporters.safety.verdicts.lattice import judge_lattice
from stepdiag.exporters.safety.verdicts.verdict import Judgement
from stepdiag.exporters.tables import lattice
from stepdiag.exporters.tables.angular import require_chain
from stepdiag.exporters.tables.controller import Controller
from stepdiag.exporters.tables.lattice import Lattice
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.reading import tables_in
from stepdiag.exporters.tables.tables import Table, joined, mean_correction_um

Correction = Callable[[Vector], Vector]
"""A function from commanded points (N, 3) in mm to the correction there in um."""
STRETCH: Final = "stretch-worse"
CLEARLY = 1.02
"""Ratio of the error after loading to the error before, above which the files make the machine
worse. Smaller increases are within the uncertainty of the prediction.
"""
ROUNDING_UM = 0.3
"""Largest increase of the rms of an error by the rounding of tables in units of 1 um."""
NODES = 11
"""Points along each axis of the grid on which the effect is drawn."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """Length of the error vector over the grid, in um."""

    largest_um: float
    rms_um: float

    @classmethod
    def of(cls, errors_um: Vector) -> "Figures":
        length = np.linalg.norm(errors_um, axis=1)
        return cls(
            largest_um=float(np.max(length)), rms_um=float(np.sqrt(np.mean(length**2)))
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Effect:
    """The error before and after at points of a volume: ``points_mm``, ``before_um`` and
    ``after_um`` have shape (N, 3)."""

    volume: Volume
    points_mm: Vector
    before_um: Vector
    after_um: Vector

    def errors_um(self, *, rigid_motion: bool) -> tuple[Vector, Vector]:
        if rigid_motion:
            return self.before_um, self.after_um
        return self.rest_um(self.before_um), self.rest_um(self.after_um)

    def rest_um(self, errors_um: Vector) -> Vector:
        return without_rigid_motion(self.volume, self.points_mm, errors_um)


@dataclass(frozen=True, slots=True, kw_only=True)
class Prediction:
    """The predicted effect of files. ``anywhere`` is the effect at points spread over the volume,
    from which all values and refusals are computed. ``drawn`` is the effect at the points of the
    picture.
    """

    anywhere: Effect
    drawn: Effect
    predicted: Predicted
    """The predicted error before and after compensation, as intervals."""

    @property
    def volume(self) -> Volume:
        return self.anywhere.volume

    def figures(self, *, rigid_motion: bool) -> tuple[Figures, Figures]:
        before, after = self.anywhere.errors_um(rigid_motion=rigid_motion)
        return Figures.of(before), Figures.of(after)

    @property
    def worse(self) -> bool:
        """Return whether the error of the machine is larger with the files than without, rigid
        motion removed.
        """
        before, after = self.figures(rigid_motion=False)
        return after.largest_um > before.largest_um

    @property
    def clearly_worse(self) -> bool:
        """Return whether the machine's error with the files increases by more than rounding can
        cause.
        """
        before, after = self.figures(rigid_motion=False)
        return after.rms_um > before.rms_um * CLEARLY + ROUNDING_UM

    def picture(self) -> dict[str, list[list[float]]]:
        """Return plain lists for a plot: points in mm, error vectors before and after in um,
        without rigid motion.
        """
        before, after = self.drawn.errors_um(rigid_motion=False)
        return {
            "points_mm": self.drawn.points_mm.tolist(),
            "before_um": before.tolist(),
            "after_um": after.tolist(),
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Verification:
    """Contents of files and their effect. ``assumed`` is true if there is no profile, so axis names
    and references are assumed.

    ``judgements`` has an entry per table and per function without a table. ``findings`` contains
    the violations of the limits of control and profile.
    """

    controller: str
    assumed: bool
    tables: tuple[Table, ...]
    prediction: Prediction
    judgements: tuple[Judgement, ...] = ()
    findings: tuple[Finding, ...] = ()

    @property
    def right(self) -> bool:
        """Return whether the files may be loaded: no table is wrong or beyond a limit, and the
        machine does not become worse.
        """
        within = all(finding.severity != "error" for finding in self.findings)
        return (
            within
            and all(each.harmless for each in self.judgements)
            and not self.prediction.clearly_worse
        )

    @property
    def verdict(self) -> Literal["right", "wrong", "undecided"]:
        """Return the verdict on all files. Right files are undecided until a proof run if the data
        do not confirm the stated state of the old tables during the measurement.
        """
        if not self.right:
            return "wrong"
        return "undecided" if proof_needed(self.findings) else "right"


def predict(
    result: Result,
    tables: Sequence[Table],
    replaced: Sequence[Table] = (),
    nodes: int = NODES,
) -> Prediction:
    """Return the effect of ``tables`` on the error field of the result, as mean of both directions
    of travel.

    ``replaced`` contains the tables that were active during the measurement and that the new tables
    replace.
    """
    return predict_moved(
        result,
        lambda points: mean_correction_um(tables, points),
        lambda points: mean_correction_um(replaced, points),
        nodes,
        _steps_unseen(result.volume, replaced),
    )


def _steps_unseen(volume: Volume, replaced: Sequence[Table]) -> Correction | None:
    """Return the effect of stepped tables between the targets of the survey, for tables that were
    active during the measurement; None without stepped tables.

    The survey joins its targets by straight lines, which contain the steps only at the targets.
    """
    stepped = [table for table in replaced if table.law.between == "stepped"]
    if not stepped:
        return None

    def steps_um(points_mm: Vector) -> Vector:
        return mean_correction_um(stepped, points_mm) - mean_correction_um(
            [joined(table) for table in stepped], points_mm
        )

    x, y, z = (volume.nodes_mm(axis) for axis in range(3))
    corners = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1)
    seen = Lattice(
        axes_mm=(x, y, z), vectors_um=steps_um(corners.reshape(-1, 3)).reshape(corners.shape)
    )
    return lambda points_mm: steps_um(points_mm) - seen.correction_um(points_mm)


def predict_moved(
    result: Result,
    moved: Correction,
    replaced: Correction | None = None,
    nodes: int = NODES,
    unseen: Correction | None = None,
) -> Prediction:
    """Return the effect of a correction that is no sum of tables, such as a lattice. ``replaced``
    was active during the measurement. ``unseen`` is the known movement of ``replaced`` between the
    targets.

    Only the picture uses a grid. Predictions and refusals are valid for a tool anywhere in the
    volume. Many points of a grid are on the faces, where straightness is zero by definition, so the
    mean square over a grid is up to a tenth too small.
    """

    def added(points_mm: Vector) -> Vector:
        return moved(points_mm) - (replaced(points_mm) if replaced is not None else 0.0)

    def beside(points_mm: Vector) -> Vector | float:
        return 0.0 if unseen is None else unseen(points_mm)

    def at(points_mm: Vector) -> Effect:
        before = error_field_um(result, points_mm) + beside(points_mm)
        return Effect(
            volume=result.volume,
            points_mm=points_mm,
            before_um=before,
            after_um=before + added(points_mm),
        )

    anywhere, drawn = at(anywhere_mm(result.volume)), at(grid_points_mm(result.volume, nodes))
    corrected = predicted(
        result,
        anywhere.points_mm,
        anywhere.after_um - anywhere.before_um,
        beside(anywhere.points_mm),
    )
    return Prediction(anywhere=anywhere, drawn=drawn, predicted=corrected)


def verify_files(
    result: Result,
    files: Sequence[ControlFile],
    profile: Profile | None = None,
    nodes: int = NODES,
) -> Verification:
    """Return the control and the effect of files on the machine of the result. The control is
    recognised by the contents of the files.

    Without a profile the axes are AX1 AX2 AX3. Raises ``DataError`` for files that are unknown,
    mixed or damaged, ``SafetyError`` if profile and result disagree about the active compensation,
    ``UsageError`` if a profile must state it.
    """
    if stated_in(result).state == "on" and profile is None:
        expected = message("profile-machine-compensation-was")
        raise UsageError("--profile", expected=expected, found=message("none"))
    if profile is not None:
        require_same_machine(result, profile)
        require_agreement(result, profile)
        require_levers(result, profile)
    if len(files) == 1 and lattice.recognises(*files):
        return _of_lattice(result, lattice.parse(*files), profile, nodes)
    controller = controller_of(files)
    reading = profile or quick_profile(controller, result.volume)
    require_chain(result, reading)
    standing = contents(controller, files, reading)
    tables = standing.new
    prediction = predict(result, *standing.acting(result, reading), nodes=nodes)
    case = Case(controller=controller, profile=reading, result=result, tables=tables)
    findings = (
        *run_checks(case, LIMITS),
        *standing_findings(standing, result, reading),
        *states(result, controller, reading),
        *worse_findings(prediction, standing, result, reading),
        *harm_findings(prediction, result),
    )
    return Verification(
        controller=controller.name,
        assumed=reading.assumed,
        tables=tables,
        prediction=prediction,
        judgements=(
            *judge(result, tables, standing, reading),
            *judge_missing(result, controller, tables, reading),
        ),
        findings=findings,
    )


def acting_in(
    result: Result, controller: Controller, files: Sequence[ControlFile], profile: Profile
) -> tuple[tuple[Table, ...], tuple[Table, ...]]:
    return contents(controller, files, profile).acting(result, profile)


def contents(
    controller: Controller, files: Sequence[ControlFile], profile: Profile
) -> Standing:
    """Return the contents of the control before and after the files are loaded over the own files
    of the machine, as the control reads the bytes.

    Raises ``DataError`` for a table that occurs twice in the files, or in the own files.
    """
    new = tables_in(controller, files, profile) if files else ()
    if not profile.existing:
        return Standing(after=new, new=new)
    tables_in(controller, profile.existing, profile)
    before, after = (
        controller.standing(profile.existing, some, profile) for some in ((), files)
    )
    return Standing(before=before, after=after, new=new)


def worse_findings(
    prediction: Prediction, standing: Standing, result: Result, profile: Profile
) -> Iterator[Finding]:
    """Yield an error if the machine would have clearly larger errors after loading than during the
    measurement, or than with its old tables.
    """
    before, after = (figures.rms_um for figures in prediction.figures(rigid_motion=False))
    then = message("while-measured")
    old = (
        [table for table in standing.before if identifies(result, table)]
        if profile.machine.measured_with == "off"
        else []
    )
    if old:
        effect = prediction.anywhere
        with_old = Figures.of(
            effect.rest_um(effect.before_um + mean_correction_um(old, effect.points_mm))
        ).rms_um
        if with_old < before:
            before, then = with_old, message("with-old-tables")
    if after > before * CLEARLY + ROUNDING_UM:
        yield error("worse-after", after_um=after, then=then, before_um=before)


def harm_findings(prediction: Prediction, result: Result) -> Iterator[Finding]:
    """Yield a warning for each stretch of an axis that the files make worse by the prediction,
    although they improve the volume as a whole. Yield another warning for functions that are
    unknown between the targets.
    """
    effect = prediction.anywhere
    if not prediction.clearly_worse:
        beside = effect.before_um - error_field_um(result, effect.points_mm)
        for one in harmed(
            result, effect.points_mm, effect.after_um - effect.before_um, beside
        ):
            yield warning(
                "stretch-worse",
                axis=one.axis,
                low=one.low_mm,
                high_mm=one.high_mm,
                after=one.after.words(),
                before=one.before.words(),
            )
    names = sorted(
        {*coarse_functions(result.errors), *hiding_functions(result.errors)},
        key=DISPLACEMENTS.index,
    )
    if names:
        yield warning("increments-coarse.verify", names=names)


def _of_lattice(
    result: Result, held: Lattice, profile: Profile | None, nodes: int
) -> Verification:
    on = profile is not None and profile.machine.measured_with == "on"
    active = (
        lattice.parse(lattice.the_one_in(profile.existing, profile.source))
        if profile is not None and on
        else None
    )

    def added(points_mm: Vector) -> Vector:
        return held.correction_um(points_mm) - (
            active.correction_um(points_mm) if active is not None else 0.0
        )

    prediction = predict_moved(result, added, nodes=nodes)
    return Verification(
        controller=lattice.NAME,
        assumed=False,
        tables=(),
        prediction=prediction,
        judgements=judge_lattice(result, added, held.axes_mm),
        findings=tuple(harm_findings(prediction, result)),
    )


def controller_for(files: Sequence[ControlFile]) -> Controller:
    """Return the control for which the profile of files is written. A lattice alone belongs to the
    kinematics component of LinuxCNC.
    """
    return (
        LinuxCnc()
        if len(files) == 1 and lattice.recognises(files[0])
        else controller_of(files)
    )


def controller_of(files: Sequence[ControlFile]) -> Controller:
    """Return the controller whose format all files have. Raises ``DataError`` for files of no or
    several controllers.
    """
    named: dict[str, str] = {}
    for file in files:
        names = [
            name for name, controller in CONTROLLERS.items() if controller.recognises(file)
        ]
        if len(names) != 1:
            raise DataError(
                file.name,
                expected=message("compensation-file-known-controller"),
                found=message("or-list", items=names) if names else message("none-them"),
            )
        named.setdefault(names[0], file.name)
    if len(named) != 1:
        found = (
            message(
                "comma-list",
                items=[
                    message("file-of-control", file=file, control=name)
                    for name, file in named.items()
                ],
            )
            if named
            else message("no-table-file")
        )
        raise DataError("files", expected=message("files-one-controller"), found=found)
    return CONTROLLERS[next(iter(named))]
