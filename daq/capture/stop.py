"""From a dwell and the laser's samples to a captured stop: the laser places the stop, Modbus names it."""

import math
from dataclasses import dataclass, replace
from typing import Protocol

import msgspec
import numpy as np

from stepdiag.daq.capture.dwell import Dwell
from stepdiag.daq.capture.route import Route, agrees
from stepdiag.daq.capture.steadiness import against_itself
from stepdiag.daq.capture.window import RESOLUTION_FLOOR_UM, Window, find_plateaus, summarise
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.survey.models import StopRules
from stepdiag.daq.timing.stream import ARRIVAL_SLACK_NS, Break, Span, StreamBuffer

MIN_SAMPLES = 3
"""Fewer say nothing of their own scatter. A polled display gives no more in a short dwell."""
PLATEAU_MARGIN_NS = 40_000_000
"""Left off the end of a plateau: its last bins may hold the start of the next move."""


class CapturedStop(msgspec.Struct, frozen=True, kw_only=True):
    """One stop of a pass, as it goes into the log and from there to the readings.

    ``position_mm`` is the commanded position as the machine gave it, as planned where it gives none. ``reading_mm`` is what the laser
    says, sign applied, in its own length unit before any air correction, None where it sees nothing.
    ``u_um`` is the standard uncertainty of the window's mean (of the QD's lateral movement in a run of the 4-DOF head). ``broken`` says
    why the laser's count does not reach back to the stop before, ``unwatched`` why it may not; ``doubtful`` why a person should look
    (``doubt_codes``: the findings that say so, where it is not `stop-doubtful`); ``refused`` (a finding's code) why the reading must not be
    used; ``held`` names the conditions whose last credible value stands in for them. ``channels`` are the means of the 4-DOF head.
    """

    setup: str
    outward: bool
    stop: int
    position_mm: tuple[float, float, float]
    axis: str
    stop_count: int | None
    reading_mm: float | None
    u_um: float
    scatter_um: float
    slope_um_s: float
    samples: int
    rejected: int
    window_from_ns: int
    window_to_ns: int
    time_s: float
    """Middle of the window, seconds since 1970."""
    beam: float | None
    broken: str = ""
    unwatched: str = ""
    doubtful: str = ""
    doubt_codes: tuple[str, ...] = ()
    refused: str = ""
    recovered: bool = False
    channels: tuple[float, ...] = ()
    u_channels: tuple[float, ...] = ()
    material_temperature_c: float | None = None
    air_temperature_c: float | None = None
    air_pressure_hpa: float | None = None
    relative_humidity_percent: float | None = None
    held: tuple[str, ...] = ()


def marked(stop: CapturedStop, code: str, words: str) -> CapturedStop:
    """Return a stop that is doubtful for one more reason."""
    before = stop.doubt_codes or (("stop-doubtful",) if stop.doubtful else ())
    doubtful = "; ".join(text for text in (stop.doubtful, words) if text)
    return msgspec.structs.replace(stop, doubtful=doubtful, doubt_codes=tuple(dict.fromkeys((*before, code))))


class Placing(Protocol):
    """The stream that places a stop: the laser's, or `daq.capture.head_stop.QdView` in a run of the 4-DOF head."""

    @property
    def breaks(self) -> list[Break]: ...
    @property
    def resolution_um(self) -> float: ...

    def newest_ns(self) -> float: ...
    def span(self, from_ns: float, to_ns: float, arrived_before_ns: float = math.inf) -> Span: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Taken:
    """A window of readings: the statistics, its bounds, and what is doubtful about it."""

    window: Window
    from_ns: float
    to_ns: float
    beam: float
    doubtful: str = ""
    codes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Part:
    """A part of a dwell in which all readings share a zero: those that were taken in it and came before the loss that ends it."""

    from_ns: float
    to_ns: float
    arrived_before_ns: float = math.inf

    def span(self, stream: Placing, from_ns: float) -> Span:
        """Return the usable samples of this part from a time on."""
        return stream.span(from_ns, self.to_ns, self.arrived_before_ns)


def unbroken_parts(stream: Placing, dwell: Dwell) -> list[Part]:
    """Return a dwell cut where the count was lost, or may have been; at least one part, each ending with its last sample.

    A loss is known by the arrival of the chunk that shows it. Samples from after it may be in that chunk and have been taken before the
    dwell's end though they came later than that: they belong to no part.
    """
    latest_ns = dwell.to_ns + ARRIVAL_SLACK_NS
    cuts = sorted({event.time_ns for event in stream.breaks if dwell.from_ns < event.time_ns <= latest_ns})
    parts: list[Part] = []
    begin = dwell.from_ns
    for cut in cuts:
        seen = Part(begin, min(cut - 1, dwell.to_ns), cut)
        taken_ns = seen.span(stream, begin).time_ns
        parts.append(replace(seen, to_ns=float(taken_ns[-1]) if len(taken_ns) else begin))
        begin = cut
        if begin > dwell.to_ns:
            return parts
    return [*parts, Part(begin, dwell.to_ns)]


def certain_windows(stream: Placing, dwell: Dwell, rules: StopRules) -> list[Taken]:
    """Return the means over the certain part of a dwell.

    One is the rule. Where the count was lost in the dwell there may be one before and one after: the machine stood all the while, so they
    tell by how much the count went wrong. Before a loss only a window without any doubt counts, unless there is no other.
    """
    *before, last = unbroken_parts(stream, dwell)
    earlier = [taken for part in before if (taken := certain_window(stream, part, rules)) is not None]
    sure = [taken for taken in earlier if not taken.doubtful]
    taken = certain_window(stream, last, rules)
    return [*sure, taken] if taken is not None else sure or earlier[-1:]


def certain_window(stream: Placing, part: Part, rules: StopRules) -> Taken | None:
    """Return the stream's mean over a part of a dwell, or None where no usable sample lies in it.

    The first ``settle_s`` are left out. If the rest is not yet steady, later parts of it are tried while they are long enough. A step in
    the rest, or a value that is frozen, makes the stop doubtful whichever part is taken.
    """
    start = part.from_ns + rules.settle_s * 1e9
    span = part.span(stream, start)
    whole = _take(span, start, part.to_ns, rules, stream.resolution_um)
    if whole is None:
        return None
    return _doubted(_steadiest(stream, part, whole, rules), against_itself(span.position_mm, whole.window, stream.resolution_um))


def _steadiest(stream: Placing, part: Part, whole: Taken, rules: StopRules) -> Taken:
    """Return the longest steady end of a part of a dwell; all of it where none is long enough."""
    length = part.to_ns - whole.from_ns
    for left_out in (0.0, 0.25, 0.5, 0.75):
        begin = whole.from_ns + left_out * length
        if left_out and part.to_ns - begin < rules.min_window_s * 1e9:
            break
        taken = _take(part.span(stream, begin), begin, part.to_ns, rules, stream.resolution_um) if left_out else whole
        if taken is None or not _unsteady(taken.window, rules):
            return taken or whole
    return whole


def _doubted(taken: Taken, doubts: list[tuple[str, str]]) -> Taken:
    words = [text for text in (taken.doubtful, *(text for _, text in doubts)) if text]
    codes = (*(("stop-doubtful",) if taken.doubtful else ()), *(code for code, _ in doubts))
    return replace(taken, doubtful="; ".join(words), codes=tuple(dict.fromkeys(codes)))


def plateau_window(stream: StreamBuffer, from_ns: float, to_ns: float, expected_mm: float, rules: StopRules) -> Taken | None:
    """Return the laser's mean over the first plateau between two times whose level is the expected one, or None."""
    span = stream.span(from_ns, to_ns)
    for plateau in find_plateaus(span.time_ns, span.position_mm, rules.min_window_s):
        if agrees(plateau.level_mm - expected_mm, 0.0):
            end = plateau.to_ns - PLATEAU_MARGIN_NS
            begin = min(plateau.from_ns + rules.settle_s * 1e9, (plateau.from_ns + end) / 2)
            return _take(stream.span(begin, end), begin, end, rules, stream.resolution_um)
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
        doubtful=taken.doubtful,
        doubt_codes=taken.codes,
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


def _take(span: Span, from_ns: float, to_ns: float, rules: StopRules, resolution_um: float) -> Taken | None:
    if len(span.time_ns) < MIN_SAMPLES:
        return None
    least_um = resolution_um if math.isfinite(resolution_um) else RESOLUTION_FLOOR_UM
    window = summarise((span.time_ns - span.time_ns[0]) * 1e-9, span.position_mm, least_um)
    beam = float(np.nanmean(span.beam)) if np.isfinite(span.beam).any() else math.nan
    doubts = [_unsteady(window, rules)]
    if (to_ns - from_ns) < 0.5 * rules.min_window_s * 1e9:
        doubts.append(f"only {(to_ns - from_ns) * 1e-9:.3f} s of the dwell are certain, {rules.min_window_s:g} s are wanted: dwell longer")
    if span.unusable > len(span.time_ns):
        doubts.append(f"{span.unusable} of {span.unusable + len(span.time_ns)} samples are unusable")
    return Taken(window=window, from_ns=from_ns, to_ns=to_ns, beam=beam, doubtful="; ".join(text for text in doubts if text))


def _unsteady(window: Window, rules: StopRules) -> str:
    """Return in words why a window is not steady: its trend beyond doubt too steep, or its scatter too wide; empty if it is."""
    if abs(window.slope_um_s) > rules.max_slope_um_s + 3.0 * window.u_slope_um_s:
        return f"still moving at {window.slope_um_s:.2f} um/s (limit {rules.max_slope_um_s:g})"
    if window.scatter_um > rules.max_scatter_um:
        return f"scatter {window.scatter_um:.2f} um (limit {rules.max_scatter_um:g})"
    return ""


def _head_means(head: StreamBuffer | None, taken: Taken) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the means of the 4-DOF head's channels over the window and their standard uncertainties; empty without a head."""
    if head is None:
        return (), ()
    span = head.span(taken.from_ns, taken.to_ns)
    if span.channels is None or len(span.channels) < MIN_SAMPLES:
        return (), ()
    seconds = (span.time_ns - span.time_ns[0]) * 1e-9
    columns = [summarise(seconds, column) for column in span.channels.T]
    return tuple(column.mean_mm for column in columns), tuple(column.u_um * 1e-3 for column in columns)
