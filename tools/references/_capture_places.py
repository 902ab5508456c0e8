"""Inputs of the reference cases of daq/capture/place: routes, what is known of a route, walks, the
first dwell of a log."""

from collections.abc import Iterator
from typing import Any

from _capture_kit import BOX, NOMINAL, Case

from testkit.timeline import diagonal

MS = 1_000_000
SPOTS = [list(each.position) for each in diagonal("ppp", n=2)]


def _routes() -> Iterator[Case]:
    shares: list[Any] = [
        [1.0, 0.0],
        [1.019, 0.0],
        [0.981, 0.0],
        [1.02, 0.019],
        [1.02, 0.021],
        [0.98, -0.019],
        [0.98, -0.021],
        [-1.0, 0.0],
        [0.0, 0.0],
        [0.0, 0.019],
        [0.0, 0.021],
        [0.5, 0.0],
        [2.0, 0.0],
    ]
    shares += [
        *([1.0, 0.0, [a, a + 1]] for a in range(6)),
        *([-1.0, 0.0, [a, a + 1]] for a in (0, 2)),
        *([1.0, 0.0, [a, a + 2]] for a in (0, 3)),
        [1.0, 0.0, [0, 3]],
        [-1.0, 0.0, [3, 5]],
    ]
    places = [
        [0.0, 0.0, 0.0],
        [150.0, 0.0, 0.0],
        [150.09, 0.0, 0.0],
        [150.11, 0.0, 0.0],
        [300.0, 200.0, 100.0],
        [150.0, 100.0, 50.0],
        [300.0, 200.0, 50.0],
        [0.0, 0.0, 0.1],
        [10.0, 20.0, 30.0],
    ]
    for setup, size, outward, pairs in (
        ("ppp", [300.0, 200.0, 100.0], True, 5),
        ("npp", [300.0, 200.0, 100.0], False, 1),
        ("pnp+1", [200.0, 200.0, 100.0], False, 2),
        ("ppn", [200.0, 200.0, 200.0], True, 1),
        ("linear-y", [300.0, 200.0, 100.0], True, 1),
        ("fourdof-z", [300.0, 200.0, 100.0], False, 1),
    ):
        diagonal_run = setup[:2] in ("pp", "np", "pn")
        route = {
            "size_mm": size,
            "n": 2 if diagonal_run else 6,
            "setup": setup,
            "outward": outward,
            "order": "xyz" if outward else "zxy",
        }
        more = {
            "shares": shares if diagonal_run else shares[:13],
            "absolutes": [0.019, 0.021, 5.0] if outward else [5.0, 0.5, 0.02],
            "pairs": pairs,
        }
        told = (
            route
            | {"origin_mm": [0.0, 0.0, 0.0] if outward else [5.0, -10.0, 20.0], "places": places}
            | more
        )
        yield f"route-{setup}-{'out' if outward else 'back'}", "routes", told
    short = {
        "size_mm": [300.0, 200.0, 100.0],
        "n": 1,
        "setup": "ppp",
        "outward": True,
        "places": places[:5],
        "pairs": 2,
    }
    beyond: list[Any] = [[1.0, 0.0, [a, b]] for a, b in ((0, 1), (0, 2), (1, 2), (1, 3), (2, 3))]
    yield "route-short", "routes", short | {"shares": beyond, "absolutes": [5.0]}
    pairs_of = [(nominal, off) for nominal in (0.0, 1.0, -50.0, 100.0) for off in (0.019, 0.021)]
    agreeing = [
        [measured, nominal]
        for nominal, off in pairs_of
        for measured in (nominal * 1.02 + off, nominal * 0.98 - off, nominal * 1.01, -nominal)
    ]
    yield "agreeing", "agreeing", agreeing


def _laser_places() -> Iterator[Case]:
    levels = (
        0.0,
        12.0,
        30.0,
        60.0,
        80.178,
        81.0,
        100.0,
        120.268,
        126.0,
        127.5,
        133.63,
        140.0,
        150.0,
        180.0,
        187.08,
        213.0,
        240.5,
        267.3,
        300.0,
        360.8,
        374.17,
        400.0,
        -5.0,
    )
    routes = (
        ("box", BOX, 1.0),
        ("back", BOX | {"outward": False}, -1.0),
        ("long", BOX | {"n": 8, "setup": "linear-x"}, 1.0),
        ("cube", BOX | {"size_mm": [200.0, 200.0, 200.0]}, 0.9),
    )
    for name, route, scale in routes:
        asked: list[Any] = [["stop_at", round(scale * each, 3)] for each in levels]
        steps = [
            *asked,
            ["take", 0, 0.0, False],
            *asked,
            ["take", 1, 80.2, False],
            *asked[:8],
            ["after_nowhere", 95.0, 2],
            ["after_nowhere", 148.452, 2],
            ["after_nowhere", 161.815, 2],
        ]
        steps += [
            ["take", 2, None, False],
            ["after_nowhere", 20.0, 3],
            ["take", 3, 500.0, True],
            *asked[10:],
            ["after_nowhere", 20.0, 5],
            ["after_nowhere", 33.363, 6],
            ["after_nowhere", 100.18, 6],
        ]
        steps += [
            ["lost"],
            *asked[:3],
            ["after_nowhere", 1.0, 0],
            ["after_nowhere", 81.178, 0],
            ["after_nowhere", 91.178, 99],
        ]
        yield f"laser-places-{name}", "laser-places", {"route": route, "known": {}, "steps": steps}
        known = [["stop_at", round(3.0 + each[1] * 1.003, 3)] for each in asked]
        yield (
            f"laser-places-known-{name}",
            "laser-places",
            {"route": route, "known": {"0": 3.0, "4": 203.5}, "steps": known},
        )

    near: list[Any] = [
        ["stop_at", -at]
        for at in (0.0, 3.0, 3.4, 9.9, 10.1, 13.4, 16.6, 16.8, 18.4, 25.0, 63.0, 66.8, 70.1, 80.0)
    ]
    steps = [
        ["take", 0, 0.0, False],
        *near,
        ["take", 1, -13.363, False],
        *near,
        ["take", 2, -66.815, True],
        *near,
    ]
    yield (
        "laser-places-near",
        "laser-places",
        {"route": BOX | {"outward": False}, "known": {}, "steps": steps},
    )


def _turns() -> Iterator[Case]:
    mm = [
        ["same", 20, 10.0],
        ["same", 5, 10.019],
        ["same", 3, 10.021],
        ["same", 5, 10.0],
        ["same", 2, 10.3],
        ["same", 5, 10.0],
        ["same", 4, 9.9],
        ["same", 20, 10.0],
    ]
    asked = {
        "readings": [10.0, None, 9.95],
        "ends": [0, 150, 250, 300, 640],
        "untils": [100, 270, 280, 300, 400, 10_000],
    }
    yield "turned", "turned", {"stream": {"every_ns": 10 * MS, "mm": mm}} | asked
    sparse = {
        "time_ns": [["line", 10, 0, 30 * MS], ["line", 7, 331 * MS, 31 * MS]],
        "mm": [["same", 17, 10.0]],
    }
    yield "turned-sparse", "turned", {"stream": sparse} | asked
    offs = [
        [],
        [0.0, 0.0, 0.0],
        [5e-5, 0.0, 0.0],
        [2e-4, 0.0, 0.0],
        [2.9e-4, 0.0, 0.0],
        [3.1e-4, 0.0, 0.0],
        [0.0, -9.9e-4, 0.0],
        [0.0, 0.0, 1.6e-3],
        [0.0, 0.002, 0.0],
        [0.0, 0.0, -0.0031],
        [0.05, 0.02, 0.03],
    ]
    for bare in (True, False):
        yield (
            f"positions-{'bare' if bare else 'mapped'}",
            "positions",
            {"route": BOX, "bare": bare, "stops": [[k % 7, off] for k, off in enumerate(offs)]},
        )
    rounded = [
        [k % 7, [off, 0.0, 0.0]]
        for k, off in enumerate((0.0005, 0.00099, 0.0011, 0.0017, 0.3, 0.44, 0.46, -0.7))
    ]
    yield "positions-rounded", "positions", {"route": BOX, "bare": True, "stops": rounded}


def _stop(index: int, count: int | None = None, reading: Any = -1.0, **more: Any) -> list[Any]:
    return [
        "advance",
        {
            "stop": index,
            "stop_count": count,
            "reading_mm": NOMINAL[index] if reading == -1.0 else reading,
        }
        | more,
    ]


def _at(index: int, count: int | None = None) -> list[Any]:
    return ["locate", {"at": SPOTS[index]} | ({} if count is None else {"stop_count": count})]


def _sees(reading: float | None, count: int | None = None, *, lost: bool = False) -> list[Any]:
    return ["by_laser", {} if count is None else {"stop_count": count}, reading, lost]


def _counted(act: str, count: int, *at: float) -> list[Any]:
    return [act, {"stop_count": count} | ({"at": list(at)} if at else {})]


def _walks() -> Iterator[Case]:
    nowhere = [1.0, 2.0, 3.0]
    signals: list[Any] = [
        _counted("is_bounce", 9),
        _at(0, 9),
        _counted("counts_on", 10),
        _stop(0, 9),
        _counted("is_bounce", 9),
        _counted("is_bounce", 9, *SPOTS[0]),
        _counted("is_bounce", 9, *SPOTS[1]),
    ]
    signals += [
        _counted("counts_on", 10),
        _counted("counts_on", 11),
        ["counts_on", {}],
        ["is_bounce", {}],
        _at(1, 10),
        _at(1, 9),
        _at(1, 11),
        _at(1),
        _stop(1, 10),
        ["judge", 2, NOMINAL[2]],
        ["judge", 2, 5.0],
    ]
    signals += [
        ["judge", 1, 99.0],
        ["expected_reading_mm", 4],
        _at(3, 12),
        _at(3, 11),
        _at(0, 11),
        _at(1, 11),
        _counted("locate", 11, *nowhere),
        *(_counted("locate", count) for count in (11, 99, 1010, 1011, 10, 3)),
    ]
    signals += [
        ["locate", {}],
        ["skip", 2, 11],
        ["expected_reading_mm", 3],
        _at(3, 12),
        _stop(3, 12),
        _stop(4, 13),
        _stop(5, None),
        _at(6, 14),
        _stop(6, 14),
        _counted("is_bounce", 14),
        _at(6, 15),
        _at(0, 15),
    ]
    signals += [["locate", {"at": nowhere}], ["goes_on", [1.0, 2.0]]]
    yield "walk-by-signals", "walk", {"route": BOX, "last_count": 8, "steps": signals}
    turned = [
        _at(index, count)
        for index, count in (
            (0, 8),
            (0, 9),
            (1, 9),
            (1, 10),
            (1, 11),
            (2, 9),
            (2, 10),
            (2, 11),
            (0, 10),
            (0, 11),
        )
    ]
    yield (
        "walk-turned",
        "walk",
        {"route": BOX, "last_count": 8, "steps": [*turned, _counted("locate", 20)]},
    )
    begins = {"expected": 3, "last_count": 65535, "last_mm": 100.0, "known": {"2": 100.0}}
    goes_on = [
        *(_counted("locate", count) for count in (0, 2, 65535)),
        _sees(73.3, 0),
        _sees(73.3, lost=True),
        _sees(60.0),
        ["expected_reading_mm", 3],
        ["judge", 3, 73.3],
    ]
    yield "walk-goes-on", "walk", {"route": BOX | {"outward": False}, "steps": goes_on} | begins
    counted = [
        _sees(None, 9),
        _sees(3.0, 9),
        _stop(0, 9, 0.0),
        _sees(0.01, 9),
        *(_sees(80.18, count) for count in (10, 11, 9)),
        _sees(40.0, 10),
        _sees(40.0, 9),
        _sees(-12.0, 10),
        _sees(None, 10),
        _sees(None, 9),
    ]
    counted += [
        _stop(1, 10),
        _sees(0.0, 11),
        *(_sees(134.0, count) for count in (11, 12, 10)),
        _sees(100.0, 11),
        _sees(100.0, 10),
        _sees(27.0, 11),
        _sees(100.0, 11, lost=True),
        _sees(133.9, 11),
        _stop(2, 11),
    ]
    counted += [
        _sees(160.0, 12, lost=True),
        _sees(161.0, 12),
        _stop(3, 12, 500.0, broken="b"),
        _sees(580.3, 13),
        _sees(160.0, 13),
        _sees(580.3, 9),
        _sees(640.0, 14),
        _stop(4, 13, None),
        _sees(None, 14),
    ]
    counted += [_stop(6, 15, 660.0, refused="r"), _sees(1.0, 16), _sees(580.3, 16)]
    yield "walk-by-laser-counted", "walk", {"route": BOX, "last_count": 8, "steps": counted}
    uncounted = [
        _sees(None),
        _sees(5.0),
        _stop(0, None, 0.0),
        _sees(0.01),
        _sees(80.18),
        _sees(40.0),
        _sees(-80.0),
        _sees(120.0),
        ["goes_on", [40.0, 120.2]],
        ["goes_on", [0.0, 80.2]],
        _stop(1),
        _sees(133.7),
    ]
    uncounted += [
        *map(_sees, (27.0, 107.0, 160.5, 80.1)),
        _stop(2),
        ["goes_on", [100.0, 126.73]],
        ["goes_on", [100.0, 180.0]],
        _sees(60.0),
        ["goes_on", [60.0, 86.73]],
        ["goes_on", [60.0, 140.178]],
        _sees(200.0),
    ]
    uncounted += [
        _sees(160.4, lost=True),
        _sees(170.0),
        _stop(3, None, 170.0),
        ["begin_anew"],
        ["begun_anew"],
        _sees(9.0),
        _stop(0, None, 9.0),
        *map(_sees, (89.1, -71.1, -160.0)),
        _stop(1, None, 89.1),
    ]
    yield (
        "walk-by-laser",
        "walk",
        {"route": BOX, "last_count": None, "steps": [*uncounted, *map(_sees, (-60.0, 20.0, 80.0))]},
    )
    back = [
        _sees(320.7),
        _stop(0, None, 320.7),
        *map(_sees, (294.0, 300.0, 330.0)),
        _stop(1, None, 294.0),
        *map(_sees, (240.5, 320.0, 310.0, 214.0)),
    ]
    yield (
        "walk-by-laser-back",
        "walk",
        {
            "route": BOX | {"outward": False},
            "last_count": None,
            "known": {"0": 320.7, "1": 294.0},
            "steps": back,
        },
    )
    resumed = [
        _sees(240.5, 6),
        _sees(None, 6, lost=True),
        _sees(240.5, 6, lost=True),
        _sees(0.0, 6, lost=True),
        _stop(0, 6, 0.0),
    ]
    yield (
        "walk-resumed",
        "walk",
        {
            "route": BOX,
            "expected": 4,
            "last_count": 5,
            "last_mm": 160.4,
            "known": {"3": 160.4},
            "steps": resumed,
        },
    )
    skipped = [
        ["skip", 0, None],
        _sees(80.0),
        _sees(5.0),
        ["skip", 1, None],
        _sees(160.4),
        _sees(133.6),
        _sees(-3.0),
        _sees(None, lost=True),
        _sees(50.0),
    ]
    yield (
        "walk-skipped",
        "walk",
        {"route": BOX, "last_count": None, "known": {"3": 160.4, "0": 0.0}, "steps": skipped},
    )
    for name, readings in (("on", (230.0, 250.0, -60.0)), ("off", (-60.0, 230.0, 173.72))):
        some = [
            _stop(0, None, 0.0),
            ["skip", 1, None],
            *map(_sees, readings),
            ["goes_on", [60.0, 180.268]],
            ["goes_on", [0.0, 53.452]],
        ]
        yield f"walk-skipped-{name}", "walk", {"route": BOX, "last_count": None, "steps": some}
    nowhere_yet: list[Any] = [
        _stop(0),
        _stop(1),
        _stop(2),
        ["goes_on", [5.0, 18.363]],
        ["goes_on", [5.0, 125.268]],
        _sees(230.0),
    ]
    for last in (120.268, 53.452, 13.363):
        nowhere_yet += [["goes_on", [9.0, 9.0 + last]], ["goes_on", [1.0, 9.0, 9.0 + last]]]
    yield (
        "walk-goes-on-from-nowhere",
        "walk",
        {"route": BOX, "last_count": None, "steps": nowhere_yet},
    )
    before = [_sees(138.6, 8), _sees(85.2, 7), _stop(2, 8, 138.6), ["expected_reading_mm", 3]]
    yield (
        "walk-begun-before",
        "walk",
        {"route": BOX, "believed": [5.0, 85.2], "last_count": 7, "steps": before},
    )
    cube = [
        _stop(0, None, 0.0),
        _stop(1, None, 57.7),
        *map(_sees, (115.5, -57.7, 29.0, 0.0)),
        _stop(2, None, 115.5),
        *map(_sees, (57.7, 86.0, 144.0)),
    ]
    yield (
        "walk-cube",
        "walk",
        {"route": BOX | {"size_mm": [200.0, 200.0, 200.0]}, "last_count": None, "steps": cube},
    )


def _finders() -> Iterator[Case]:
    turn = {"stop": 6, "outward": True, "reading_mm": 320.7}
    hints: dict[str, Any] = {
        "fresh": {"ppp": {}, "npp": {}},
        "back": {
            "ppp": {
                "outward": False,
                "turn": turn,
                "last_reading_mm": 320.7,
                "known": {"6": 320.7, "0": 0.0},
            }
        },
        "middle": {
            "ppp": {"next_stop": 3, "last_reading_mm": 133.6, "known": {"2": 133.6, "1": 80.2}}
        },
        "middle-back": {
            "ppp": {
                "outward": False,
                "next_stop": 2,
                "last_reading_mm": 294.0,
                "known": {"5": 294.0},
            }
        },
        "done": {"npp": {"wanted": False}, "ppp": {"wanted": False}},
        "offset": {"ppp+1": {"wanted": False}, "ppp+2": {}, "linear-x": {}},
        "head": {"fourdof-z": {}, "ppp": {}},
        "believed": {
            "ppp": {
                "next_stop": 4,
                "believed": [5.0, 85.2],
                "last_reading_mm": 85.2,
                "known": {"3": 85.2},
            }
        },
        "returning": {"ppp": {"outward": False, "turn": {"stop": 6, "outward": False}}},
        "known-next-0": {"ppp": {"known": {"0": 1.0, "6": 321.7}, "last_reading_mm": 1.0}},
    }
    firsts: list[Any] = [[[k, 1, 20, None]] for k in range(7)] + [
        [[k, None, 12, NOMINAL[k]]] for k in range(7)
    ]
    firsts += [
        [[None, 1, None, reading]]
        for reading in (None, 0.0, 80.2, 133.6, 138.6, 160.3, 294.0, 320.7, 240.5, 50.0)
    ]
    firsts += [
        [[None, None, 11, 240.5]],
        [[None, setup, None, None] for setup in (2, 3, 3)],
        [[None, setup, None, None] for setup in (1, 2)],
        [[None, 23, None, None]],
    ]
    firsts += [
        [[None, 99, None, 0.0], [None, 11, None, 0.0]],
        [[None, None, None, None], [None, 4, None, 3.0]],
        [[None, 0, None, None]],
    ]
    asked = [[last, first] for first in firsts for last in (None, 10)]
    asked += [
        [last, [[k, 1, 20, 5.0]]]
        for last in (8, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21)
        for k in (0, 3, 5, 6)
    ]
    for name, hint in hints.items():
        for back in (True, False) if name in ("fresh", "back") else (True,):
            survey = {"n": 2, "back": back, "setups": ["ppp", "npp", "linear-x"]}
            some = (
                asked
                if name in ("fresh", "middle", "back") and back
                else asked[:: 3 if back else 5]
            )
            yield (
                f"finder-{name}-{'both' if back else 'one'}",
                "finder",
                {"survey": survey, "hints": hint, "spots": SPOTS, "asked": some},
            )


def _tables() -> Iterator[Case]:
    hints = [
        {"outward": outward, "next_stop": stop, "known": known}
        for outward in (True, False)
        for stop in (0, 1, 3, 6)
        for known in ({}, {"0": 0.0})
    ]
    turn = {"stop": 6, "outward": False, "reading_mm": 320.7}
    hints += [
        {"outward": outward, "next_stop": 0, "turn": turn | {"outward": not outward}}
        for outward in (True, False)
    ]
    for back in (True, False):
        survey = {"n": 2, "back": back, "setups": ["ppp"]}
        told = {
            "survey": survey,
            "setup": "ppp",
            "spots": SPOTS,
            "hints": hints,
            "last_count": 10,
            "counts": [None, *range(10, 25), 1010, 1011],
        }
        yield f"directions-{'both' if back else 'one'}", "directions", told
    cube = BOX | {"size_mm": [200.0, 200.0, 200.0]}
    for name, route in (("box", BOX), ("back", BOX | {"outward": False}), ("cube", cube)):
        levels = [
            0.0,
            5.0,
            57.74,
            80.18,
            -57.74,
            -80.18,
            -26.7,
            53.45,
            106.9,
            115.47,
            120.27,
            133.63,
            173.72,
            187.08,
            214.0,
            240.5,
            300.0,
            307.35,
            360.8,
            374.17,
            400.0,
        ]
        sign = -1.0 if name == "back" else 1.0
        taken = [[], [0], [0, 1], [0, 1, 2], [0, 1, 3], [0, 1, 2, 3, 4], [0, 1, 2, 3, 4, 5, 6]]
        yield (
            f"located-{name}",
            "located",
            {
                "route": route,
                "taken": taken,
                "counts": [None, 0, 1, 2, 3],
                "readings": [sign * level + 0.001 for level in levels],
            },
        )


def inputs() -> Iterator[Case]:
    """Yield the name of every case, who plays it, and its input."""
    for cases in (_routes, _laser_places, _turns, _walks, _finders, _tables):
        yield from cases()
