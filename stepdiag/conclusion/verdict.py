"""The verdict about the machine's tolerances in sentences, as found and as predicted with the files
of an export."""

from collections.abc import Iterator
from dataclasses import replace

from stepdiag.base.conformity import judged_volume, together
from stepdiag.base.result.interval import FieldFigures, Interval, with_expanded
from stepdiag.base.result.members import Conformity, Judged
from stepdiag.base.result.result import Result
from stepdiag.conclusion.intervals import Reach
from stepdiag.conclusion.sentences import Sentence, render
from stepdiag.texts.texts import UNITS, Language

STATES = ("as_found", "predicted")
SURE = 0.99
"""Largest probability that is shown; the probability comes from a few hundred draws."""


ROUNDING = 1e-4
"""Largest difference in um and urad between the two halves of a symmetric interval: the numbers in
the file are rounded."""


def judged_in(result: Result, exported: Reach | None = None) -> Conformity | None:
    """Return the conformity of a result, None without a tolerance.

    For the files of an export, only the volumetric values are predicted, because a file can leave
    out a function.
    """
    if (
        result.conformity is None
        or exported is None
        or exported.rms_after is None
        or exported.largest_after is None
    ):
        return result.conformity
    after = FieldFigures(rms_um=exported.rms_after, largest_um=exported.largest_after)
    if (
        result.predicted is not None
        and after == result.predicted.without_rigid_motion["after"]
    ):
        return result.conformity  # without files: the ideal compensation
    return replace(result.conformity, predicted=judged_volume(result.tolerance or {}, after))


def verdict_sentences(found: Conformity | None) -> Iterator[Sentence]:
    """Yield the verdict about the machine and about every value, as found and as predicted;
    nothing without a tolerance."""
    for state in STATES if found is not None else ():
        judged: tuple[Judged, ...] = getattr(found, state)
        if judged:
            verdict = together(one.verdict for one in judged)
            yield Sentence(
                key=f"verdict_{state}",
                arguments={"verdict": Sentence(key=f"verdict_{verdict}")},
            )
        yield from (_sentence(one) for one in judged)


def _sentence(one: Judged) -> Sentence:
    arguments: dict[str, str | Sentence] = {
        "quantity": _quantity(one),
        "limit": f"{one.tolerance:g}",
        "unit": UNITS[one.unit],
        "verdict": Sentence(key=f"verdict_{one.verdict}"),
    }
    if one.low is None or one.high is None or one.probability is None:
        return Sentence(key="verdict_unknown_figure", arguments=arguments)
    arguments["p"] = probability_words(one.probability)
    if figure := even_of(one):
        return Sentence(key="verdict_even", arguments={**arguments, "figure": figure})
    low, high = interval_of(one)
    return Sentence(key="verdict_figure", arguments={**arguments, "low": low, "high": high})


def even_of(one: Judged) -> str:
    """Return a value with a symmetric interval as value and U; empty for a skewed or unknown
    interval."""
    if (
        one.value is None
        or one.low is None
        or one.high is None
        or abs(one.low + one.high - 2.0 * one.value) > ROUNDING
    ):
        return ""
    return with_expanded(one.value, (one.high - one.low) / 2.0).replace("-", "−")


def interval_of(one: Judged) -> tuple[str, str]:
    """Return the ends of a value's coverage interval as texts; empty if unknown."""
    if one.low is None or one.high is None:
        return "", ""
    low, high = Interval(value_um=one.value or 0.0, low_um=one.low, high_um=one.high).shown()
    return low.replace("-", "−"), high.replace("-", "−")


def _quantity(one: Judged) -> Sentence:
    kind, _, of = one.quantity.partition(" ")
    match kind:
        case "volumetric_rms" | "volumetric_largest":
            return Sentence(key=f"quantity_{kind}")
        case "E" | "A":
            return Sentence(key="quantity_positioning", arguments={"symbol": kind, "run": of})
        case _:
            return Sentence(
                key="quantity_range" if kind[0] == "E" else "quantity_squareness",
                arguments={"name": kind},
            )


def quantity_words(one: Judged, language: Language) -> str:
    return render(_quantity(one), language)


def verdict_words(one: Judged, language: Language) -> str:
    return render(Sentence(key=f"verdict_{one.verdict}"), language)


def probability_words(p: float) -> str:
    """Return a probability in percent, limited to the resolution of the draws."""
    if p > SURE:
        return "> 99"
    return "< 1" if p < 1.0 - SURE else f"{100.0 * p:.0f}"
