"""The rooms of daq/capture/standing, and the head's stream, played from reference files."""

from typing import Any

import numpy as np

from stepdiag.daq.capture.head_stop import AngleView, QdView, troubles
from stepdiag.daq.capture.standing.certain_window import (
    came_along,
    certain_windows,
    take,
    unbroken_parts,
)
from stepdiag.daq.capture.standing.dwell import Dwell, DwellTracker, Standstills, count_steps
from stepdiag.daq.capture.standing.window import (
    against_itself,
    find_plateaus,
    inliers,
    step_in_um,
    summarise,
)
from stepdiag.daq.capture.stop_capture import make_head_stop, make_stop, plateau_window
from stepdiag.daq.timing.stream import Span
from testkit.references import plain
from testkit.references.daq_capture.place import route_of
from testkit.references.daq_capture.told import (
    MS,
    Told,
    brief,
    dwell_of,
    rules_of,
    series,
    signals_of,
)


def windows(told: list[list[Any]]) -> Any:
    """Return everything that is made of windows: ``[rate in Hz, resolution in um, where in mm,
    samples in um]``."""
    found = []
    for rate_hz, resolution_um, at_mm, um in told:
        off_um = np.array(series(um))
        time_s, position_mm = (
            np.arange(len(off_um)) / rate_hz if rate_hz else np.ones(len(off_um)),
            at_mm + off_um * 1e-3,
        )
        made = summarise(time_s, position_mm, resolution_um)
        figures = [
            (made.mean_mm - at_mm) * 1e3,
            made.u_um,
            made.scatter_um,
            made.slope_um_s,
            made.u_slope_um_s,
        ]
        left_out = np.flatnonzero(~inliers((position_mm - np.median(position_mm)) * 1e3))
        doubts = [against_itself(position_mm, made, step_um) for step_um in (0.02, 0.021)]
        found.append(
            [
                [
                    *figures,
                    made.used,
                    made.rejected,
                    made.duration_s,
                    step_in_um(position_mm),
                ],
                left_out,
                *doubts,
            ]
        )
    return plain(found)


def plateaus(told: list[dict[str, Any]]) -> Any:
    """Return the plateaus of readings, of several least lengths."""
    found = []
    for each in told:
        span = Told(each).span(-np.inf, np.inf)
        seen = [
            find_plateaus(span.time_ns, span.position_mm, at_least_s)
            for at_least_s in each["at_least_s"]
        ]
        found.append(
            [[[one.from_ns, one.to_ns, one.level_mm] for one in those] for those in seen]
        )
    return plain(found)


def _taken(each: Any) -> Any:
    """Return a window that was taken as a row, its mean as micrometres beyond whole millimetres."""
    if each is None:
        return None
    window = plain(each.window)
    whole = round(each.window.mean_mm)
    window["mean_mm"] = plain([whole, (each.window.mean_mm - whole) * 1e3])
    rest = [plain(value) for value in (each.from_ns, each.to_ns, each.beam, *each.doubts)]
    return [*window["mean_mm"], *list(window.values())[1:], *rest]


def certain(told: dict[str, Any]) -> Any:
    """Return what is made of dwells on a stream: parts, windows, approach; and what of the plateaus
    between them."""
    stream, rules, found = Told(told["stream"]), rules_of(told), []
    for from_ms, to_ms in told["dwells_ms"]:
        dwell = dwell_of({"from_ns": from_ms * MS, "to_ns": to_ms * MS})
        made = certain_windows(stream, dwell, rules)
        along = (
            [
                came_along(stream, made[0], from_ms * MS, step_mm)
                for step_mm in told.get("steps_mm", [])
            ]
            if made
            else []
        )
        found.append(
            [
                [[part.from_ns, part.to_ns] for part in unbroken_parts(stream, dwell)],
                [_taken(each) for each in made],
                along,
            ]
        )
    levels = [
        _taken(plateau_window(stream, begin * MS, end * MS, at_mm, rules))
        for begin, end, at_mm in told.get("plateaus", [])
    ]
    return {"dwells": found, "plateaus": levels}


def taken(told: dict[str, Any]) -> Any:
    """Return what is taken of spans of so many samples, so many unusable, so long."""
    found = []
    for count, unusable, seconds, resolution_um in told["spans"]:
        time_ns = 2e9 + np.arange(count) * (seconds * 1e9 / max(count - 1, 1))
        mm = 3.0 + 1e-4 * (np.arange(count) % 3)
        beam = np.where(np.arange(count) % 2, 0.5, np.nan)
        span = Span(
            time_ns=time_ns, position_mm=mm, beam=beam, channels=None, unusable=unusable
        )
        found.append(
            _taken(take(span, 2e9, 2e9 + seconds * 1e9, rules_of(told), resolution_um))
        )
    return found


def dwells(told: dict[str, Any]) -> Any:
    """Play polls ``[ms of the request, signals]``, silences and stale registers: what each closes,
    and what is open after it."""
    tracker, found = DwellTracker(), []
    for act, at_ms, *rest in told["steps"]:
        closed = None
        if act == "poll":
            closed = tracker.poll(signals_of(rest[0]), at_ms * MS, (at_ms + 5) * MS)
        elif act == "stale":
            tracker.stale(at_ms * MS)
        found.append([brief(closed), brief(tracker.open)])
    return {
        "steps": found,
        "counts": [
            [before, after, count_steps(before, after)] for before, after in told["counts"]
        ],
    }


def _stood(told: list[Any]) -> Dwell:
    """Return a dwell of ``[from ms, to ms, not before ms, count, x in mm]``."""
    from_ms, to_ms, before_ms, count, x_mm = [*told, *(None, 1, 0.0)[len(told) - 2 :]][:5]
    signals = signals_of(
        {"stop_count": count} | ({} if x_mm is None else {"at": [x_mm, 0.0, 0.0]})
    )
    before_ns = None if before_ms is None else before_ms * MS
    return Dwell(
        from_ns=from_ms * MS,
        to_ns=to_ms * MS,
        not_before_ns=before_ns,
        signals=signals,
    )


def standstills(told: dict[str, Any]) -> Any:
    """Ask of pairs of dwells, on several streams, whether they are one standstill, and join
    them."""
    found = {}
    for name, each in told["streams"].items():
        stream = None if each is None else Told(each)
        found[name] = [
            _pair(stream, _stood(before), _stood(after)) for before, after in told["pairs"]
        ]
    return found


def _pair(stream: Any, before: Dwell, after: Dwell) -> Any:
    """Return the answers of those that wait, and what they are joined to."""
    asked, joined = Standstills(), Standstills()
    begun = after.from_ns
    answers = [asked.goes_on(after, stream)]
    asked.add(before)
    times = [after.to_ns, begun + 499 * MS, begun + 500 * MS]
    answers += [asked.settled(now_ns, after, stream) for now_ns in times]
    answers += [
        asked.are(after, stream),
        *(asked.settled(before.to_ns + wait * MS, None, stream) for wait in (299, 300)),
        asked.goes_on(after, stream),
    ]
    first = asked.take()
    answers += [asked.goes_on(after, stream), bool(asked)]
    joined.add(before)
    joined.add(after)
    answers += [
        joined.settled(begun + 100 * MS, None, stream),
        joined.settled(begun + 501 * MS, None, stream),
        joined.are(after, stream),
    ]
    whole = joined.take()
    answers += [bool(joined), joined.goes_on(after, stream)]
    joined.taken_early(after)
    answers.append(joined.goes_on(before, stream))
    row = "".join("?" if one is None else "01"[bool(one)] for one in answers)
    return row + "".join(
        f" {one.from_ns // MS}-{one.to_ns // MS} #{one.signals.stop_count}"
        for one in (first, whole)
    )


def parts(told: dict[str, Any]) -> Any:
    """Add dwell after dwell to those that wait, and take what is settled."""
    stream, waiting, found = Told(told["stream"]), Standstills(), []
    for act, *rest in told["steps"]:
        if act == "add":
            waiting.add(_stood(rest[0]))
        elif act == "settled":
            found.append(
                [
                    act,
                    waiting.settled(
                        rest[0] * MS, None if rest[1] is None else _stood(rest[1]), stream
                    ),
                    brief(waiting.first()),
                ]
            )
        elif act == "take":
            found.append([act, brief(waiting.take()), bool(waiting)])
        else:
            found.append([act, getattr(waiting, act)(_stood(rest[0]), stream)])
    return found


def heads(told: dict[str, Any]) -> Any:
    """Return a head's stream seen as a length, its troubles, and the stop that it gives."""
    head: Any = Told(told["head"])
    laser: Any = Told(told["laser"])
    route, found = route_of(told["route"]), []
    for from_ms, to_ms in told["dwells_ms"]:
        dwell = dwell_of({"from_ns": from_ms * MS, "to_ns": to_ms * MS})
        for view in (QdView(head), AngleView(head)):
            span = view.span(dwell.from_ns, dwell.to_ns)
            found.append(
                [
                    span.position_mm * 1e3,
                    len(span.time_ns),
                    span.time_ns.sum(),
                    span.unusable,
                    view.newest_ns(),
                    view.resolution_um,
                ]
            )
            found[-1] += [plain([each.reason for each in view.breaks])]
            for one in certain_windows(view, dwell, rules_of(told)):
                found.append(
                    brief(
                        make_head_stop(
                            route, 1, dwell.signals, one, head, laser, 5_000_000_000
                        )
                    )
                )
                found.append(make_stop(route, 2, dwell.signals, one, None, 0).channels)
        found.append([plain(each) for each in troubles(head, dwell)])
    return plain(found)
