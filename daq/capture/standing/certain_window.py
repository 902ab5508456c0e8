"""The certain part of a dwell, which ends at a loss of the count and has no unsteady samples; and
the side from which the machine approached.

A machine that reverses at a stop arrives there once. The reading at this stop belongs to both
passes and contains the backlash of the outward pass. On the return pass the backlash of an axis
does not change before the first move of this axis.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from stepdiag.base.messages import Message, message
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.noise import (
    BESIDE_MM,
    LEAST_SAMPLES,
    MAJORITY,
    MOMENT_NS,
    SIGMAS,
    STILL_MM,
)
from stepdiag.daq.capture.standing.dwell import Dwell
from stepdiag.daq.capture.standing.window import (
    RESOLUTION_FLOOR_UM,
    Placing,
    Window,
    against_itself,
    find_step,
    on_the_way,
    sigmas_of_trend,
    strays,
    summarise,
)
from stepdiag.daq.survey.models import StopRules
from stepdiag.daq.timing.stream import ARRIVAL_SLACK_NS, Span, StreamBuffer

LOOK_BACK_NS = 5_000_000_000
"""Time in ns before a standstill in which its approach is searched: longer than the last part of a
slow move.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Taken:
    """A window of readings: its statistics, its bounds, and the reasons to doubt it.

    ``step`` is the size of a step in the window, in um and in standard deviations of the window's
    own noise. ``trend_sigmas`` is the part of the trend above the allowed trend, in standard
    deviations of the window's own noise.
    """

    window: Window
    from_ns: float
    to_ns: float
    beam: float
    doubts: tuple[Message, ...] = ()
    step: tuple[float, float] = (0.0, 0.0)
    trend_sigmas: float = 0.0


@dataclass(frozen=True, slots=True)
class Part:
    """A part of a dwell without a loss of the count, so that its readings have a common zero. All
    readings were measured in this part, and received before the loss of the count at the end of
    this part.
    """

    from_ns: float
    to_ns: float
    arrived_before_ns: float = math.inf

    def span(self, stream: Placing, from_ns: float) -> Span:
        """Return the usable samples of this part from ``from_ns`` on."""
        return stream.span(from_ns, self.to_ns, self.arrived_before_ns)


def unbroken_parts(stream: Placing, dwell: Dwell) -> list[Part]:
    """Return the parts of a dwell between certain or possible losses of the count; at least one
    part. Each part ends with its last sample.

    The time of a loss is the arrival of the first chunk after the loss. The samples of the first
    chunk after a loss may have earlier times, and belong to no part.
    """
    latest_ns = dwell.to_ns + ARRIVAL_SLACK_NS
    cuts = sorted(
        {
            event.time_ns
            for event in stream.breaks
            if dwell.from_ns < event.time_ns <= latest_ns
        }
    )
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
    """Return the windows over the certain parts of a dwell.

    A loss of the count within the dwell can leave a part before and a part after the loss. The
    machine did not move in between, so the difference of both parts is the error of the count. A
    window from before a loss is used only if it has no doubt, or if there is no other window.
    """
    *before, last = unbroken_parts(stream, dwell)
    earlier = [
        taken for part in before if (taken := certain_window(stream, part, rules)) is not None
    ]
    sure = [taken for taken in earlier if not taken.doubts]
    taken = certain_window(stream, last, rules)
    return [*sure, taken] if taken is not None else sure or earlier[-1:]


def certain_window(stream: Placing, part: Part, rules: StopRules) -> Taken | None:
    """Return the window that a part of a dwell contributes, with its mean; None if the part has no
    usable sample.

    The first ``settle_s`` are left out. If the readings are not steady yet, later and shorter
    windows are tried, down to the shortest allowed length. A step in the readings after
    ``settle_s``, or a frozen value, makes the stop doubtful, whichever window is used.
    """
    start = part.from_ns + rules.settle_s * 1e9
    span = part.span(stream, start)
    whole = take(span, start, part.to_ns, rules, stream.resolution_um)
    if whole is None:
        return None
    taken = _steadiest(stream, part, span, whole, rules)
    doubts = against_itself(span.position_mm, whole.window, stream.resolution_um)
    stepped = any(doubt.key == "window-step" for doubt in doubts)
    step = find_step(span.position_mm) if stepped else (0.0, 0.0)
    if taken is not whole and on_the_way(span.position_mm):
        doubts = [doubt for doubt in doubts if doubt.key != "window-step.strays"]
    return replace(taken, doubts=(*taken.doubts, *doubts), step=step)


def _steadiest(
    stream: Placing, part: Part, span: Span, whole: Taken, rules: StopRules
) -> Taken:
    """Return the longest steady window without outliers (`strays`) at the end of a part of a dwell;
    the whole part if no such window is long enough.

    A shorter window has more noise, which hides a trend. So a shorter window is steady only if it
    shows less than half of the trend of the whole part.
    """
    length = part.to_ns - whole.from_ns
    for left_out in (0.0, 0.25, 0.5, 0.75):
        begin = whole.from_ns + left_out * length
        if left_out and part.to_ns - begin < rules.min_window_s * 1e9:
            break
        span = part.span(stream, begin) if left_out else span
        taken = (
            take(span, begin, part.to_ns, rules, stream.resolution_um) if left_out else whole
        )
        if taken is None:
            return whole
        if (
            not _unsteady(taken.window, rules)
            and not strays(span.position_mm, taken.window)
            and (taken is whole or not _goes_on(taken.window, whole.window, rules))
        ):
            return taken
    return whole


def _too_steep(window: Window, rules: StopRules) -> bool:
    return _beyond_um_s(window, rules) > SIGMAS * window.u_slope_um_s


def _beyond_um_s(window: Window, rules: StopRules) -> float:
    """Return by how much a trend exceeds the largest allowed trend."""
    return abs(window.slope_um_s) - rules.max_slope_um_s


def _goes_on(window: Window, whole: Window, rules: StopRules) -> bool:
    """Return whether the trend of the whole part is too steep and a shorter window still shows more
    than half of this trend.
    """
    larger_um_s = max(rules.max_slope_um_s, MAJORITY * abs(whole.slope_um_s))
    along_um_s = math.copysign(1.0, whole.slope_um_s) * window.slope_um_s
    return _too_steep(whole, rules) and along_um_s > larger_um_s


def take(
    span: Span, from_ns: float, to_ns: float, rules: StopRules, resolution_um: float
) -> Taken | None:
    """Return the window of all readings in a span, with its statistics, bounds and doubts; None if
    the span has too few samples.
    """
    if len(span.time_ns) < LEAST_SAMPLES:
        return None
    least_um = resolution_um if math.isfinite(resolution_um) else RESOLUTION_FLOOR_UM
    window = summarise(span.time_ns * 1e-9, span.position_mm, least_um)
    beam = float(np.nanmean(span.beam)) if np.isfinite(span.beam).any() else math.nan
    doubts = _unsteady(window, rules)
    beyond_um_s = _beyond_um_s(window, rules)
    trend_sigmas = sigmas_of_trend(span.position_mm, window, beyond_um_s) if doubts else 0.0
    if (to_ns - from_ns) < MAJORITY * rules.min_window_s * 1e9:
        doubts.append(
            message(
                "stop-doubtful.short",
                certain_s=(to_ns - from_ns) * 1e-9,
                least_s=rules.min_window_s,
            )
        )
    if span.unusable > len(span.time_ns):
        doubts.append(
            message(
                "stop-doubtful.unusable",
                unusable=span.unusable,
                count=span.unusable + len(span.time_ns),
            )
        )
    return Taken(
        window=window,
        from_ns=from_ns,
        to_ns=to_ns,
        beam=beam,
        doubts=tuple(doubts),
        trend_sigmas=trend_sigmas,
    )


def _unsteady(window: Window, rules: StopRules) -> list[Message]:
    """Return the reason why a window is not steady (its trend is certainly too steep, or its
    scatter too wide); empty for a steady window.
    """
    if _too_steep(window, rules):
        return [
            message(
                "stop-doubtful", slope_um_s=window.slope_um_s, limit_um_s=rules.max_slope_um_s
            )
        ]
    if window.scatter_um > rules.max_scatter_um:
        return [
            message(
                "stop-doubtful.scatter",
                scatter_um=window.scatter_um,
                limit_um=rules.max_scatter_um,
            )
        ]
    return []


@dataclass(slots=True)
class PassNoise:
    """The slow noise of a pass in um/s, from the trends of its windows without a doubt until now.
    Turbulent air gives another trend at every stop; a machine that creeps gives the same trend.
    Each window is judged by its own noise until the pass has enough windows.
    """

    slopes_um_s: list[float] = field(default_factory=list)

    def take(self, taken: Taken, rules: StopRules) -> Taken:
        """Add the next window; return this window without the doubts that the slow noise
        explains.
        """
        window, shown_um_s = taken.window, self._scatter_um_s()
        step_um, step_sigmas = taken.step
        if shown_um_s:
            noise_um_s = max(window.u_slope_um_s, shown_um_s)
            explained = {
                "stop-doubtful": _beyond_um_s(window, rules) <= SIGMAS * noise_um_s,
                "window-step": abs(step_um) <= SIGMAS * shown_um_s * window.duration_s,
            }
        else:
            explained = {
                "stop-doubtful": taken.trend_sigmas <= SIGMAS,
                "window-step": step_sigmas <= SIGMAS,
            }
        doubts = tuple(each for each in taken.doubts if not explained.get(each.key, False))
        if not any(each.key in explained for each in doubts):
            self.slopes_um_s.append(window.slope_um_s)
        return replace(taken, doubts=doubts)

    def _scatter_um_s(self) -> float:
        """Return the standard deviation of the trends in um/s; 0 if there are too few trends."""
        if len(self.slopes_um_s) < 2 * LEAST_SAMPLES:
            return 0.0
        return float(np.std(self.slopes_um_s, ddof=1))


def came_along(stream: Placing, taken: Taken, begin_ns: float, step_mm: float) -> bool | None:
    """Return whether the machine approached a stop from the beginning of its step, not from beyond
    the stop.

    Approaches of a place from both sides differ by the reversal value. Position registers do not
    show the direction of the approach. Without a stop counter, only the laser's samples distinguish
    a stop of the return pass from a stop of the outward pass.

    The standstill begins at ``begin_ns`` with the reading ``taken``; ``step_mm`` is the expected
    reading of the step. None if the approach was not observed: the step is too short, there are no
    samples, or the count may have been lost on the way.
    """
    away_mm = min(BESIDE_MM, MAJORITY * abs(step_mm))
    if away_mm < STILL_MM:
        return None
    span = stream.span(begin_ns - LOOK_BACK_NS, begin_ns)
    off_mm = (span.position_mm - taken.window.mean_mm) * np.sign(step_mm)
    sides = np.sign(np.where(np.abs(off_mm) > away_mm, off_mm, 0.0))
    enough = len(sides) >= LEAST_SAMPLES
    in_a_row = (
        np.convolve(sides, np.ones(LEAST_SAMPLES), mode="valid") if enough else sides[:0]
    )
    away = np.flatnonzero(np.abs(in_a_row) == LEAST_SAMPLES)
    if not len(away) or any(
        span.time_ns[away[-1]] <= each.time_ns <= taken.to_ns for each in stream.breaks
    ):
        return None
    return bool(in_a_row[away[-1]] < 0.0)


def watched_closely(laser: StreamBuffer, last: CapturedStop, until_ns: float) -> bool:
    """Return whether the laser has observed every move in this log since the last stop of a pass
    was captured: the samples are dense enough for `LEAST_SAMPLES` samples in the shortest overrun.
    """
    times_ns = laser.span(last.window_to_ns, until_ns).time_ns
    return bool(np.all(np.diff(times_ns) <= MOMENT_NS / LEAST_SAMPLES))


def last_beyond_ns(
    laser: StreamBuffer, last: CapturedStop, towards: float, until_ns: float
) -> float | None:
    """Return the last time in ns, since the capture of the last stop of a pass, at which the
    machine was beyond this stop; None without such a time.

    ``towards`` has the sign of the reading's change on the way to the last stop.
    """
    if last.reading_mm is None:
        return None
    span = laser.span(last.window_to_ns, until_ns)
    off_mm = (span.position_mm - last.reading_mm) * np.sign(towards)
    if len(off_mm) < LEAST_SAMPLES:
        return None
    beyond = np.flatnonzero(
        np.convolve(off_mm > STILL_MM, np.ones(LEAST_SAMPLES), mode="valid") == LEAST_SAMPLES
    )
    return float(span.time_ns[beyond[-1] + LEAST_SAMPLES - 1]) if len(beyond) else None
