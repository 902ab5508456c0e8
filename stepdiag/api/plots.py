"""The figures of the report as matplotlib figures (``stepdiag[notebook]``)."""

from typing import TYPE_CHECKING, Any

import numpy as np

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.base.names import AXES
from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.base.result.result import DISPLACEMENTS, ROTATIONS, Result
from stepdiag.report.drawings.space import lattice_mm
from stepdiag.texts.texts import UNITS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LATTICE = 5
"""Number of points per axis in a plot of the error field."""
_LONGEST_SHARE = 0.15
"""Length of the longest drawn error vector as a share of the longest side of the volume."""


def plot_functions(result: Result) -> "Figure":
    """Return a figure with one panel per identified function: the mean of both directions with U (k
    = 2), and both directions if the data contain them.

    Raises UsageError without matplotlib or without an identified function.
    """
    names = [name for name in (*DISPLACEMENTS, *ROTATIONS) if result.knows(name)]
    if not names:
        raise UsageError(
            "plot_functions", expected=message("known-function"), found=message("none")
        )
    figure = _figure(11.0, 2.6 * -(-len(names) // 3))
    for place, name in enumerate(names, 1):
        function, reversal = result.errors[name], result.reversal.get(name)
        panel = figure.add_subplot(-(-len(names) // 3), 3, place)
        at, value = function.position_mm, np.asarray(function.value)
        if function.u is not None:
            panel.fill_between(
                at, value - 2 * function.u, value + 2 * function.u, alpha=0.25, linewidth=0
            )
        panel.plot(at, value)
        if (
            reversal is not None
            and reversal.value is not None
            and np.array_equal(reversal.position_mm, at)
        ):
            panel.plot(at, value + reversal.value / 2, linestyle=":")
            panel.plot(at, value - reversal.value / 2, linestyle=":")
        panel.set_xlabel(f"{name[2]} / mm")
        panel.set_ylabel(f"{name} / {UNITS[function.unit]}")
        panel.grid(alpha=0.3)
    return figure


def plot_field(result: Result) -> "Figure":
    """Return a figure of the error vectors in the volume, rigid motion removed. The title contains
    the length of the longest vector.

    Raises UsageError without matplotlib.
    """
    figure = _figure(7.0, 6.0)
    points = lattice_mm(result.volume, LATTICE)
    errors = without_rigid_motion(result.volume, points, error_field_um(result, points))
    length = np.linalg.norm(errors, axis=1)
    drawn = errors * (
        _LONGEST_SHARE * max(result.volume.size_mm) / max(float(length.max()), 1e-9)
    )
    panel: Any = figure.add_subplot(projection="3d")
    panel.quiver(*points.T, *drawn.T, length=1.0)
    panel.set_box_aspect(result.volume.size_mm)
    panel.set(
        xlabel="X / mm", ylabel="Y / mm", zlabel="Z / mm", title=f"max {length.max():.1f} µm"
    )
    return figure


def plot_closure(result: Result) -> "Figure":
    """Return a figure of the closure of the four diagonals by axis and node, in um.

    Raises UsageError without matplotlib or for a result without a closure.
    """
    if result.closure_um is None:
        raise UsageError(
            "plot_closure", expected=message("result-with-closure"), found=message("none")
        )
    figure = _figure(7.0, 3.5)
    panel = figure.add_subplot()
    for axis in AXES:
        values = np.array(getattr(result.closure_um, axis), dtype=np.float64)
        panel.plot(np.arange(len(values)), values, label=axis.upper())
    panel.set(ylabel="µm")
    panel.legend()
    panel.grid(alpha=0.3)
    return figure


def _figure(width_in: float, height_in: float) -> "Figure":
    try:
        from matplotlib.figure import Figure
    except ImportError:
        remedy = message("do-install", extra="notebook")
        raise UsageError(
            "plot", expected="matplotlib", found=message("nothing"), remedy=remedy
        ) from None
    return Figure(figsize=(width_in, height_in), layout="constrained")
