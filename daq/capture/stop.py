"""From a dwell and the laser's samples to a captured stop: the laser places the stop, Modbus names it."""

import math

import msgspec
import numpy as np

from stepdiag.daq.capture.captured_stop import CapturedStop, remarks_of
from stepdiag.daq.capture.place.route import Route, agrees
from stepdiag.daq.capture.standing.certain_window import MIN_SAMPLES, Taken, take
from stepdiag.daq.capture.standing.window import find_plateaus, summarise
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.survey.models import StopRules
from stepdiag.daq.timing.stream import StreamBuffer

PLATEAU_MARGIN_NS = 40_000_000
"""Left off the end of a plateau: its last bins may hold the start of the next move."""


def plateau_window(stream: StreamBuffer, from_ns: float, to_ns: float, expected_mm: float, rules: StopRules) -> Taken | None:
    """Return the laser's mean over the first plateau between two times whose level is the expected one, or None."""
    span = stream.span(from_ns, to_ns)
    for plateau in find_plateaus(span.time_ns, span.position_mm, rules.min_window_s):
        if agrees(plateau.level_mm - expected_mm, 0.0):
            end = plateau.to_ns - PLATEAU_MARGIN_NS
            begin = min(plateau.from_ns + rules.settle_s * 1e9, (plateau.from_ns + end) / 2)
            return take(stream.span(begin, end), begin, end, rules, stream.resolution_um)
    return None


def make_stop(route: Route, stop: int, signals: Signals, taken: Taken, head: StreamBuffer | None, wall_offset_ns: int) -> CapturedStop:
    """Return the stop that a window of the laser gives at a place of the route."""
    channels, u_channels = _head_means(head, taken)
    return CapturedStop(
        setup=route.setup,
        outward=route.outward,
        stop=stop,
        position_mm=signals.commanded_mm or route.planned_mm(stop),
        axis=route.axis_to(stop),
        stop_count=signals.stop_count,
        reading_mm=taken.window.mean_mm if math.isfinite(taken.window.mean_mm) else None,
        u_um=taken.window.u_um,
        scatter_um=taken.window.scatter_um,
        slope_um_s=taken.window.slope_um_s,
        samples=taken.window.used,
        rejected=taken.window.rejected,
        window_from_ns=round(taken.from_ns),
        window_to_ns=round(taken.to_ns),
        time_s=round((0.5 * (taken.from_ns + taken.to_ns) + wall_offset_ns) * 1e-9, 6),
        beam=taken.beam if math.isfinite(taken.beam) else None,
        doubts=remarks_of(taken.doubts),
        channels=channels,
        u_channels=u_channels,
        material_temperature_c=signals.material_temperature_c,
        air_temperature_c=signals.air_temperature_c,
        air_pressure_hpa=signals.air_pressure_hpa,
        relative_humidity_percent=signals.relative_humidity_percent,
    )


def make_head_stop(
    route: Route, stop: int, signals: Signals, taken: Taken, head: StreamBuffer, laser: StreamBuffer, wall_offset_ns: int
) -> CapturedStop:
    """Return the stop that a window of the head gives; its reading is the laser's mean over the same window, None where it sees nothing."""
    made = make_stop(route, stop, signals, taken, head, wall_offset_ns)
    seen = laser.span(taken.from_ns, taken.to_ns).position_mm
    reading = float(np.mean(seen)) if len(seen) >= MIN_SAMPLES and np.isfinite(seen).all() else None
    return msgspec.structs.replace(made, reading_mm=reading)


def _head_means(head: StreamBuffer | None, taken: Taken) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the means of the 4-DOF head's channels over the window and their standard uncertainties; empty without a head."""
    if head is None:
        return (), ()
    span = head.span(taken.from_ns, taken.to_ns)
    if span.channels is None or len(span.channels) < MIN_SAMPLES:
        return (), ()
    columns = [summarise(span.time_ns * 1e-9, column) for column in span.channels.T]
    return tuple(column.mean_mm for column in columns), tuple(column.u_um * 1e-3 for column in columns)
