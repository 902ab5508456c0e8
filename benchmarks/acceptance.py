"""How often is a machine accepted that stands exactly at its tolerance? ``python -m
benchmarks.acceptance --surveys 2000`` (an hour).

Every survey is solved in full: exact machines drawn from the assumed sizes
(`false_alarms.drawn_survey`), which share no code with the solver. The tolerance of each figure is
its own true value, so that "conform" is a false acceptance and "not conform" a false rejection.
Stated are at most 2.5 % of each (ISO 14253-1, guard band U).
"""

import argparse
from collections import Counter
from collections.abc import Iterator

import numpy as np

from benchmarks.exact import left_um, unmoved_um
from benchmarks.false_alarms import Drawn, drawn_survey
from stepdiag.base.conformity import SQUARENESS_URAD, with_tolerance
from stepdiag.base.errors import StepdiagError
from stepdiag.base.result.members import Judged, Verdict
from stepdiag.base.result.prediction import VOLUMETRIC_LARGEST, VOLUMETRIC_RMS
from stepdiag.base.result.result import POSITIONING, Result
from stepdiag.base.volume import anywhere_mm
from stepdiag.solver.methods.solve import solve
from testkit.rates.limits import volumes_at_their_limit

FIRST = 460_000
"""Seeds that nothing else draws."""
VERDICTS: tuple[Verdict, ...] = ("conform", "not_conform", "not_decidable")


def verdicts_at_the_limit(survey: Drawn, result: Result) -> Iterator[tuple[str, Verdict]]:
    """Yield a kind of figure with the verdict about it, for every figure, where the true value is
    the tolerance."""
    points = anywhere_mm(result.volume)
    true = survey.machine.error_at(points)
    largest = float(np.max(np.linalg.norm(unmoved_um(points, true), axis=1)))
    judged = _judged(
        result, {VOLUMETRIC_RMS: left_um(points, true), VOLUMETRIC_LARGEST: largest}
    )
    truth = survey.machine.truth(survey.box.increments)
    for name, value in truth.squareness_urad.items():
        judged += [
            one
            for one in _judged(result, {SQUARENESS_URAD: abs(value)})
            if one.quantity == name
        ]
    lines = {
        name: np.linspace(0.0, value[-1] - value[0], len(value))
        for name, value in truth.errors.items()
    }
    known = [
        name
        for name, found in result.errors.items()
        if name[1] in "XYZ" and found.value is not None
    ]
    free = [
        name
        for name in known
        if name not in POSITIONING or not result.errors[name].slope_identified
    ]
    judged += _judged(
        result,
        {
            name: float(np.ptp(truth.errors[name] - lines[name] * (name in free)))
            for name in known
        },
    )
    for one in judged:
        kind = (
            one.quantity
            if one.quantity.startswith("volumetric")
            else "squareness"
            if one.quantity[0] != "E"
            else "range of a function"
        )
        yield kind, one.verdict


def _judged(result: Result, tolerance: dict[str, float]) -> list[Judged]:
    conformity = with_tolerance(result, tolerance).conformity
    return [] if conformity is None else list(conformity.as_found)


def main() -> None:
    """Count and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--surveys", type=int, default=2000)
    parser.add_argument("--first", type=int, default=FIRST)
    given = parser.parse_args()
    accepted, rejected = volumes_at_their_limit(given.surveys)
    print(
        f"volume with an exact posterior: {given.surveys} machines: accepted "
        f"{100 * accepted:.2f} %, rejected {100 * rejected:.2f} %"
    )
    count: dict[str, Counter[Verdict]] = {}
    refused = 0
    for seed in range(given.first, given.first + given.surveys):
        survey = drawn_survey(seed, "stated")
        try:
            result = solve(survey.readings, chain=survey.chain, assumed=survey.assumed)
        except StepdiagError:
            refused += 1
            continue
        for kind, verdict in verdicts_at_the_limit(survey, result):
            count.setdefault(kind, Counter())[verdict] += 1
    print(
        f"{given.surveys} machines at their limit, seeds from {given.first}; {refused} surveys "
        "refused"
    )
    for kind, verdicts in count.items():
        total = verdicts.total()
        shares = ", ".join(
            f"{name} {verdicts[name]} ({100.0 * verdicts[name] / total:.2f} %)"
            for name in VERDICTS
        )
        print(f"{kind}: {total} figures: {shares}")


if __name__ == "__main__":
    main()
