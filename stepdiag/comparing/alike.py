"""The check whether results can be compared, and remarks about their differences."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stepdiag.base.messages import Message, message
from stepdiag.base.result.basis import basis_of
from stepdiag.base.result.members import Budget, Facts
from stepdiag.base.result.result import Result
from stepdiag.daq.passes.survey_time import CODE as CLOCK
from stepdiag.solver.model.effects import TURNING

ALMOST = 0.01
"""Tolerance for the corners of two equal volumes, as a share of the shortest side."""
ALIKE = (*TURNING, "angle origin")
"""Sources of the uncertainty budget with the same effect in two surveys of a machine, for example
unmeasured angles; they do not affect the difference of two surveys."""
OF_INSTRUMENTS = ("air",)
"""Sources of the uncertainty budget with the same effect in two surveys with the same instruments:
wavelength and air sensor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Standing:
    """The facts of a result that decide whether it can be compared with another result; a missing
    text is empty.

    ``volume_mm`` contains origin and size, ``errors`` the codes of findings that are errors.
    """

    chain: str = ""
    machine_serial: str = ""
    lengths: str = ""
    compensation: str = ""
    instruments: str = ""
    volume_mm: tuple[float, ...] = ()
    increments: int = 0
    errors: tuple[str, ...] = ()
    undated: bool = False


_LENGTHS = {
    "as_measured": message("lengths-as-measured"),
    "at_20_c": message("lengths-at-20-c"),
}


def standing_of(result: Result) -> Standing:
    facts = result.survey or Facts()
    head = "head" if result.head_straightness else ""
    return Standing(
        chain=result.chain,
        machine_serial=facts.machine_serial,
        lengths=basis_of(result).tables or "",
        compensation=facts.compensation or "",
        instruments=", ".join(
            filter(None, (facts.instrument, facts.instrument_serial, facts.sensors, head))
        ),
        volume_mm=(*result.volume.origin_mm, *result.volume.size_mm),
        increments=result.volume.increments,
        errors=tuple(
            sorted({each.code for each in result.findings if each.severity == "error"})
        ),
        undated=any(
            (each.code, each.severity) == (CLOCK, "warning") for each in result.findings
        ),
    )


def apart(one: Standing, other: Standing) -> Message | None:
    """Return the reason why two results cannot be compared, such as another machine; None if they
    can. A fact counts only if both results contain it."""
    if _differ(one.machine_serial, other.machine_serial):
        return message(
            "differs-serial", expected=one.machine_serial, found=other.machine_serial
        )
    if _differ(one.chain, other.chain):
        return message("differs-chain", expected=one.chain, found=other.chain)
    expected, found = _LENGTHS.get(one.lengths), _LENGTHS.get(other.lengths)
    if expected is not None and found is not None and one.lengths != other.lengths:
        return message("differs-lengths", expected=expected, found=found)
    return None


def _differ(one: str, other: str) -> bool:
    return bool(one and other) and one != other


def remarks(one: Standing, other: Standing) -> Iterator[Message]:
    """Yield remarks about a comparison: doubts about a result, and differences of the results that
    do not prevent the comparison."""
    if one.volume_mm and other.volume_mm and not same_volume(one, other):
        yield message("remark-volumes")
    if _differ(one.instruments, other.instruments):
        yield message("remark-instruments", before=one.instruments, after=other.instruments)
    if one.increments and other.increments and one.increments != other.increments:
        yield message("remark-increments", before=one.increments, after=other.increments)
    if _differ(one.compensation, other.compensation):
        yield message(
            "remark-compensation", before=one.compensation, after=other.compensation
        )
    if found := (*one.errors, *other.errors):
        yield message("remark-errors", codes=tuple(dict.fromkeys(found)))


def same_volume(one: Standing, other: Standing) -> bool:
    sizes = [size for size in one.volume_mm[3:] if size > 0]
    return bool(
        np.allclose(
            one.volume_mm, other.volume_mm, rtol=0.0, atol=ALMOST * min(sizes, default=1.0)
        )
    )


def common_share(budget: Budget | None, name: str, *, same_instruments: bool) -> float:
    """Return the share of a quantity's standard uncertainty that is common to all surveys of the
    machine; 0 without a budget."""
    if budget is None or budget.combined.get(name, 0.0) <= 0.0:
        return 0.0
    sources = (*ALIKE, *OF_INSTRUMENTS) if same_instruments else ALIKE
    shares = budget.shares.get(name, {})
    return min(
        float(np.linalg.norm([shares.get(source, 0.0) for source in sources]))
        / budget.combined[name],
        1.0,
    )
