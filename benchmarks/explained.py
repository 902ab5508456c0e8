"""What does the solver make of surveys with one thing wrong, or of machines beside its model? Exact
machines, no code of the solver.

Each `Row` is one truth. For every survey of it: is it refused; is a wrong cause named; where it is
not refused, does the true error after a compensation lie above the promise (silent and outside);
and what is left beside the same survey without that truth (its ideal).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.exact import left_um
from benchmarks.told import Told
from stepdiag.base.conditions.assumptions import Assumptions, usual_sizes
from stepdiag.base.errors import StepdiagError
from stepdiag.base.readings.readings import Readings, make_readings
from stepdiag.base.result.field import error_field_um
from stepdiag.base.result.prediction import predicted
from stepdiag.base.result.result import Result
from stepdiag.base.result.typed import written
from stepdiag.solver.methods.solve import solve
from stepdiag.virtual.drive.sequence import DrivenPass
from stepdiag.virtual.physics.environment import Environment
from stepdiag.virtual.physics.error_functions import (
    Amplitudes,
    ErrorSet,
    Waved,
    random_errors,
)
from stepdiag.virtual.physics.growth import Growth
from stepdiag.virtual.physics.kinematics import Pose
from stepdiag.virtual.physics.machine import Machine, Setup
from stepdiag.virtual.physics.optics import (
    Beam,
    CornerCube,
    PlaneMirror,
    perpendiculars,
    tilted,
)
from testkit.ordinary.arrivals import Scatter, arrivals
from testkit.ordinary.shop import mean_machine

Array = NDArray[np.float64]
SIZE_MM = (500.0, 400.0, 300.0)
DIAGONALS, RUNS = ("ppp", "npp", "pnp", "ppn"), ("linear-x", "linear-y", "linear-z")
ALL = (*DIAGONALS, *RUNS)
NOISE_UM, REPEATABILITY_UM, TILT_MRAD = 0.2, 0.3, 0.5
POINTS = 400
PLACE = 13
"""Stop of npp at which the machine has an error that no function describes."""
CAUSES = frozenset(
    (
        "setup-scale-off",
        "stop-outlier",
        "count-step",
        "pass-wanders",
        "pass-wanders.driven-again",
        "machine-beside-model",
        "machine-beside-model.place",
        "stated-u-low",
        "drift-large.growth",
        "step-mismatch.names",
    )
)
"""Message keys that name one cause."""
Extra = Callable[[str, int, Array, Array, Array, np.random.Generator], Array]
"""What a reading shows beside machine and noise, in um: by setup, pass, positions (k, 3), direction
(3,) and times (k,)."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One truth: what differs from a good survey. ``named`` are message keys that name it
    rightly."""

    name: str
    setups: Sequence[str] = ALL
    passes: Sequence[int] = (1,)
    increments: int = 10
    angle_urad: float = 4.0
    extra: Extra | None = None
    machine: Callable[[Machine, int], Machine] | None = None
    named: frozenset[str] = frozenset()
    shifts_mm: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    beam_end_mm: float = 0.0
    noise_um: float = NOISE_UM
    stated_um: float | None = None
    unseen_c: Callable[[str], float] | None = None
    feedback: str = "scale"
    exchanged: tuple[str, ...] = ()

    @property
    def ideal(self) -> "Row":
        """Return the same survey with nothing wrong."""
        return replace(
            self,
            extra=None,
            machine=None,
            beam_end_mm=0.0,
            noise_um=NOISE_UM,
            stated_um=None,
            unseen_c=None,
            exchanged=(),
        )


@dataclass(kw_only=True)
class Beside(Machine):
    """A machine whose tool is displaced by more than 21 functions say: ``field_um`` of positions
    (N, 3) from the low corner."""

    field_um: Callable[[Array], Array]

    def pose(self, commanded_mm: Array, **how: object) -> Pose:
        """Return the true tool frame with the field in it."""
        pose = Machine.pose(self, commanded_mm, **how)  # type: ignore[arg-type]
        return Pose(
            pose.origin_mm
            + 1e-3 * self.field_um(np.atleast_2d(commanded_mm) - self.origin_mm),
            pose.rotation,
        )


def beside(field_um: Callable[[Array], Array]) -> Callable[[Machine, int], Machine]:
    """Return what puts a field beside a machine's functions."""
    return lambda machine, _seed: Beside(
        errors=machine.errors,
        chain=machine.chain,
        expansion_um_m_c=machine.expansion_um_m_c,
        field_um=field_um,
    )


def _of(component: int, size_um: float, *axes: int) -> Callable[[Array], Array]:
    """Return a field of one component: a product of the shares of the travels of some axes."""

    def field_um(at: Array) -> Array:
        found = np.zeros_like(at)
        found[:, component] = size_um * np.prod(
            (at / np.array(SIZE_MM))[:, list(axes)], axis=1
        )
        return found

    return field_um


def _exact(values: object) -> Array:
    return np.asarray(values, dtype=np.float64)


def _scaled(setup: str, um_m: float) -> Extra:
    return lambda name, _number, at, direction, _time, _rng: _exact(
        um_m * 1e-3 * (at @ direction) * (name == setup)
    )


def _slip(setup: str, size_um: float) -> Extra:
    return lambda name, number, at, _d, _t, rng: _exact(
        size_um
        * (np.arange(len(at)) >= rng.integers(3, len(at) - 3))
        * (name == setup and number == 1)
    )


def _stop(setup: str, size_um: float) -> Extra:
    return lambda name, number, at, _d, _t, rng: _exact(
        size_um
        * (np.arange(len(at)) == rng.integers(3, len(at) - 3))
        * (name == setup and number == 1)
    )


def _there(size_um: float, *, step: bool) -> Extra:
    """Return an error at one stop of npp, or from it on, the same in each drive."""

    def extra(
        name: str,
        _number: int,
        at: Array,
        _direction: Array,
        _time: Array,
        _rng: np.random.Generator,
    ) -> Array:
        stop = np.arange(len(at))
        there = (stop >= PLACE) if step else (stop == PLACE)
        return _exact(size_um * there * (name.partition("+")[0] == "npp"))

    return extra


def _wander(setup: str, size_um: float) -> Extra:
    return lambda name, number, at, _d, _t, rng: _exact(
        size_um
        / np.sqrt(len(at))
        * np.cumsum(rng.normal(size=len(at)))
        * (name == setup and number == 1)
    )


def _turning(setup: str, urad: float) -> Extra:
    """Return a mirror that turns with its way along the diagonal in one setup: a hose or a cable
    pulls at it."""

    def extra(
        name: str,
        _number: int,
        at: Array,
        direction: Array,
        _time: Array,
        _rng: np.random.Generator,
    ) -> Array:
        turn = 0.7
        level, up = perpendiculars(direction)
        along = at @ direction
        lean = urad * (along - np.min(along)) / np.ptp(along) * 1e-3
        first = at[int(np.argmin(along))]
        return _exact(
            lean
            * ((at - first) @ (np.cos(turn) * level + np.sin(turn) * up))
            * (name == setup)
        )

    return extra


def _wound_up(size_um: float, over_mm: float) -> Extra:
    """Return an axis that has turned round and comes up only after some way."""

    def extra(
        _name: str,
        _number: int,
        at: Array,
        direction: Array,
        _time: Array,
        _rng: np.random.Generator,
    ) -> Array:
        gone = np.abs(at - at[0])
        way = np.sign(at[-1] - at[0])
        left: Array = -size_um * np.sum(
            (1.0 - np.minimum(gone / over_mm, 1.0)) * way * direction, axis=1
        )
        return left

    return extra


def _warming(um_m: float) -> Callable[[Machine, int], Machine]:
    def warm(machine: Machine, seed: int) -> Machine:
        drawn = np.random.default_rng((5, seed)).uniform(0.5, 1.5, 3) * um_m
        return replace(machine, growth=Growth(um_m=tuple(drawn.tolist()), tau_s=3600.0))

    return warm


@dataclass(frozen=True, slots=True, kw_only=True)
class Cycling(Growth):
    """Axes that grow and shrink as the temperature of the hall cycles with the period ``tau_s``."""

    phase: float

    def share(self, time_s: Array) -> Array:
        """Return the share of the amplitude at each time."""
        return _exact(np.sin(2.0 * np.pi * np.asarray(time_s) / self.tau_s + self.phase))


def _cycling(um_m: float, minutes: float) -> Callable[[Machine, int], Machine]:
    def cycling(machine: Machine, seed: int) -> Machine:
        phase = float(np.random.default_rng((9, seed)).uniform(0.0, 2.0 * np.pi))
        return replace(
            machine, growth=Cycling(um_m=(um_m,) * 3, tau_s=60.0 * minutes, phase=phase)
        )

    return cycling


def _drifting(size_um: float, course: Callable[[Array], Array], passes: int) -> Extra:
    """Return a count that drifts in two setups: ``course`` of the elapsed share of the time."""
    return lambda name, number, at, _d, _t, _rng: _exact(
        size_um
        * course((np.arange(len(at)) / (len(at) - 1) + number - 1) / passes)
        * (name in ("npp", "linear-z"))
    )


def _square(elapsed: Array) -> Array:
    return _exact(elapsed**2)


def _cube(elapsed: Array) -> Array:
    return _exact(elapsed**3)


def _settling(elapsed: Array) -> Array:
    return _exact(np.expm1(-3.0 * elapsed) / np.expm1(-3.0))


def _screws(size_um: float, pitch_mm: float) -> Callable[[Machine, int], Machine]:
    def waved(machine: Machine, seed: int) -> Machine:
        phase = np.random.default_rng((6, seed)).uniform(0.0, 2.0 * np.pi, 3)
        functions = dict(machine.errors.functions)
        for letter, at in zip("XYZ", phase.tolist(), strict=True):
            functions[f"E{letter}{letter}"] = Waved(
                functions[f"E{letter}{letter}"], size_um, pitch_mm, at
            )
        return replace(machine, errors=replace(machine.errors, functions=functions))

    return waved


BEAMS = {
    "ppp+1": (0.0, 60.0, 0.0),
    "npp+1": (0.0, 60.0, 0.0),
    "ppp+2": (0.0, 0.0, 60.0),
    "pnp+1": (0.0, 0.0, 60.0),
}
FACES = ("face-xy-pp", "face-xy-np", "face-xz-pp", "face-xz-np")
EDGES = {
    "linear-x+1": (0.0, 400.0, 300.0),
    "linear-y+1": (500.0, 0.0, 300.0),
    "linear-z+1": (500.0, 400.0, 0.0),
}
ROWS = (
    Row(name="good survey"),
    Row(name="good survey, out and back", passes=(1, 2)),
    *(
        Row(
            name=f"npp {um_m:g} um/m off",
            extra=_scaled("npp", um_m),
            named=frozenset(("npp",)),
        )
        for um_m in (5, 20, 40, 70, 93)
    ),
    Row(
        name="linear-y 50 um/m off",
        extra=_scaled("linear-y", 50.0),
        named=frozenset(("linear-y",)),
    ),
    Row(
        name="two days, 6 K apart",
        unseen_c=lambda name: 6.0 * (name in RUNS),
        named=frozenset(("drift-large.growth",)),
    ),
    *(
        Row(
            name=f"{urad:g} urad, beams shifted in y and z",
            setups=(*ALL, *BEAMS),
            shifts_mm=BEAMS,
            angle_urad=urad,
        )
        for urad in (5.0, 30.0, 90.0)
    ),
    *(
        Row(name=f"{urad:g} urad, four faces", setups=(*ALL, *FACES), angle_urad=urad)
        for urad in (5.0, 30.0, 90.0)
    ),
    *(
        Row(
            name=f"{urad:g} urad, three further edges",
            setups=(*ALL, *EDGES),
            shifts_mm=EDGES,
            angle_urad=urad,
        )
        for urad in (5.0, 30.0, 90.0)
    ),
    Row(name="screw 3 um, pitch 10 mm", machine=_screws(3.0, 10.0), feedback="screw"),
    Row(
        name="EY(x, z) of 4 um",
        machine=beside(_of(1, 4.0, 0, 2)),
        named=frozenset(("machine-beside-model",)),
    ),
    Row(
        name="EX(x, y) of 8 um",
        machine=beside(_of(0, 8.0, 0, 1)),
        named=frozenset(("machine-beside-model",)),
    ),
    Row(
        name="ram sag 30 um as y^2 z",
        machine=beside(_of(2, -30.0, 1, 1, 2)),
        named=frozenset(("machine-beside-model",)),
    ),
    Row(name="mirror turns 100 urad in ppp", extra=_turning("ppp", 100.0)),
    Row(
        name="mirror turns 100 urad in ppp, out and back",
        extra=_turning("ppp", 100.0),
        passes=(1, 2),
    ),
    Row(
        name="warms 10 um per 500 mm in an hour",
        machine=_warming(20.0),
        named=frozenset(("drift-large.growth",)),
    ),
    Row(
        name="warms 20 um per 500 mm in an hour",
        machine=_warming(40.0),
        named=frozenset(("drift-large.growth",)),
    ),
    *(
        Row(
            name=f"{um_m:g} um/m up and down in {minutes:g} min",
            machine=_cycling(um_m, minutes),
            named=frozenset(("drift-large.growth",)),
        )
        for um_m in (3, 10, 20)
        for minutes in (3, 6, 12, 20, 40, 90)
    ),
    *(
        Row(
            name=f"npp and linear-z drift by 6 um, {course}{way}",
            extra=_drifting(6.0, of_time, len(passes)),
            passes=passes,
        )
        for passes, way in (((1,), ""), ((1, 2), ", out and back"))
        for course, of_time in (("square", _square), ("cube", _cube), ("settling", _settling))
    ),
    *(
        Row(
            name=f"npp and pnp exchanged{way}",
            passes=passes,
            exchanged=("npp", "pnp"),
            named=frozenset(("step-mismatch.names",)),
        )
        for passes, way in (((1,), ""), ((1, 2), ", out and back"))
    ),
    Row(
        name="wind-up 5 um over 20 mm",
        extra=_wound_up(5.0, 20.0),
        increments=20,
        passes=(1, 2),
    ),
    Row(name="every beam 3 mm off at its end", beam_end_mm=3.0),
    Row(
        name="stated u 0.05, true 0.5 um",
        noise_um=0.5,
        stated_um=0.05,
        named=frozenset(("stated-u-low",)),
    ),
    *(
        Row(
            name=f"slip {um:g} um in pnp",
            extra=_slip("pnp", um),
            named=frozenset(("count-step",)),
        )
        for um in (5, 20, 200, 500, 2000)
    ),
    Row(
        name="slip 5 um in pnp, out and back",
        extra=_slip("pnp", 5.0),
        named=frozenset(("count-step",)),
        passes=(1, 2),
    ),
    Row(
        name="stop 5 um off in ppn",
        extra=_stop("ppn", 5.0),
        named=frozenset(("stop-outlier",)),
    ),
    Row(
        name="stop 20 um off in ppn",
        extra=_stop("ppn", 20.0),
        named=frozenset(("stop-outlier",)),
    ),
    *(
        Row(
            name=f"npp driven twice, {what} in both",
            setups=(*ALL, "npp+1"),
            extra=_there(size_um, step=step),
            named=frozenset(("machine-beside-model.place",)),
        )
        for what, size_um, step in (
            ("a stop 10 um off", 10.0, False),
            ("a step of 8 um", 8.0, True),
        )
    ),
    Row(
        name="ppp wanders 5 um", extra=_wander("ppp", 5.0), named=frozenset(("pass-wanders",))
    ),
)


@dataclass(frozen=True, kw_only=True)
class Judged:
    """What became of one survey; ``ideal_um`` is what the same survey leaves with nothing wrong."""

    refused: bool
    codes: tuple[str, ...]
    wrong: bool
    after: Told | None
    before_um: float
    ideal_um: float

    @property
    def silent(self) -> bool:
        """Tell whether the survey may be exported and is worse than promised."""
        return (
            not self.refused and self.after is not None and self.after.true > self.after.high
        )


def machine_of(row: Row, seed: int) -> Machine:
    """Return the machine of a row's survey."""
    wanted = Amplitudes(
        positioning_um=6.0, straightness_um=5.0, angle_urad=row.angle_urad, scale_um_m=20.0
    )
    errors: ErrorSet = random_errors(seed, (0.0, 0.0, 0.0), SIZE_MM, wanted)
    machine = Machine(errors=errors, expansion_um_m_c=(11.7,) * 3, environment=Environment())
    return machine if row.machine is None else row.machine(machine, seed)


def signs_of(setup: str) -> Array:
    """Return the direction of each axis in the travel of a setup, shape (3,)."""
    base = setup.partition("+")[0]
    signs = np.zeros(3)
    kind, _, rest = base.partition("-")
    axes, letters = (
        (rest, "p")
        if kind == "linear"
        else tuple(rest.split("-"))
        if kind == "face"
        else ("xyz", base)
    )
    for axis, letter in zip(axes, letters, strict=True):
        signs["xyz".index(axis)] = 1.0 if letter == "p" else -1.0
    return signs


def _stops_mm(row: Row, setup: str) -> Array:
    signs, size = signs_of(setup), np.array(SIZE_MM)
    shift = (
        np.array(row.shifts_mm.get(setup, (0.0, 0.0, 0.0)))
        if setup.startswith("linear")
        else np.zeros(3)
    )
    here = np.where(signs < 0, size, shift)
    stops = [here.copy()]
    for _ in range(row.increments):
        for axis in np.flatnonzero(signs):
            here[axis] += signs[axis] * size[axis] / row.increments
            stops.append(here.copy())
    return np.array(stops)


def drive(
    row: Row, machine: Machine, seed: int, *, still: bool = False
) -> tuple[Readings, Machine]:
    """Return the readings of a row's survey, and the machine at their mean time; ``still``: each
    axis ends at its target, and no mirror leans.
    """
    lean_mrad, arrival_um = (0.0, 0.0) if still else (TILT_MRAD, REPEATABILITY_UM)
    rng, of_extra = np.random.default_rng((7, seed)), np.random.default_rng((8, seed))
    columns: dict[str, list[Array]] = {
        name: [] for name in ("position_mm", "reading_mm", "time_s", "beam_mm", "unseen_c")
    }
    names: list[str] = []
    numbers: list[int] = []
    stops: list[int] = []
    zeros: list[int] = []
    start_s = 0.0
    for place, setup in enumerate(row.setups):
        outward = _stops_mm(row, setup)
        direction = signs_of(setup) * np.array(SIZE_MM)
        length = float(np.linalg.norm(direction))
        direction /= length
        linear = setup.startswith("linear")
        lean = lean_mrad * np.array([np.cos(turn := rng.uniform(0, 2 * np.pi)), np.sin(turn)])
        ends = row.beam_end_mm / length * 1e3 * np.array([np.cos(turn), np.sin(turn)])
        beam = tilted(
            direction, tuple((ends if linear or row.beam_end_mm else lean).tolist())
        )
        through = outward[0] + (
            np.zeros(3) if linear else np.array(row.shifts_mm.get(setup, (0.0, 0.0, 0.0)))
        )
        target = (
            CornerCube(np.zeros(3))
            if linear
            else PlaneMirror(
                np.zeros(3),
                tilted(direction, tuple((lean if not row.beam_end_mm else ends).tolist())),
            )
        )
        placed = Setup(
            name=setup,
            beam=Beam(through - 300.0 * beam, beam),
            target=target,
            zero_mm=outward[0],
        )
        unseen_c = 0.0 if row.unseen_c is None else row.unseen_c(setup)
        hot = replace(
            machine,
            environment=replace(
                machine.environment,
                material_c=replace(machine.environment.material_c, start=20.0 + unseen_c),
            ),
        )
        zero_mm = 0.0
        for number in row.passes:
            at = outward if number % 2 else outward[::-1].copy()
            way = signs_of(setup) if number % 2 else -signs_of(setup)
            came = arrivals(
                DrivenPass(setup, number, at, way), Scatter(arrival_um=(arrival_um,) * 3), rng
            )
            time_s = _exact(start_s + 10.0 * np.arange(len(at)))
            reading = hot.indicated_mm(
                placed, at + came.off_mm, direction=came.side, time_s=time_s
            )
            reading = _exact(reading + 1e-3 * rng.normal(scale=row.noise_um, size=len(at)))
            if row.extra is not None:
                reading = _exact(
                    reading + 1e-3 * row.extra(setup, number, at, direction, time_s, of_extra)
                )
            zero_mm = float(reading[0]) if number == row.passes[0] else zero_mm
            for name, values in (
                ("position_mm", at),
                ("reading_mm", reading - zero_mm),
                ("time_s", time_s),
            ):
                columns[name].append(values)
            columns["beam_mm"].append(np.tile(through, (len(at), 1)))
            columns["unseen_c"].append(np.full(len(at), unseen_c))
            names += [setup] * len(at)
            numbers += [number] * len(at)
            stops += range(len(at))
            zeros += [place] * len(at)
            start_s = float(time_s[-1]) + 30.0
        start_s += 600.0
    whole = {name: np.concatenate(values) for name, values in columns.items()}
    unseen = whole.pop("unseen_c")
    stated = row.noise_um if row.stated_um is None else row.stated_um
    readings = make_readings(
        setup=names,
        pass_number=numbers,
        stop=stops,
        u_um=[stated] * len(names),
        zero=zeros,
        **whole,  # type: ignore[arg-type]
    )
    readings = _in_each_others_place(readings, row.exchanged)
    truth = mean_machine(machine, whole["time_s"], unseen)
    return readings, beside(machine.field_um)(truth, seed) if isinstance(
        machine, Beside
    ) else truth


def _in_each_others_place(readings: Readings, exchanged: Sequence[str]) -> Readings:
    """Return readings in which two setups have each other's."""
    of_setup = {name: np.flatnonzero(np.array(readings.setup) == name) for name in exchanged}
    reading_mm = np.array(readings.reading_mm)
    for rows, other in zip(of_setup.values(), reversed(of_setup.values()), strict=True):
        reading_mm[rows] = readings.reading_mm[other]
    return replace(readings, reading_mm=reading_mm)


def wrong_names(row: Row, result: Result) -> bool:
    """Tell whether the result names one cause that is none of the row's."""
    for finding in result.findings:
        key = finding.message.key if finding.message else ""
        if finding.message and key in CAUSES and key not in row.named:
            about = str(finding.message.arguments.get("setup", ""))
            if not (about and about in row.named):
                return True
    return False


def judge(row: Row, seed: int, ideal_um: float | None = None) -> Judged:
    """Drive and solve one survey of a row."""
    machine = machine_of(row, seed)
    readings, truth = drive(row, machine, seed)
    points = np.random.default_rng(5).uniform(size=(POINTS, 3)) * np.array(SIZE_MM)
    true = truth.error_at(points)
    if ideal_um is None:
        ideal_um = judge(row.ideal, seed, 0.0).after.true  # type: ignore[union-attr]
    try:
        result = solve(
            readings,
            chain=truth.chain,
            assumed=Assumptions(
                between_um=usual_sizes("ordinary", row.feedback)["between_um"]
            ),
        )
    except StepdiagError as error:
        return Judged(
            refused=True,
            codes=(str(error)[:60],),
            wrong=False,
            after=None,
            before_um=left_um(points, true),
            ideal_um=ideal_um,
        )
    found = error_field_um(result, points)
    promised = predicted(result, points, -found).without_rigid_motion["after"].rms_um
    return Judged(
        refused=any(each.severity == "error" for each in result.findings),
        codes=tuple(each.code for each in result.findings if each.severity != "info"),
        wrong=wrong_names(row, result),
        after=Told(left_um(points, true - found), **written(promised)),
        before_um=left_um(points, true),
        ideal_um=ideal_um,
    )


def line(row: Row, judged: Sequence[Judged]) -> str:
    """Return the line of the table of a row."""
    count = len(judged)
    refused, silent, wrong = (
        sum(getattr(one, name) for one in judged) for name in ("refused", "silent", "wrong")
    )
    left = np.sqrt(np.mean([one.after.true**2 for one in judged if one.after]))
    ideal = np.sqrt(np.mean([one.ideal_um**2 for one in judged]))
    high = np.mean([one.after.high for one in judged if one.after])
    low = sum(one.after.true < one.after.low for one in judged if one.after)
    return (
        f"| {row.name} | {silent} | {wrong} | {refused} | {low} | {left:.2f} | {high:.2f} | "
        f"{left / ideal:.2f} | {count} |"
    )


def print_rows(seeds: Sequence[int], part: str = "") -> None:
    """Print the table of the rows whose name contains ``part``."""
    print(
        "| truth | silent and outside | wrong name | refused | below promise | rms left, um | at "
        "most | over ideal | surveys |"
    )
    print("|---|---|---|---|---|---|---|---|---|", flush=True)
    for row in ROWS:
        if part in row.name:
            print(line(row, [judge(row, seed) for seed in seeds]), flush=True)
