"""The rooms of daq/capture/place, played from reference files."""

from typing import Any

import msgspec

from stepdiag.base.findings import Finding
from stepdiag.base.setups import setup_of
from stepdiag.base.volume import Volume
from stepdiag.daq.capture.log_start import CaptureStart, PassHint
from stepdiag.daq.capture.place.route import LaserPlaces, Route, agrees, judge_step
from stepdiag.daq.capture.place.walk import PassFinder, Walk, begun_anew
from stepdiag.daq.capture.standing.certain_window import last_beyond_ns, watched_closely
from stepdiag.daq.capture.stop_capture import PositionCheck
from stepdiag.daq.formats.signals import CONTRACT_SIGNALS
from testkit.references import plain
from testkit.references.daq_capture.told import (
    MS,
    Told,
    brief,
    hint_of,
    signals_of,
    stop_of,
    survey_of,
)
from testkit.routes import make_route


def route_of(told: dict[str, Any]) -> Route:
    """Return a route."""
    volume = Volume(
        origin_mm=tuple(told.get("origin_mm", (0.0, 0.0, 0.0))),
        size_mm=tuple(told["size_mm"]),
        increments=told["n"],
    )
    return make_route(volume, told["setup"], told.get("order", "xyz"), outward=told["outward"])


def routes(told: dict[str, Any]) -> Any:
    """Return a route and what it says of places and steps."""
    route = route_of(told)
    last = len(route) - 1
    pairs = ([0, 1], [1, 2], [2, 4], [last - 1, last], [0, 0])
    steps = [
        [
            *pair,
            number,
            _judged(
                route,
                pair,
                _measured(route, pair, share),
                told["absolutes"][number % len(told["absolutes"])],
            ),
        ]
        for pair in pairs[: told.get("pairs", 5)]
        for number, share in enumerate(told["shares"])
    ]
    runs = (
        route.nominal_mm[:1],
        route.nominal_mm[:2],
        route.nominal_mm,
        [0, *route.nominal_mm],
        route.nominal_mm[1:3],
    )
    return {
        "route": list(plain(route).values()),
        "axes": [route.axis_to(stop) for stop in range(len(route))],
        "planned": plain([route.planned_mm(stop) for stop in range(len(route))]),
        "at": plain([route.nominal_at_mm(tuple(place)) for place in told["places"]]),
        "found": [
            [route.find(tuple(place), expected) for expected in (0, 3, last)]
            for place in told["places"]
        ],
        "backward": plain([route.backward_mm(stop, stop + 1) for stop in range(last)]),
        "steps": steps,
        "kept": [bool(column.flags.writeable) for column in (route.stops_mm, route.nominal_mm)],
        "base": setup_of(told["setup"]).base,
        "anew": [begun_anew(route, list(readings)) for readings in runs],
    }


def _judged(route: Route, pair: list[int], measured_mm: float, absolute_mm: float) -> Any:
    """Return what is wrong with a step."""
    return plain(judge_step(route, *pair, measured_mm, absolute_mm))


def _measured(route: Any, pair: list[int], share: Any) -> float:
    """Return a step: a share of the nominal one and so many mm more, or that of another pair of
    stops."""
    factor, more_mm, *other = share
    return float(factor * route.step_mm(*(other[0] if other else pair)) + more_mm)


def agreeing(told: list[list[float]]) -> Any:
    """Tell of pairs whether they agree."""
    return [agrees(measured, nominal) for measured, nominal in told]


def laser_places(told: dict[str, Any]) -> Any:
    """Play readings into what is known of a route."""
    places = LaserPlaces(
        route_of(told["route"]), {int(stop): reading for stop, reading in told["known"].items()}
    )
    found = []
    for act, *rest in told["steps"]:
        said = (
            places.take(rest[0], rest[1], anew=rest[2])
            if act == "take"
            else getattr(places, act)(*rest)
        )
        known = (
            ""
            if act == "stop_at"
            else " ".join(f"{stop}:{reading:.4f}" for stop, reading in places.known.items())
        )
        found.append([act, plain(said), known])
    return found


STATE = ("expected", "unsure", "nowhere", "retreated", "apart", "started", "ended")


def walk(told: dict[str, Any]) -> Any:
    """Play stops and standstills into a walk; its state after each, where it is another one."""
    route = route_of(told["route"])
    known = {int(stop): reading for stop, reading in told.get("known", {}).items()}
    if "believed" in told:
        follows = Walk.begun_before(route, told["believed"], told["last_count"])
    else:
        follows = Walk(
            route, told.get("expected", 0), told.get("last_count"), told.get("last_mm"), known
        )
    found, before = [], {"name": follows.name} | _state(follows)
    begins = dict(before)
    for act, *rest in told["steps"]:
        if act == "advance":
            said: Any = follows.advance(stop_of(rest[0]))
        elif act in ("locate", "is_bounce", "counts_on"):
            said = getattr(follows, act)(signals_of(rest[0]))
        elif act == "by_laser":
            said = follows.locate_by_laser(signals_of(rest[0]), rest[1], lost=rest[2])
        else:
            said = getattr(follows, act)(*rest)
        now = _state(follows)
        found.append(
            [
                act,
                brief(said),
                {name: value for name, value in now.items() if value != before[name]},
            ]
        )
        before |= now
    return {"begins": begins, "steps": found}


def _state(follows: Walk) -> dict[str, Any]:
    known = " ".join(f"{stop}:{reading:.4f}" for stop, reading in follows.laser.known.items())
    return {name: plain(getattr(follows, name)) for name in STATE} | {"known": known}


def finder(told: dict[str, Any]) -> Any:
    """Play first dwells ``[place, setup, count, reading]`` into the finder of a pass, with each
    count before."""
    survey, found, spots = survey_of(told), [], told["spots"]
    hints = {
        setup: msgspec.convert(hint_of(said), PassHint) for setup, said in told["hints"].items()
    }
    for last_count, rows in told["asked"]:
        finds = PassFinder(survey, CaptureStart(hints=hints, last_count=last_count))
        for place, setup, count, reading_mm in rows:
            signals = signals_of(
                {"setup": setup, "stop_count": count}
                | ({} if place is None else {"at": spots[place]})
            )
            answer = finds.follow(signals, reading_mm)
            said: list[Any] = [finds.is_head_run(signals)]
            if isinstance(answer, Walk):
                turn = None if finds.turn is None else finds.turn.stop
                state = [
                    answer.name,
                    answer.expected,
                    answer.started,
                    answer.apart,
                    turn,
                    answer.counts_on(signals),
                ]
                said += [
                    *state,
                    " ".join(
                        f"{stop}:{reading:.4f}" for stop, reading in answer.laser.known.items()
                    ),
                ]
            else:
                said += [brief(answer) if isinstance(answer, Finding) else plain(answer)]
            found.append(" | ".join(map(str, plain(said))))
    return found


def directions(told: dict[str, Any]) -> Any:
    """Return where a pass is taken up at each place of a table: a row for a hint and a place, in it
    a word for each count."""
    survey, spots, found = survey_of(told), told["spots"], {}
    for said in told["hints"]:
        hint = msgspec.convert(hint_of(said), PassHint)
        for place, spot in enumerate(spots):
            row = []
            for count in told["counts"]:
                finds = PassFinder(
                    survey, CaptureStart(hints={told["setup"]: hint}, last_count=told["last_count"])
                )
                answer = finds.follow(signals_of({"stop_count": count, "at": spot}), None)
                assert isinstance(answer, Walk)
                row.append(
                    f"{'+' if answer.route.outward else '-'}{answer.expected}"
                    f"{'t' if finds.turn else ''}"
                )
            found[f"{said} at {place}"] = " ".join(row)
    return found


def located(told: dict[str, Any]) -> Any:
    """Return which stop a walk takes each reading for, after some stops: a row for a count and a
    count that was lost or not."""
    route, found = route_of(told["route"]), {}
    for stops in told["taken"]:
        for count in told["counts"]:
            for lost in (False, True):
                row = [
                    _located(route, stops, reading_mm, count, lost=lost)
                    for reading_mm in told["readings"]
                ]
                found[f"{stops} {count}{' lost' * lost}"] = " ".join(row)
    return found


def _located(
    route: Route, stops: list[int], reading_mm: float, count: int | None, *, lost: bool
) -> str:
    """Return a word for where a walk that came to some stops, counted by ones, sees itself."""
    follows = Walk(route, 0, 0, None, {})
    for number, stop in enumerate(stops):
        reading = float(route.nominal_mm[stop])
        follows.advance(
            stop_of(
                {
                    "stop": stop,
                    "reading_mm": reading,
                    "stop_count": None if count is None else 1 + number,
                }
            )
        )
    counted = signals_of({} if count is None else {"stop_count": len(stops) + count})
    index, odd = follows.locate_by_laser(counted, reading_mm, lost=lost)
    state = (
        "n" * follows.nowhere
        + "r" * bool(follows.retreated)
        + "a" * bool(follows.apart)
        + "u" * bool(follows.unsure)
    )
    return "-".join(
        [
            "x" if index is None else str(index),
            *(each.code[0] + each.code[-1] + str(each.stop) for each in odd),
            state,
        ]
    )


def turned(told: dict[str, Any]) -> Any:
    """Return what the laser saw beyond a last stop: of each reading, end of its window, direction
    and time."""
    stream, found = Told(told["stream"]), []
    for reading_mm in told["readings"]:
        for end_ms in told["ends"]:
            last = stop_of({"reading_mm": reading_mm, "window_to_ns": end_ms * MS})
            row: list[Any] = []
            for until in told["untils"]:
                row += [int(watched_closely(stream, last, until * MS))]
                row += [
                    last_beyond_ns(stream, last, towards, until * MS) for towards in (1.0, -1.0)
                ]
            found.append(row)
    return plain(found)


def positions(told: dict[str, Any]) -> Any:
    """Compare commanded positions with a plan, stop by stop."""
    found, route = [], route_of(told["route"])
    check = PositionCheck({} if told.get("bare") else CONTRACT_SIGNALS)
    follows = Walk(route, 0, None, None)
    for stop, off_mm in told["stops"]:
        at = (
            [plan + off for plan, off in zip(route.planned_mm(stop), off_mm, strict=True)]
            if off_mm
            else []
        )
        found.append(brief(check.judge(follows, stop, signals_of({"at": at}))))
    return found
