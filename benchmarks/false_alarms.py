"""How often does the solver refuse a good survey, and does the truth lie within its promise where
it does not?

Two distributions of exact machines and shops that share no code with the solver, nothing wrong in
any survey:

- ``stated``: machines drawn from the solver's own assumed sizes
  (`stepdiag.base.conditions.assumptions.Assumptions`);
- ``ordinary``: machines and shops of `testkit.ordinary.machines` and
  `testkit.ordinary.shop`, solved with the default assumptions: the user states nothing but
  the sensor noise of each reading.

``drawn_survey(seed, kind)`` returns a survey with its truth, ``judge_survey(seed, kind)`` what the
solver makes of it. The truth is the machine at the mean time of the readings (growth and material
temperature as their means), mean of both directions of approach.
"""

import os
import re
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from datetime import date
from functools import partial
from multiprocessing import get_context
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.exact import left_um
from benchmarks.told import Told, within
from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.errors import StepdiagError
from stepdiag.base.readings.readings import Readings, make_readings
from stepdiag.base.result.field import error_field_um
from stepdiag.base.result.prediction import BETWEEN_SHARE, predicted
from stepdiag.base.result.result import Result
from stepdiag.base.result.typed import written
from stepdiag.exporters.export.planning import planned
from stepdiag.exporters.profiles.file import quick_profile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.safety.checks import run_checks
from stepdiag.exporters.safety.verify import predict, worse_findings
from stepdiag.solver.methods.solve import solve
from stepdiag.virtual.drive.sequence import Box
from stepdiag.virtual.physics.error_functions import (
    AXES,
    Amplitudes,
    ErrorSet,
    Table,
    Waved,
    random_errors,
)
from stepdiag.virtual.physics.machine import Machine
from testkit.ordinary.arrivals import Scatter
from testkit.ordinary.machines import CHAINS, OrdinaryMachine, draw_machine
from testkit.ordinary.shop import Beam, DrivenSurvey, Shop, draw_shop, drive_survey

Kind = Literal["ordinary", "stated"]
KINDS: tuple[Kind, ...] = ("stated", "ordinary")
POINTS = 500
WORKERS = 2
FIRST_SEED = 5000
SURVEYS = 200
COLUMNS = ("errors", "warnings", "export")
EXPORT_DAY = date(2026, 1, 1)
"""No check of an export without a sign test asks for the day."""


class Drawn(NamedTuple):
    """A good survey with its truth: what the solver gets, and the machine it should find."""

    readings: Readings
    machine: Machine
    chain: str
    assumed: Assumptions
    box: Box
    shop: Shop
    drawn: OrdinaryMachine | None
    """The ordinary machine as it was drawn; None for ``stated``."""


@dataclass(frozen=True, kw_only=True)
class Judged:
    """What the solver said of one good survey.

    ``errors`` and ``warnings`` are the codes of the result's findings, once each. A survey that
    ``solve`` refuses has the error ``solve: <what was expected>``; ``before`` and ``after`` are
    None there, ``within`` is empty. ``export`` are the codes, of errors and of warnings, with which
    an export of tables with the survey's steps is refused for reasons of its own where no warning
    is accepted. ``about`` names machine and shop.
    """

    seed: int
    kind: Kind
    about: str
    errors: tuple[str, ...]
    warnings: tuple[str, ...]
    export: tuple[str, ...]
    texts: tuple[str, ...]
    before: Told | None
    after: Told | None
    within: dict[str, list[bool]]

    @property
    def refused(self) -> bool:
        """Tell whether the solver refuses: no result, or one with an error in it, of which no
        export is made."""
        return bool(self.errors)


def drawn_survey(seed: int, kind: Kind, *, large: bool = False) -> Drawn:
    """Return the good survey of a seed; ``large`` draws ordinary machines of 1 to 4 m."""
    if kind == "stated":
        return _stated(seed)
    rng = np.random.default_rng((36, seed))
    drawn = draw_machine(rng, large=large)
    shop = draw_shop(rng, drawn)
    survey = drive_survey(drawn.machine, shop)
    return Drawn(
        readings_of(survey),
        survey.truth,
        drawn.machine.chain,
        Assumptions(),
        shop.box,
        shop,
        drawn,
    )


def readings_of(survey: DrivenSurvey) -> Readings:
    """Return the readings of a driven survey as the solver takes them."""
    return make_readings(
        setup=survey.setup,
        pass_number=survey.pass_number,
        stop=survey.stop,
        position_mm=survey.position_mm,
        reading_mm=survey.reading_mm,
        u_um=survey.u_um,
        temperature_c=survey.temperature_c,
        time_s=survey.time_s,
        zero=survey.zero,
        turned=survey.turned,
    )


def _stated(seed: int) -> Drawn:
    """Draw a machine and a survey from the sizes that the solver assumes."""
    assumed, rng = Assumptions(), np.random.default_rng((37, seed))
    size_mm = (500.0, 400.0, 300.0)
    box = Box(size_mm=size_mm, increments=int(rng.integers(5, 21)), decimals=4)
    machine = Machine(
        errors=_stated_errors(seed, rng, assumed, box),
        chain=str(rng.choice(CHAINS)),
        expansion_um_m_c=_three(
            rng.normal(assumed.expansion_um_m_c, assumed.u_expansion_um_m_c)
        ),
    )
    passes = int(rng.choice((1, 2, 4), p=(0.4, 0.4, 0.2)))
    shop = Shop(
        box=box,
        passes=passes,
        scatter=Scatter(arrival_um=(assumed.repeatability_um,) * 3),
        beam=Beam(
            noise_um=assumed.reading_um,
            drift_um=assumed.drift_um,
            wander_um=assumed.wander_um,
            index=assumed.index,
            index_setup=assumed.index_setup,
            largest_mrad=assumed.alignment_mrad,
        ),
        setup_c=assumed.setup_c,
        seed=int(rng.integers(1 << 31)),
    )
    survey = drive_survey(machine, shop)
    return Drawn(readings_of(survey), survey.truth, machine.chain, assumed, box, shop, None)


def _stated_errors(
    seed: int, rng: np.random.Generator, assumed: Assumptions, box: Box
) -> ErrorSet:
    """Draw smooth functions of the assumed sizes, waves too short for the targets, and a reversal
    to 4 um."""
    amplitudes = Amplitudes(
        positioning_um=assumed.shape_um,
        straightness_um=assumed.shape_um,
        angle_urad=assumed.angles_urad,
        scale_um_m=np.sqrt(3.0) * assumed.scale_um_m,
        squareness_urad=assumed.squareness_urad,
    )
    drawn = random_errors(seed, box.origin_mm, box.size_mm, amplitudes)
    functions = dict(drawn.functions)
    for axis, letter in enumerate(AXES):
        period_mm = box.size_mm[axis] / box.increments * float(rng.uniform(0.5, 1.9))
        size, phase = (
            np.sqrt(2.0 * BETWEEN_SHARE) * assumed.between_um,
            float(rng.uniform(0.0, 2.0 * np.pi)),
        )
        functions[f"E{letter}{letter}"] = Waved(
            functions[f"E{letter}{letter}"], size, period_mm, phase
        )
    lost = {
        f"E{letter}{letter}": Table((0.0,), (-float(rng.uniform(0.0, 4.0)),))
        for letter in AXES
    }
    squareness = {
        name: float(rng.normal(scale=assumed.squareness_urad))
        for name in drawn.squareness_urad
    }
    return replace(drawn, functions=functions, squareness_urad=squareness, reversal=lost)


def _three(values: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def judge_survey(seed: int, kind: Kind, *, large: bool = False) -> Judged:
    """Solve the survey of a seed and hold what the result says against the truth."""
    survey = drawn_survey(seed, kind, large=large)
    try:
        result = solve(survey.readings, chain=survey.chain, assumed=survey.assumed)
    except StepdiagError as error:
        return Judged(
            seed=seed,
            kind=kind,
            about=about(survey),
            errors=(_refusal("solve", error),),
            warnings=(),
            export=(),
            texts=(str(error),),
            before=None,
            after=None,
            within={},
        )
    before, after = told_of(result, survey.machine, survey.box)
    return Judged(
        seed=seed,
        kind=kind,
        about=about(survey),
        errors=_codes(result, "error"),
        warnings=_codes(result, "warning"),
        export=export_codes(result),
        texts=tuple(
            f"{each.code}: {each.words}"
            for each in result.findings
            if each.severity != "info"
        ),
        before=before,
        after=after,
        within=within(result, survey.machine, survey.box.increments),
    )


def about(survey: Drawn) -> str:
    """Return machine and shop in a line."""
    shop, box = survey.shop, survey.shop.box
    machine = (
        "stated sizes"
        if survey.drawn is None
        else f"{survey.drawn.quality}, {survey.drawn.feedback}"
    )
    size = "x".join(f"{length:g}" for length in box.size_mm)
    program = (
        f"{box.decimals} decimals{', G91' if box.incremental else ''}, overrun {shop.overrun}"
    )
    positions = (
        f"{shop.registers.shows} positions "
        f"({max((*shop.scatter.servo_um, shop.registers.scatter_um)):.1f} um)"
    )
    scatter = (
        f"repeats to {max(shop.scatter.arrival_um):.2f} um, u {shop.beam.noise_um:.2f} um"
    )
    counts = f"n {box.increments}, {len(shop.setups)} setups, {shop.passes} passes"
    return (
        f"{machine}, {survey.chain}, {size} mm, {counts}, {program}, {positions}, {scatter}"
    )


def told_of(result: Result, truth: Machine, box: Box) -> tuple[Told, Told]:
    """Return true volumetric rms errors with their intervals: as it is, and after an ideal
    compensation of all that was found."""
    points = np.asarray(box.origin_mm) + np.random.default_rng(5).uniform(
        size=(POINTS, 3)
    ) * np.asarray(box.size_mm)
    true, found = truth.error_at(points), error_field_um(result, points)
    stated = predicted(result, points, -found).without_rigid_motion
    return Told(left_um(points, true), **written(stated["before"].rms_um)), Told(
        left_um(points, true - found), **written(stated["after"].rms_um)
    )


def _codes(result: Result, severity: str) -> tuple[str, ...]:
    return tuple(sorted({each.code for each in result.findings if each.severity == severity}))


def export_codes(result: Result) -> tuple[str, ...]:
    """Return the codes with which an export for a SINUMERIK without a profile is refused, besides
    errors of the result itself."""
    control = controller_named("siemens")
    profile = quick_profile(control, result.volume)
    try:
        made = planned(result, control, profile, EXPORT_DAY)
        prediction = predict(result, *made.standing.acting(result, profile))
    except StepdiagError as error:
        return (_refusal("export", error),)
    findings = (
        *run_checks(made.case),
        *worse_findings(prediction, made.standing, result, profile),
    )
    return tuple(
        sorted(
            {
                each.code
                for each in findings
                if each.severity != "info" and each.code != "data-quality"
            }
        )
    )


def _refusal(door: str, error: StepdiagError) -> str:
    """Return a code for a refusal without one: what was expected, without its figures."""
    words = re.sub(r"[0-9][0-9.]*|[|,;:()]", "", str(error.expected)).split()
    return f"{door}: expected {' '.join(words[:9])}"


def judged_surveys(
    seeds: Sequence[int], kind: Kind, *, workers: int = WORKERS, large: bool = False
) -> list[Judged]:
    """Judge the surveys of many seeds in processes of their own, each with one thread of linear
    algebra.

    With several workers the caller's main module is imported again: it needs ``if __name__ ==
    "__main__"``.
    """
    judge: Callable[[int], Judged] = partial(judge_survey, kind=kind, large=large)
    if workers < 2:
        return [judge(seed) for seed in seeds]
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        return list(pool.map(judge, seeds, chunksize=2))


def table(judged: Sequence[Judged]) -> str:
    """Return the table of false alarms of one distribution."""
    count = len(judged)
    counts = [
        Counter(code for one in judged for code in getattr(one, column)) for column in COLUMNS
    ]
    codes = sorted(
        {code for column in counts for code in column},
        key=lambda code: (*(-column[code] for column in counts), code),
    )
    rows = [(code, *(column[code] for column in counts)) for code in codes]
    rows.append(
        ("any", *(sum(bool(getattr(one, column)) for one in judged) for column in COLUMNS))
    )
    lines = [
        f"| {code} | {' | '.join(_share(each, count) for each in shares)} |"
        for code, *shares in rows
    ]
    return "\n".join(
        [
            "| finding | error: no export | warning | export refused by itself |",
            "|---|---|---|---|",
            *lines,
        ]
    )


def _share(part: int, of: int) -> str:
    return "0" if not part else f"{part} ({100 * part / max(of, 1):.1f} %)"


def promises(judged: Sequence[Judged]) -> str:
    """Return how many of the surveys that were not refused lie within what their result
    promised."""
    kept = [one for one in judged if not one.refused and one.before and one.after]
    stopped = sum(one.refused or bool(one.export) for one in judged)
    refused = len(judged) - len(kept)
    known = [one.after for one in judged if one.refused and one.after]
    lines = [
        f"refused by the solver: {_share(refused, len(judged))}",
        (
            "refused by the solver or by an export that accepts no warning: "
            f"{_share(stopped, len(judged))}"
        ),
        (
            "of the refused ones with a result, true rms after inside the interval: "
            f"{sum(one.inside for one in known)} of {len(known)}"
        ),
        f"{len(kept)} of {len(judged)} surveys not refused by the solver; of these:",
    ]
    for when in ("before", "after"):
        told = [getattr(one, when) for one in kept]
        inside, below = (
            sum(one.inside for one in told),
            sum(one.true < one.low for one in told),
        )
        lines.append(
            f"- {when}: true rms inside the interval {_share(inside, len(told))}, below it "
            f"{_share(below, len(told))}"
        )
    for kind in ("functions", "squareness", "scale"):
        values = [value for one in kept for value in one.within.get(kind, [])]
        lines.append(
            f"- {kind} within 2u: {_share(sum(values), len(values))} of {len(values)}"
        )
    return "\n".join(lines)


def print_false_alarms(
    count: int,
    first: int = FIRST_SEED,
    kinds: Sequence[Kind] = KINDS,
    *,
    workers: int = WORKERS,
    large: bool = False,
) -> None:
    """Print the table and the promises of the distributions, and the seeds of the refused surveys;
    ``large``: ordinary axes of 1 to 4 m."""
    for kind in kinds:
        judged = judged_surveys(
            range(first, first + count), kind, workers=workers, large=large
        )
        print(
            f"\n{kind}: {count} good surveys, seeds {first} to "
            f"{first + count - 1}\n\n{table(judged)}\n\n{promises(judged)}"
        )
        for one in judged:
            if one.refused:
                print(f"  refused: seed {one.seed}: {', '.join(one.errors)} ({one.about})")
