"""Figures of the measured deviations of every setup, without a model."""

from collections.abc import Mapping

import numpy as np

from stepdiag.base.readings.readings import Readings
from stepdiag.base.result.result import Result
from stepdiag.report.drawings import charts
from stepdiag.report.drawings.charts import Series
from stepdiag.report.drawings.figure import Figure, csv_table
from stepdiag.solver.methods.standard_figures import way_mm
from stepdiag.solver.model.layout import Layout, lay_out
from stepdiag.texts.setup_words import setup_words
from stepdiag.texts.texts import Language


def layout_of(readings: Readings, result: Result) -> Layout:
    """Return the readings with the geometry of the result's volume. Raises ``DataError`` for
    readings of another survey."""
    return lay_out(readings, "readings", result.volume)


def setup_figures(
    layout: Layout, words: Mapping[str, str], language: Language
) -> list[Figure]:
    """Return a figure per setup: deviation over the distance along the beam, one line per pass. If
    the laser was set to zero before a return pass, the line of this pass begins at the end of the
    line of the outward pass."""
    return [
        _setup_figure(layout, index, setup.name, words, language)
        for index, setup in enumerate(layout.setups)
    ]


def _setup_figure(
    layout: Layout, index: int, name: str, words: Mapping[str, str], language: Language
) -> Figure:
    rows = np.flatnonzero(layout.setup_index == index)
    way = way_mm(layout, rows)
    lines, far, zero = [], 0.0, -1
    for number in np.unique(layout.pass_index[rows]).tolist():
        mine = rows[layout.pass_index[rows] == number]
        key = layout.passes[number]
        deviation = layout.deviation_um[mine] + (
            0.0 if key.outward or layout.zero_index[mine[0]] == zero else far
        )
        far, zero = (
            (float(deviation[-1]), int(layout.zero_index[mine[-1]]))
            if key.outward
            else (far, zero)
        )
        label = f"{key.number}: {words['outward' if key.outward else 'return']}"
        lines.append(Series(label=label, x=way[np.isin(rows, mine)], y=deviation))
    title = setup_words(name, language)
    drawing = charts.line_chart(
        lines, label=title, x_label=words["way"], y_label=words["deviation"]
    )
    columns = np.column_stack(
        [layout.stop[rows], way, layout.deviation_um[rows], layout.u_um[rows]]
    ).tolist()
    table = [
        (layout.passes[number].number, *row)
        for number, row in zip(layout.pass_index[rows].tolist(), columns, strict=True)
    ]
    return Figure(
        name=f"setup-{name}",
        title=title,
        drawing=drawing,
        table=csv_table(["pass", "stop", "way_mm", "deviation_um", "u_um"], table),
    )
