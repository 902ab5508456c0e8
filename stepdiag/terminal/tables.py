"""Results, effects of compensation files and findings as tables for a terminal."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from rich.console import Console
from rich.table import Table

from stepdiag.base.conformity import COVERAGE
from stepdiag.base.findings import Finding, Severity
from stepdiag.base.messages import Message, message
from stepdiag.base.result.interval import decimals_of_u
from stepdiag.base.result.result import DISPLACEMENTS, Function, Result
from stepdiag.exporters.safety.verify import Prediction
from stepdiag.terminal.printable import printable
from stepdiag.terminal.viewer import empty_table, print_words, shown
from stepdiag.texts.texts import UNITS

MARKS: dict[Severity, Message] = {
    "error": message("mark-error"),
    "warning": message("mark-warning"),
    "info": message("mark-note"),
}

FEW_ALIKE = 2
"""Number of findings with the same code that are printed without ``verbose``, for example about the
tables of two axes."""
_PARTS = {
    "without rigid motion": message("without-rigid-motion"),
    "as it is": message("as-it-is"),
}


def print_tables(result: Result) -> None:
    """Print the tables of a result: error functions, squareness, scales and mirror tilts."""
    console = Console()
    volume = result.volume
    low, size = (
        " x ".join(f"{value:g}" for value in values)
        for values in (volume.origin_mm, volume.size_mm)
    )
    about = message(
        "table-volume",
        size=size,
        low=low,
        increments=volume.increments,
        chain=result.chain,
        method=result.method,
    )
    console.print(shown(about), markup=False, highlight=False)
    console.print(function_table(result))
    console.print(quantity_table(result))
    if any(facts.tilt_mrad is not None for facts in result.setups.values()):
        console.print(setup_table(result))


def print_findings(findings: Sequence[Finding], *, verbose: bool) -> None:
    """Print findings, the severest first. Without ``verbose``, notes are only counted. Of the
    findings with the same code, only the first `FEW_ALIKE` are printed, and the others are
    counted."""
    serious = [each for each in findings if each.severity != "info"]
    first = [
        each for at, each in enumerate(serious) if _alike(serious[:at], each) < FEW_ALIKE
    ]
    print_words(*finding_lines(findings if verbose else first))
    if verbose:
        return
    more = Counter(each.code for each in serious) - Counter(each.code for each in first)
    for code, count in more.items():
        print_words(message("more-alike", count=count, code=code))
    if notes := len(findings) - len(serious):
        print_words(message("notes-beside", count=notes))


def _alike(before: Sequence[Finding], found: Finding) -> int:
    return sum((each.code, each.severity) == (found.code, found.severity) for each in before)


def function_table(result: Result) -> Table:
    """Return one row per function: range of its shape (end-point line removed), value at its end,
    largest uncertainty, and its identified parts."""
    table = empty_table(message("table-functions"))
    for name in (
        *DISPLACEMENTS,
        *(name for name in result.errors if name not in DISPLACEMENTS),
    ):
        function = result.errors[name]
        table.add_row(
            name,
            *_function_row(name, function),
            style="" if function.value is not None else "dim",
        )
    return table


def _function_row(name: str, function: Function) -> tuple[str, str, str, str, str]:
    """Return the cells of a function's row after the cell with the name. A straightness function
    has no end value, because its end-point line is in the squareness."""
    if function.value is None:
        return "-", "-", "-", UNITS[function.unit], shown(message("identified-no"))
    end = float(function.value[-1] - function.value[0])
    along = (function.position_mm - function.position_mm[0]) / (
        function.position_mm[-1] - function.position_mm[0]
    )
    expanded = None if function.u is None else COVERAGE * float(np.max(function.u))
    known = shown(
        message("identified-yes")
        if function.slope_identified
        else message("identified-shape")
    )
    straightness = name in DISPLACEMENTS and name[1] != name[2]
    end_shown = _shown(end) if function.slope_identified and not straightness else "-"
    return (
        _shown(float(np.ptp(function.value - end * along))),
        end_shown,
        _shown(expanded),
        UNITS[function.unit],
        known,
    )


def quantity_table(result: Result) -> Table:
    """Return one row per squareness and scale, with expanded uncertainty."""
    table = empty_table(message("table-quantities"))
    numbers = [(name, q.value, q.u, UNITS[q.unit]) for name, q in result.squareness.items()]
    numbers += [
        (shown(message("scale-name", axis=axis)), scale.value, scale.u, UNITS[scale.unit])
        for axis, scale in result.scale.items()
    ]
    for name, value, u, unit in numbers:
        expanded = None if u is None else COVERAGE * u
        known = shown(
            message("identified-no") if value is None else message("identified-yes")
        )
        decimals = 2 if expanded is None else decimals_of_u(expanded)
        table.add_row(
            name,
            _shown(value, decimals),
            _shown(expanded, decimals),
            unit,
            known,
            style="dim" if value is None else "",
        )
    return table


def setup_table(result: Result) -> Table:
    """Return one row per setup: the tilt of the mirror, and the agreement of the readings."""
    table = empty_table(message("table-setups"))
    table.columns[0].no_wrap = True
    for name, facts in result.setups.items():
        table.add_row(
            shown(message("setup-named", setup=name)),
            *map(_shown, (facts.tilt_mrad, facts.repeatability_um, facts.residual_um)),
        )
    return table


def finding_lines(findings: Iterable[Finding]) -> Iterator[str]:
    """Yield one line per finding, the most serious first: its severity, its code, its sentence."""
    for severity, mark in MARKS.items():
        yield from (
            f"{shown(mark):<8}{printable(each.code)}: {shown(each.words)}"
            for each in findings
            if each.severity == severity
        )


def effect_table(prediction: Prediction) -> Table:
    """Return the volumetric error before and after, with and without the rigid motion of the
    volume, as intervals in um."""
    what = (
        message("effect-of-volume")
        if prediction.drawn.volume.solid
        else message("effect-of-axes")
    )
    table = empty_table(message("table-effect", what=what))
    for name, figures in prediction.predicted.parts().items():
        table.add_row(
            shown(message("effect-largest", part=_PARTS[name])),
            *(shown(each.largest_um.bound()) for each in figures.values()),
        )
        table.add_row(
            shown(message("effect-rms", part=_PARTS[name])),
            *(shown(each.rms_um.words()) for each in figures.values()),
        )
    return table


def conclusion_lines(
    words: Mapping[str, Sequence[str]], titles: Mapping[str, str]
) -> Iterator[str]:
    """Yield the conclusion section by section, each under its title; the keys of ``words`` and
    ``titles`` are the names of the sections."""
    for section, sentences in words.items():
        if sentences:
            yield titles[section]
            yield from (printable(f"  {sentence}") for sentence in sentences)


def _shown(value: float | None, decimals: int = 2) -> str:
    return "-" if value is None else shown(f"{value:.{decimals}f}")
