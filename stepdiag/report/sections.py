"""The tables of the report, as rows of plain text that the template escapes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepdiag.base.conformity import COVERAGE
from stepdiag.base.findings import in_words
from stepdiag.base.messages import rendered
from stepdiag.base.readings.readings import Readings
from stepdiag.base.result.basis import basis_of
from stepdiag.base.result.interval import decimals_of, decimals_of_u, with_expanded
from stepdiag.base.result.members import VOLUME, Drift, Lengths, StandardFigures
from stepdiag.base.result.result import AXIS_LETTERS, DISPLACEMENTS, ROTATIONS, Result
from stepdiag.base.result.typed import written
from stepdiag.solver.methods.standard_figures import DIAGONAL_STANDARD
from stepdiag.solver.model.reported import SCALE_SUM
from stepdiag.texts.explained import finding_advice
from stepdiag.texts.setup_words import setup_words
from stepdiag.texts.texts import UNITS, Language

Standards = Mapping[str, Sequence[StandardFigures]]
SETUP_COLUMNS = (
    "kind",
    "passes",
    "stops",
    "tilt_mrad",
    "drift",
    "repeatability_um",
    "residual_um",
    "noise_um",
)
POSITIONING_FIGURES = {
    "E_up": "E↑",
    "R_up": "R↑",
    "A_up": "A↑",
    "E": "E",
    "B": "B",
    "M": "M",
    "R": "R",
    "A": "A",
}
"""The values of ISO 230-2 by their names in `solver.standards.iso230`, in the notation of the
standard."""
MOST_ROWS = 200
"""Largest number of rows of a table; a result of another program can contain more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table of the report: ``header`` may be empty; every cell is plain text."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]


def table_of(header: Sequence[str], rows: Sequence[Sequence[str]]) -> Table | None:
    return Table(header=header, rows=rows) if rows else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Remark:
    severity: str
    severity_word: str
    code: str
    text: str
    advice: str


def shown(value: object, decimals: int | None = None) -> str:
    """Return the text of a table's cell: numbers with a fixed number of decimals or four
    significant digits, lists joined, None as a dash."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        text = f"{value:.{decimals}f}" if decimals is not None else f"{value:.4g}"
        return text.replace("-", "−")
    if isinstance(value, list | tuple):
        return ", ".join(shown(item, decimals) for item in value[:MOST_ROWS])
    return str(value)


def machine_table(result: Result, words: Mapping[str, str]) -> Table:
    """Return a table of the measured volume, the kinematic chain, and the method of computation."""
    volume = result.volume
    rows = [
        (words["chain"], result.chain),
        (words["origin"], " / ".join(shown(v) for v in volume.origin_mm) + " mm"),
        (words["size"], " / ".join(shown(v) for v in volume.size_mm) + " mm"),
        (words["increments"], str(volume.increments)),
        (words["method"], result.method),
        (words["software"], f"{result.software.name} {result.software.version}"),
    ]
    return Table(header=(), rows=rows)


def conditions_table(
    result: Result, readings: Readings | None, words: Mapping[str, str]
) -> Table:
    """Return a table of the conditions of the survey: ``conditions`` of the result, and the values
    of the readings."""
    flat = [] if result.conditions is None else _leaves(written(result.conditions))
    rows = [(_readable(name, words), _from_to(value)) for name, value in flat[:MOST_ROWS]]
    measured = "material_temperature_c" in dict(flat)
    if readings is not None and not measured and np.isfinite(readings.temperature_c).any():
        low, high = (
            float(np.nanmin(readings.temperature_c)),
            float(np.nanmax(readings.temperature_c)),
        )
        rows.append((f"{words['material_temperature']} / °C", _from_to([low, high])))
    if readings is not None and np.isfinite(readings.time_s).any():
        rows.append(
            (
                words["duration"],
                (
                    f"{shown(float(np.ptp(readings.time_s[np.isfinite(readings.time_s)])) / 60, 1)} "  # noqa: E501
                    "min"
                ),
            )
        )
    return Table(header=(), rows=rows)


def _from_to(value: object) -> str:
    if (
        isinstance(value, list)
        and len(value) == 2
        and all(isinstance(item, int | float) for item in value)
    ):
        low, high = (shown(item, 2) for item in value)
        return low if low == high else f"{low} … {high}"
    return shown(value)


def setups_table(result: Result, words: Mapping[str, str], language: Language) -> Table:
    """Return a table with one row per setup: its passes, mirror tilt, drift and repeatability."""
    setups = dict(list(result.setups.items())[:MOST_ROWS])
    columns = [
        column
        for column in SETUP_COLUMNS
        if any(getattr(facts, column) not in (None, ()) for facts in setups.values())
    ]
    rows = [
        (
            setup_words(name, language),
            *(_setup_fact(getattr(facts, column), words) for column in columns),
        )
        for name, facts in setups.items()
    ]
    return Table(
        header=(words["setup"], *(_readable(column, words) for column in columns)), rows=rows
    )


def _setup_fact(value: object, words: Mapping[str, str]) -> str:
    if isinstance(value, tuple) and value and isinstance(value[0], Drift):
        worst = max(value, key=lambda drift: abs(drift.total_um))
        return f"{shown(worst.total_um, 2)} ± {shown(worst.u_um, 2)} µm"
    if isinstance(value, str):
        return words.get(f"fact_{value}", value)
    return shown(None if value == () else value, 3 if isinstance(value, float) else None)


def _leaves(facts: Mapping[str, Any], prefix: str = "") -> list[tuple[str, object]]:
    found: list[tuple[str, object]] = []
    for name, value in facts.items():
        if isinstance(value, dict):
            found += _leaves(value, f"{prefix}{name} ")
        else:
            found.append((f"{prefix}{name}", value))
    return found


def _readable(name: str, words: Mapping[str, str]) -> str:
    if heading := words.get(f"fact_{name.replace(' ', '_')}"):
        return heading
    head, _, unit = name.rpartition("_")
    return (
        f"{head.replace('_', ' ')} / {UNITS[unit]}"
        if head and unit in UNITS
        else name.replace("_", " ")
    )


def squareness_table(result: Result, words: Mapping[str, str]) -> Table:
    rows = []
    for name, quantity in result.squareness.items():
        value, u = _value_and_u(quantity.value, quantity.u)
        rows.append(
            (
                name,
                words[f"squareness_{name}"],
                words["not_identified"] if quantity.value is None else value,
                u,
                "µrad",
            )
        )
    return Table(
        header=(
            words["name"],
            words["between"],
            words["value"],
            words["expanded"],
            words["unit"],
        ),
        rows=rows,
    )


def scale_table(result: Result, words: Mapping[str, str]) -> Table:
    rows = []
    for name, scale in result.scale.items():
        value, u = _value_and_u(scale.value, scale.u)
        rows.append((name, value if scale.identified else words["not_identified"], u, "µm/m"))
    return Table(
        header=(words["axis"], words["value"], words["expanded"], words["unit"]), rows=rows
    )


def _value_and_u(value: float | None, u: float | None) -> tuple[str, str]:
    expanded = None if u is None else COVERAGE * u
    decimals = 2 if expanded is None else decimals_of_u(expanded)
    return shown(value, decimals), shown(expanded, decimals)


def even(value: float | None, expanded: float | None) -> str:
    """Return a value with its U (k = 2) as one cell; the value alone without U."""
    return (
        shown(value, 2)
        if value is None or expanded is None
        else with_expanded(value, expanded).replace("-", "−")
    )


def lengths_table(result: Result, words: Mapping[str, str]) -> Table | None:
    """Return a table of the scales as measured and at 20 C, each with its U. The heading marks the
    scales that the compensation tables contain. Return None for a result without both kinds of
    scales."""
    found = basis_of(result)
    if found.tables is None or not found.other:
        return None
    both = {found.tables: found.scales, found.beside: found.other}
    cells = {
        name: {axis: even(value, u) for axis, value, u in scales}
        for name, scales in both.items()
    }
    names: tuple[Lengths, ...] = ("as_measured", "at_20_c")
    header = (
        words["axis"],
        *(
            words[f"lengths_{name}"]
            + (f" ({words['in_tables']})" if name == found.tables else "")
            for name in names
        ),
    )
    return Table(
        header=header,
        rows=[
            (axis, *(cells[name].get(axis, shown(None)) for name in names))
            for axis in AXIS_LETTERS
        ],
    )


def positioning_table(
    standards: Standards, words: Mapping[str, str], language: Language
) -> Table | None:
    """Return a table of the values of ISO 230-2 and ISO 230-6 along axes and diagonals, with one
    row per setup and U (k = 2) where known.

    ``standards`` is the entry of the result; columns without a known value are left out. If some
    rows have lengths as measured and other rows have lengths at 20 C, each row contains the kind of
    its lengths (`positioning_lengths`).
    """
    first = {name: found[0] for name, found in standards.items() if found}
    known = {
        name: symbol
        for name, symbol in POSITIONING_FIGURES.items()
        if any(_figure(facts, name) is not None for facts in first.values())
    }
    once = positioning_lengths(standards, words)
    rows = [
        (
            setup_words(name, language),
            ", ".join(
                filter(
                    None,
                    (
                        _standard(facts.standard, words),
                        "" if once else _lengths(facts, words),
                    ),
                )
            ),
            shown(facts.runs),
            *(_with_u(facts, figure) for figure in known),
        )
        for name, facts in list(first.items())[:MOST_ROWS]
    ]
    figures = (f"{symbol} / µm" for symbol in known.values())
    header = (words["setup"], words["standard"], words["runs"], *figures)
    return table_of(header, rows) if known else None


def _standard(name: str, words: Mapping[str, str]) -> str:
    return words["on_step_diagonals"] if name == DIAGONAL_STANDARD["step"] else name


def positioning_lengths(standards: Standards, words: Mapping[str, str]) -> str:
    """Return the kind of lengths (as measured, at 20 C) of all values along axes and diagonals;
    empty if unknown or different."""
    lengths = {
        text for found in standards.values() if found and (text := _lengths(found[0], words))
    }
    return lengths.pop() if len(lengths) == 1 else ""


def _lengths(facts: StandardFigures, words: Mapping[str, str]) -> str:
    return {
        "as measured": words["figures_as_measured"],
        "at 20 C": words["figures_at_20_c"],
    }.get(facts.lengths or "", "")


VDI_FIGURES = {
    "P": "P",
    "Pa": "Pa",
    "U_max": "U max",
    "U_mean": "U̅",
    "Ps_max": "Ps max",
    "Ps_mean": "P̅s",
}
"""The values of VDI/DGQ 3441 by their names in `solver.standards.iso230`. The value U of this
standard is the reversal, not an uncertainty."""


def vdi_table(
    standards: Standards, words: Mapping[str, str], language: Language
) -> Table | None:
    """Return a table of the values of VDI/DGQ 3441, one row for each run with these values; None
    without such runs."""
    rows = []
    for name, found in list(standards.items())[:MOST_ROWS]:
        facts = next((one for one in found if one.standard.startswith("VDI")), None)
        if facts is not None:
            rows.append(
                (
                    setup_words(name, language),
                    facts.standard,
                    *(shown(getattr(facts, figure), 2) for figure in VDI_FIGURES),
                )
            )
    figures = (f"{symbol} / µm" for symbol in VDI_FIGURES.values())
    return table_of((words["setup"], words["standard"], *figures), rows)


def _figure(facts: StandardFigures, name: str) -> float | None:
    value: float | None = getattr(facts, name)
    return getattr(facts, f"{name}_d", None) if value is None else value


def _with_u(facts: StandardFigures, name: str) -> str:
    u = facts.U or {}
    return even(_figure(facts, name), u.get(name, u.get(f"{name}_d")))


HEAD_FIGURES = (
    "passes",
    "end_point_um",
    "least_squares_um",
    "minimum_zone_um",
    "u_um",
    "residual_um",
    "misclosure",
)


def head_table(result: Result, words: Mapping[str, str]) -> Table | None:
    """Return a table of the straightness measured by the 4-DOF head, one row per function, or None
    for a result without ``head_straightness``."""
    measured = result.head_straightness or {}
    rows = [
        (name, *(shown(getattr(facts, figure)) for figure in HEAD_FIGURES))
        for name, facts in measured.items()
    ]
    header = (words["name"], *(_readable(figure, words) for figure in HEAD_FIGURES))
    return table_of(header, rows)


def fit_table(result: Result, words: Mapping[str, str]) -> Table | None:
    """Return a table of the agreement of the readings with the model, or None for a result without
    ``fit`` and ``scale_sum_um``."""
    fit = {} if result.fit is None else written(result.fit)
    total = {} if result.scale_sum_um is None else written(result.scale_sum_um)
    known = [
        *fit.items(),
        *((f"scale sum {name}_um", value) for name, value in total.items()),
    ]
    rows = [
        (_readable(name, words), shown(value)) for name, value in known if value is not None
    ]
    return table_of((), rows)


def chi_square_words(result: Result, words: Mapping[str, str]) -> str:
    """Return chi-square with its degrees of freedom and its expected value for a valid model; empty
    for a result without them."""
    fit = result.fit
    if fit is None or fit.chi_square is None or not fit.degrees_of_freedom:
        return ""
    free = fit.degrees_of_freedom
    return words["chi_square_lead"].format(
        found=f"{fit.chi_square:.0f}", free=free, scatter=f"{2.0 * (2.0 * free) ** 0.5:.0f}"
    )


def unidentified(result: Result, words: Mapping[str, str]) -> list[str]:
    """Return, as texts, every quantity that the data do not determine: functions, squarenesses,
    scales."""
    functions = [
        f"{name}"
        for name in (*DISPLACEMENTS, *ROTATIONS)
        if name in result.errors and result.errors[name].value is None
    ]
    angles = [name for name in ROTATIONS if name not in result.errors]
    squareness = [
        f"{name} ({words[f'squareness_{name}']})"
        for name, q in result.squareness.items()
        if q.value is None
    ]
    scales = [
        f"{words['scale']} {name}"
        for name, scale in result.scale.items()
        if not scale.identified
    ]
    return [
        *scales,
        *squareness,
        *functions,
        *([f"{words['angles']}: {', '.join(angles)}"] if angles else []),
    ]


def remarks(result: Result, words: Mapping[str, str], language: Language) -> list[Remark]:
    order = {"error": 0, "warning": 1, "info": 2}
    return [
        Remark(
            severity=one.severity,
            severity_word=words[f"severity_{one.severity}"],
            code=one.code,
            text=in_words(one, language),
            advice=finding_advice(one.code, language),
        )
        for one in sorted(result.findings, key=lambda finding: order[finding.severity])
    ]


def history_table(
    result: Result, words: Mapping[str, str], language: Language
) -> Table | None:
    rows = [
        (one.code, rendered(one.words, language))
        for one in (result.history or ())[:MOST_ROWS]
    ]
    return table_of((words["history_code"], words["history_text"]), rows)


def recordings_table(result: Result, words: Mapping[str, str]) -> Table | None:
    """Return a table of the files from which the result was solved, each with the SHA-256 of its
    contents. Return None for a result without file names.

    Packing a log does not change its hash, so the report stays the same.
    """
    rows = [(one.name, one.sha256) for one in result.sources or ()]
    return table_of((words["file"], "SHA-256"), rows)


def slips_table(result: Result, words: Mapping[str, str], language: Language) -> Table | None:
    """Return a table of the largest slip of the laser count that can stay undetected, or None for a
    result without ``unseen_slip``."""
    rows = [
        (
            rendered(each.where, language),
            *(_size(um) for um in (each.half_um, each.nearly_um, each.volume_um)),
        )
        for each in result.unseen_slip or ()
    ]
    header = tuple(words[f"slips_{name}"] for name in ("place", "half", "nearly", "volume"))
    return table_of(header, rows)


def _size(um: float | None) -> str:
    return shown(um, None if um is None else decimals_of(um))


def budget_table(
    result: Result, units: Mapping[str, str], words: Mapping[str, str]
) -> Table | None:
    """Return a table of U (k = 2) of every quantity, with its three largest sources in percent of
    the square of U; None without a budget."""
    rows = []
    for quantity, sources in ({} if result.budget is None else result.budget.shares).items():
        total = sum(share**2 for share in sources.values())
        largest = sorted(sources.items(), key=lambda item: (-item[1], item[0]))[:3]
        named = [
            f"{source_words(source, words)} {100.0 * share**2 / total:.0f}\N{NO-BREAK SPACE}%"
            if total
            else shown(None)
            for source, share in largest
        ]
        unit = units.get(quantity) or units.get(quantity.split()[-1], "")
        title = quantity_words(quantity, words)
        expanded = COVERAGE * total**0.5
        rows.append(
            (
                title,
                f"{shown(expanded, decimals_of_u(expanded))} {UNITS.get(unit, unit)}",
                *named,
                *[""] * (3 - len(named)),
            )
        )
    header = (words["name"], words["expanded"], *(f"{place}." for place in (1, 2, 3)))
    return table_of(header, rows[:MOST_ROWS])


def quantity_words(quantity: str, words: Mapping[str, str]) -> str:
    """Return the name of a quantity of the budget: a function, its remainder, a scale, a
    squareness."""
    if quantity in (SCALE_SUM, VOLUME):
        return words["scale_sum" if quantity == SCALE_SUM else "quantity_volume"]
    kind, _, name = (
        f"scale {quantity}" if quantity in AXIS_LETTERS else quantity
    ).rpartition(" ")
    return words.get(f"quantity_{kind}", quantity).format(name=name)


def source_words(source: str, words: Mapping[str, str]) -> str:
    """Return the name of a source of the budget; a source of another version unchanged."""
    return words.get(f"source_{source.replace(' ', '_')}", source)


def assumptions_table(
    result: Result, words: Mapping[str, str], language: Language
) -> Table | None:
    """Return a table of the assumptions of each source of the budget, or None for a result without
    ``budget.assumptions``."""
    known = {} if result.budget is None else result.budget.assumptions
    rows = [
        (source_words(source, words), rendered(text, language))
        for source, text in list(known.items())[:MOST_ROWS]
    ]
    return table_of((), rows)
