"""The room daq/capture/naming, played from reference files."""

from typing import Any

import msgspec

from stepdiag.base.findings import Finding
from stepdiag.base.setups import setup_of
from stepdiag.base.volume import Volume
from stepdiag.daq.capture.log_start import CaptureStart, PassHint
from stepdiag.daq.capture.naming.finder import PassFinder
from stepdiag.daq.capture.naming.route import Route, agrees, judge_step
from stepdiag.daq.capture.naming.walk import Chain, Look, Path, Walk
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
    return make_route(
        volume, told["setup"], told.get("order", "xyz"), outward=told["outward"]
    )


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
        "kept": [
            bool(column.flags.writeable) for column in (route.stops_mm, route.nominal_mm)
        ],
        "base": setup_of(told["setup"]).base,
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


def names(told: dict[str, Any]) -> Any:
    """Return the name of every standstill, its margin, and the names of the earlier standstills if
    these have changed."""
    route, found, before = route_of(told["route"]), [], ()
    known = {int(stop): reading for stop, reading in told.get("known", {}).items()}
    chain = Chain(
        (route,), Path(stop=told.get("after", -1), known=known, count=told.get("last_count"))
    )
    for stop, count, reading_mm, *lost in told["looks"]:
        place = told["spots"][stop] if stop is not None and "spots" in told else None
        path = chain.take(
            Look(None if place is None else tuple(place), count, reading_mm, bool(lost))
        )
        margin = f"{min(chain.margin, 99.0):.3f}"
        found.append(
            [
                path.name,
                margin,
                *([list(path.names)] if path.names[: len(before)] != before else []),
            ]
        )
        before = () if lost else path.names
    return found


def finder(told: dict[str, Any]) -> Any:
    """Play first dwells ``[place, setup, count, reading]`` into the finder of a pass, with each
    count before."""
    survey, found, spots = survey_of(told), [], told["spots"]
    hints = {
        setup: msgspec.convert(hint_of(said), PassHint)
        for setup, said in told["hints"].items()
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
                turn = None if answer.turn is None else answer.turn.stop
                state = [
                    f"{answer.route.setup} {answer.route.way}",
                    answer.expected,
                    answer.started,
                    answer.apart,
                    turn,
                    answer.counts_on(signals),
                ]
                said += [
                    *state,
                    " ".join(
                        f"{stop}:{reading:.4f}"
                        for stop, reading in answer.chain.best.known.items()
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
                    survey,
                    CaptureStart(hints={told["setup"]: hint}, last_count=told["last_count"]),
                )
                answer = finds.follow(signals_of({"stop_count": count, "at": spot}), None)
                assert isinstance(answer, Walk)
                row.append(
                    f"{'+' if answer.route.outward else '-'}{answer.expected}"
                    f"{'t' if answer.turn else ''}"
                )
            found[f"{said} at {place}"] = " ".join(row)
    return found


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
                    last_beyond_ns(stream, last, towards, until * MS)
                    for towards in (1.0, -1.0)
                ]
            found.append(row)
    return plain(found)


def positions(told: dict[str, Any]) -> Any:
    """Compare commanded positions with a plan, stop by stop."""
    found, route = [], route_of(told["route"])
    check = PositionCheck({} if told.get("bare") else CONTRACT_SIGNALS)
    follows = Walk((route,), Path())
    for stop, off_mm in told["stops"]:
        at = (
            [plan + off for plan, off in zip(route.planned_mm(stop), off_mm, strict=True)]
            if off_mm
            else []
        )
        found.append(brief(check.judge(follows, stop, signals_of({"at": at}))))
    return found
