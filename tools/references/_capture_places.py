"""Inputs of the reference cases of daq/capture/naming: routes, what is known of a route, walks, the
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
            | {
                "origin_mm": [0.0, 0.0, 0.0] if outward else [5.0, -10.0, 20.0],
                "places": places,
            }
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
    beyond: list[Any] = [
        [1.0, 0.0, [a, b]] for a, b in ((0, 1), (0, 2), (1, 2), (1, 3), (2, 3))
    ]
    yield "route-short", "routes", short | {"shares": beyond, "absolutes": [5.0]}
    pairs_of = [
        (nominal, off) for nominal in (0.0, 1.0, -50.0, 100.0) for off in (0.019, 0.021)
    ]
    agreeing = [
        [measured, nominal]
        for nominal, off in pairs_of
        for measured in (nominal * 1.02 + off, nominal * 0.98 - off, nominal * 1.01, -nominal)
    ]
    yield "agreeing", "agreeing", agreeing


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
            {
                "route": BOX,
                "bare": bare,
                "stops": [[k % 7, off] for k, off in enumerate(offs)],
            },
        )
    rounded = [
        [k % 7, [off, 0.0, 0.0]]
        for k, off in enumerate((0.0005, 0.00099, 0.0011, 0.0017, 0.3, 0.44, 0.46, -0.7))
    ]
    yield "positions-rounded", "positions", {"route": BOX, "bare": True, "stops": rounded}


def _names() -> Iterator[Case]:
    """Yield standstills: stop whose position is shown, counter, reading, and whether the count was
    lost before."""
    cube = BOX | {"size_mm": [200.0, 200.0, 200.0]}
    on = [[None, None, reading] for reading in NOMINAL]
    counted = [[None, 9 + number, reading] for number, reading in enumerate(NOMINAL)]
    placed = [[number, 9 + number, reading] for number, reading in enumerate(NOMINAL)]
    steps = [115.4700538 * number for number in range(7)]
    for name, looks in (("laser", on), ("counted", counted), ("placed", placed)):
        yield (
            f"names-{name}",
            "names",
            {"route": BOX, "spots": SPOTS, "last_count": 8, "looks": looks},
        )
        yield (
            f"names-{name}-again",
            "names",
            {
                "route": BOX,
                "spots": SPOTS,
                "last_count": 8,
                "looks": [*looks[:4], *looks[1:]],
            },
        )
        yield (
            f"names-{name}-missed",
            "names",
            {
                "route": BOX,
                "spots": SPOTS,
                "last_count": 8,
                "looks": [*looks[:2], *looks[4:]],
            },
        )
        held = [None, looks[2][1], 0.5 * (NOMINAL[2] + NOMINAL[3])]
        yield (
            f"names-{name}-held",
            "names",
            {
                "route": BOX,
                "spots": SPOTS,
                "last_count": 8,
                "looks": [*looks[:3], held, *looks[3:]],
            },
        )
        lost = [[*looks[3], True], *looks[4:]]
        yield (
            f"names-{name}-lost",
            "names",
            {"route": BOX, "spots": SPOTS, "last_count": 8, "looks": [*looks[:3], *lost]},
        )
        slipped = [[stop, count, reading + 0.5] for stop, count, reading in looks[3:]]
        yield (
            f"names-{name}-slipped",
            "names",
            {"route": BOX, "spots": SPOTS, "last_count": 8, "looks": [*looks[:3], *slipped]},
        )
    yield "names-home", "names", {"route": BOX, "looks": [[None, None, -40.0], *on]}
    yield (
        "names-stuck",
        "names",
        {"route": BOX, "last_count": 8, "looks": [[None, 9, reading] for reading in NOMINAL]},
    )
    yield (
        "names-cube-lost",
        "names",
        {
            "route": cube,
            "looks": [
                [None, None, each, *([True] if k == 3 else [])]
                for k, each in enumerate(steps)
            ],
        },
    )
    anew = [[None, None, each] for each in (*steps[:4], *(5.0 + each for each in steps))]
    yield (
        "names-cube-anew",
        "names",
        {
            "route": cube,
            "looks": [[*each, True] if k == 4 else each for k, each in enumerate(anew)],
        },
    )
    yield (
        "names-resumed",
        "names",
        {"route": BOX, "after": 3, "known": {"3": NOMINAL[3]}, "looks": on[2:]},
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
            "ppp": {
                "next_stop": 3,
                "last_reading_mm": 133.6,
                "known": {"2": 133.6, "1": 80.2},
            }
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


def inputs() -> Iterator[Case]:
    """Yield the name of every case, who plays it, and its input."""
    for cases in (_routes, _turns, _names, _finders, _tables):
        yield from cases()
