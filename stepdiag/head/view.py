"""The 4-DOF head on a terminal and in charts: live spots, tables of the commissioning and of the
tests."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np
from rich.box import SIMPLE
from rich.console import Console
from rich.live import Live
from rich.table import Table

from stepdiag.base.messages import message
from stepdiag.base.result.result import DISPLACEMENTS
from stepdiag.base.volume import Vector
from stepdiag.daq.timing.samples import Flag, Samples
from stepdiag.fourdof.commission import HeadCommissioned
from stepdiag.fourdof.commissioning import Calibrated
from stepdiag.fourdof.record import HeadRecord
from stepdiag.report.drawings.charts import Series, line_chart
from stepdiag.solver.fourdof.statistics import Arm, Comparison, Stability
from stepdiag.solver.model.angles import Angles
from stepdiag.solver.model.lateral import MeasuredStraightness
from stepdiag.solver.standards.straightness import LineMethod, straightness_um
from stepdiag.terminal.viewer import empty_table, print_words, shown
from stepdiag.texts.texts import UNITS

DETECTORS = ("QD", "PSD1", "PSD2")
BAR = 6
"""Half the width, in characters, of the bar that shows the place of a spot."""
REFRESH_HZ = 10
LINES: tuple[LineMethod, ...] = ("end-point", "least-squares", "minimum-zone")
PAPER_UM, PAPER_ARCSEC = 1.5, 1.5
"""Largest residual of the published head in um and in arc-seconds (Feng 2008, abstract)."""


class AlignView:
    """A display of the spots and sums of the newest samples, drawn ten times per second."""

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or Console()
        self._live: Live | None = None
        self._fullest = np.zeros(len(DETECTORS))

    @contextmanager
    def live(self) -> Iterator[None]:
        with Live(
            empty_table(message("waiting-for-head")),
            console=self._console,
            refresh_per_second=REFRESH_HZ,
        ) as live:
            self._live = live
            yield
        self._live = None

    def take(self, batch: Samples) -> None:
        if self._live is not None and batch.channels is not None:
            flags = int(np.bitwise_or.reduce(batch.flags))
            self._live.update(self.table(batch.channels.mean(axis=0), flags))

    def show_last(self, record: HeadRecord) -> None:
        last = record.channels[record.time_s >= record.time_s[-1] - 1.0]
        self._console.print(self.table(last.mean(axis=0), 0))

    def table(self, channels: Vector, flags: int) -> Table:
        """Return a table with one row per detector: place of the spot from -1 to 1 as number and
        bar, sum, and sum relative to the highest sum."""
        flagged = ", ".join(
            name.lower().replace("_", " ")
            for flag, name in ((flag, str(flag.name)) for flag in Flag)
            if flags & flag
        )
        table = empty_table(
            message("table-spots", what=flagged or message("all-samples-good"))
        )
        table.box = SIMPLE
        for column in table.columns:
            column.no_wrap = True
        for index in range(len(channels) // 3):
            x, y, total = channels[3 * index : 3 * index + 3]
            self._fullest[index] = max(self._fullest[index], total)
            place = (x / total, y / total) if total > 0 else (np.nan, np.nan)
            share = (
                f"{100 * total / self._fullest[index]:.0f} %"
                if self._fullest[index] > 0
                else shown(message("spot-dark"))
            )
            cells = [cell for value in place for cell in (f"{value:+.4f}", _bar(value))]
            table.add_row(DETECTORS[index], *cells, f"{total:.6g}", share)
        return table


def _bar(value: float) -> str:
    cells = ["-"] * (2 * BAR + 1)
    cells[BAR] = "|"
    if np.isfinite(value):
        cells[BAR + int(np.clip(round(value * BAR), -BAR, BAR))] = "O"
    return "".join(cells)


def commission_table(done: HeadCommissioned) -> None:
    """Print one row per field of the calibration file that the commissioning determined: its value
    and its U (k = 2)."""
    table = empty_table(message("table-commissioned"))
    for name, value, u in zip(
        done.file.uncertainty.of, done.found.value, done.file.uncertainty.u, strict=True
    ):
        table.add_row(name, f"{value:+.5g}", f"{2 * u:.2g}")
    Console().print(table)
    print_words(
        message(
            "commissioned-by",
            stands=done.stands,
            dark=done.dark,
            miss_um=2 * done.found.u_jog_um,
        )
    )


def calibration_table(fits: Mapping[str, Calibrated]) -> None:
    """Print one row per detector axis: range, residuals, uncertainty, and whether the residuals are
    smaller than those of the published head."""
    table = empty_table(message("table-calibration"))
    for name, each in fits.items():
        low, high = each.limits
        reach = f"{each.run.reference.min():g} .. {each.run.reference.max():g}"
        inside = max(-low, high) <= (PAPER_UM if each.run.unit == "um" else PAPER_ARCSEC)
        figures = (
            f"{low:+.2f}",
            f"{high:+.2f}",
            UNITS[each.run.unit],
            f"{each.fit.curve.u_um:.2f}",
        )
        table.add_row(
            name,
            reach,
            *figures,
            shown(message("identified-yes" if inside else "identified-no")),
        )
    Console().print(table)


def calibration_charts(fits: Mapping[str, Calibrated]) -> list[str]:
    drawn = []
    for name, each in fits.items():
        order = np.argsort(each.run.reference)
        series = Series(label=name, x=each.run.reference[order], y=each.residual[order])
        label, unit = shown(message("chart-residual", name=name)), UNITS[each.run.unit]
        drawn.append(
            line_chart(
                [series],
                label=label,
                x_label=shown(message("axis-of-reference", name=name, unit=unit)),
                y_label=shown(message("axis-of-residual", unit=unit)),
            )
        )
    return drawn


def stability_table(found: Mapping[str, Stability]) -> None:
    """Print one row per quantity: fluctuation (largest minus smallest value) raw and compensated,
    the removed part, standard deviations."""
    table = empty_table(message("table-stability"))
    table.columns[0].no_wrap = True
    for name, each in found.items():
        figures = (each.raw_fluctuation, each.compensated_fluctuation)
        removed = f"{each.removed_percent:.0f} %"
        table.add_row(
            name,
            *(f"{value:.2f}" for value in figures),
            removed,
            f"{each.raw_s:.3f}",
            f"{each.compensated_s:.3f}",
            _unit(name),
        )
    Console().print(table)


def allan_charts(found: Mapping[str, Stability]) -> list[str]:
    """Return a chart for each quantity: the Allan deviation, raw and compensated, over the
    averaging time."""
    drawn = []
    for name, each in found.items():
        octaves = np.log10(each.tau_s)
        series = [
            Series(label=shown(message("chart-raw")), x=octaves, y=each.raw_allan),
            Series(
                label=shown(message("chart-compensated")), x=octaves, y=each.compensated_allan
            ),
        ]
        y_label = f"{name} / {_unit(name)}"
        drawn.append(
            line_chart(
                series,
                label=shown(message("chart-allan", name=name)),
                x_label=shown(message("axis-of-averaging")),
                y_label=y_label,
            )
        )
    return drawn


def head_table(straight: Sequence[MeasuredStraightness], angles: Angles) -> None:
    """Print one row per function: straightness by the three reference lines, or the range of an
    angle, with U (k = 2)."""
    table = empty_table(message("table-head"))
    for one in straight:
        lines = (
            f"{straightness_um(one.position_mm, one.value_um, line):.2f}" for line in LINES
        )
        table.add_row(one.name, *lines, "-", f"{2 * float(np.max(one.u_um)):.2f}", "µm")
    for name, known in angles.items():
        spread = f"{float(np.ptp(known.value_urad)):.2f}"
        table.add_row(
            name,
            *("-" for _ in LINES),
            spread,
            f"{2 * float(np.max(known.u_urad)):.2f}",
            "µrad",
        )
    Console().print(table)


def comparison_table(found: Mapping[str, Comparison]) -> None:
    table = empty_table(message("table-head-reference"))
    for name, each in found.items():
        figures = (f"{each.lowest:+.2f}", f"{each.highest:+.2f}", f"{each.rms:.2f}")
        table.add_row(name, str(len(each.position_mm)), *figures, _unit(name))
    Console().print(table)


def arm_lines(arms: Mapping[str, Arm]) -> Iterator[str]:
    """Yield, for every axis, the place of one head relative to the other head (with U, k = 2), and
    the rms effect of this distance on the functions."""
    for axis, arm in arms.items():
        offsets = zip("xyz", arm.mm, arm.u_mm, strict=True)
        places = ", ".join(
            f"{letter} {mm:+.1f} mm (U {2 * u:.1f})"
            for letter, mm, u in offsets
            if np.isfinite(mm)
        )
        left = ", ".join(f"{name} {arm.rms_um(name):.2f} µm" for name in arm.residual_um)
        yield shown(message("head-arm", axis=axis, places=places, left=left))


def comparison_charts(found: Mapping[str, Comparison]) -> list[str]:
    return [
        line_chart(
            [Series(label=name, x=each.position_mm, y=each.residual)],
            label=shown(message("chart-head-reference", name=name)),
            x_label="position / mm",
            y_label=f"{name} / {_unit(name)}",
        )
        for name, each in found.items()
    ]


def _unit(name: str) -> str:
    return "µm" if name in DISPLACEMENTS or name.startswith("straightness") else "arcsec"
