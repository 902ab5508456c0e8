"""The figures of the report from a result: error functions, error field, closure."""

from collections.abc import Callable
from typing import Any

import numpy as np

from stepdiag.base.names import AXES
from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.base.result.result import DISPLACEMENTS, ROTATIONS, Function, Result
from stepdiag.base.volume import Vector
from stepdiag.report.drawings import charts, slices, space
from stepdiag.report.drawings.charts import Series
from stepdiag.report.drawings.figure import Figure, csv_table
from stepdiag.texts.texts import UNITS

Correction = Callable[[Vector], Vector]
"""A function from commanded points (N, 3) in mm to the displacement of the tool by the control's
tables, (N, 3) in um."""


def function_figures(result: Result, words: dict[str, str]) -> list[Figure]:
    """Return one figure per identified function, displacements first, in the order of the axes."""
    names = [name for name in (*DISPLACEMENTS, *ROTATIONS) if result.knows(name)]
    return [_function_figure(name, result, words) for name in names]


def _function_figure(name: str, result: Result, words: dict[str, str]) -> Figure:
    function, reversal = result.errors[name], result.reversal.get(name)
    lines = _function_lines(function, reversal, words)
    unit = UNITS[function.unit]
    title = name if function.slope_identified else f"{name} ({words['shape_only']})"
    drawing = charts.line_chart(
        lines, label=title, x_label=f"{name[2]} / mm", y_label=f"{name} / {unit}"
    )
    header = [f"{name[2].lower()}_mm"]
    columns: list[Vector] = [function.position_mm]
    for line, suffix in zip(lines, ("", "_approach_plus", "_approach_minus"), strict=False):
        header += [f"{name}{suffix}_{function.unit}", f"u{suffix}_{function.unit}"]
        columns += [line.y, line.u if line.u is not None else np.full(len(line.y), np.nan)]
    return Figure(
        name=name,
        title=title,
        drawing=drawing,
        table=csv_table(header, np.column_stack(columns).tolist()),
    )


def _function_lines(
    function: Function, reversal: Function | None, words: dict[str, str]
) -> list[Series]:
    assert function.value is not None
    mean = Series(label=words["mean"], x=function.position_mm, y=function.value, u=function.u)
    if (
        reversal is None
        or reversal.value is None
        or not np.array_equal(reversal.position_mm, function.position_mm)
    ):
        return [mean]
    half = reversal.value / 2
    approaches = ((words["approach_plus"], half), (words["approach_minus"], -half))
    return [
        mean,
        *(
            Series(label=label, x=function.position_mm, y=function.value + part)
            for label, part in approaches
        ),
    ]


def field_statistics(errors_um: Vector) -> tuple[float, float]:
    """Return the root mean square and the largest length of error vectors, in um."""
    lengths = np.linalg.norm(errors_um, axis=1)
    return float(np.sqrt(np.mean(lengths**2))), float(lengths.max())


def volumetric_errors(
    result: Result, correction: Correction | None, count: int
) -> list[Vector]:
    """Return the error before and, with a correction, after compensation, rigid motion removed,
    each (count**3, 3) in um."""
    points = space.lattice_mm(result.volume, count)
    before = error_field_um(result, points)
    fields = [before] if correction is None else [before, before + correction(points)]
    return [without_rigid_motion(result.volume, points, field) for field in fields]


def field_figures(
    result: Result, correction: Correction | None, words: dict[str, str]
) -> list[Figure]:
    """Return a figure of the error field before and, with a correction, after compensation, with
    the same magnification and colours."""
    fields = volumetric_errors(result, correction, space.LATTICE)
    longest = max(field_statistics(field)[1] for field in fields)
    points = space.lattice_mm(result.volume)
    figures = []
    for name, title, errors in zip(
        ("field-before", "field-after"),
        (words["before"], words["after"]),
        fields,
        strict=False,
    ):
        drawing = space.field_drawing(result.volume, errors, longest_um=longest, label=title)
        header = ["x_mm", "y_mm", "z_mm", "dx_um", "dy_um", "dz_um"]
        table = csv_table(header, np.column_stack([points, errors]).tolist())
        (x, y, z), _ = slices.worst_point(result.volume, errors)
        where = words["worst"].format(x=f"{x:.0f}", y=f"{y:.0f}", z=f"{z:.0f}")
        factor = f"{space.magnification(result.volume, longest):.0f}"
        caption = f"{title}: {where}; {words['magnified'].format(factor=factor)}"
        figures.append(Figure(name=name, title=caption, drawing=drawing, table=table))
        planes = slices.slices_drawing(
            result.volume, errors, longest_um=longest, label=f"{title}, {words['slices']}"
        )
        figures.append(
            Figure(
                name=f"{name}-slices",
                title=f"{title}, {words['slices']}",
                drawing=planes,
                table=table,
            )
        )
    return figures


def closure_figures(result: Result, words: dict[str, str]) -> list[Figure]:
    """Return the figure of the closure residual ppp - npp - pnp - ppn by axis and node; none for a
    result without the residual."""
    closure = result.closure_um
    if closure is None:
        return []
    columns = [np.array(getattr(closure, axis)) for axis in AXES]
    lines = [
        Series(label=axis.upper(), x=np.arange(len(y), dtype=np.float64), y=y)
        for axis, y in zip(AXES, columns, strict=True)
    ]
    drawing = charts.line_chart(
        lines, label=words["closure"], x_label=words["node"], y_label="µm"
    )
    rows = [
        (line.label, int(node), value)
        for line in lines
        for node, value in zip(line.x, line.y.tolist(), strict=True)
    ]
    return [
        Figure(
            name="closure",
            title=words["closure"],
            drawing=drawing,
            table=csv_table(["axis", "node", "closure_um"], rows),
        )
    ]


def field_of(result: Result, correction: Correction | None) -> dict[str, Any] | None:
    """Return lattice points in mm, and the error at these points in um, rigid motion removed:
    before a correction, and after it (None without a correction).

    Return None for a survey of less than three axes. ``longest_um`` is the length of the longest
    vector, which scales both drawings.
    """
    if not result.volume.solid:
        return None
    fields = volumetric_errors(result, correction, space.LATTICE)
    after = fields[1].tolist() if len(fields) > 1 else None
    longest = max(field_statistics(field)[1] for field in fields)
    return {
        "points_mm": space.lattice_mm(result.volume).tolist(),
        "before_um": fields[0].tolist(),
        "after_um": after,
        "longest_um": longest,
    }
