"""Inputs of the reference cases of daq/capture/standing: windows, plateaus, dwells on a stream,
standstills in parts, a head's stream."""

from collections.abc import Iterator
from typing import Any

from _capture_kit import BOX, Case, Series, added, at_mm, noise, spiked, step

MS = 1_000_000


def _told(um: Series, rate_hz: float = 1000.0, resolution_um: float = 0.002) -> list[Any]:
    return [rate_hz, resolution_um, 512.0, um]


def _alike(count: int) -> Series:
    return [["alike", count, 4, 0.9, 0.3]]


def _windows() -> Iterator[Case]:
    small = [
        [0.5],
        [0.5, 0.7],
        [0.5, 0.7, 0.2],
        noise(7, 1),
        noise(8, 1),
        noise(9, 2),
        [["same", 12, 1.0]],
        [["same", 5, 1.0], 1.1],
    ]
    few = [
        _told(um)
        for um in [
            *small,
            [0.0, 0.0],
            [["turns", 20, 0.0, 0.001, 0.002, 0.0032]],
            [["turns", 20, 0.0, 0.0031, 0.0062]],
        ]
    ]
    few += [
        _told([["turns", 20, 0.0, 0.1, 0.2]], 50.0),
        _told([["same", 30, 0.0]], 1000.0, 0.1),
        _told([["same", 30, 0.0]], 1000.0, 0.0005),
    ]
    few += [[0.0, 0.002, 3.0, noise(6, 3)], [0.0, 0.002, 3.0, noise(20, 3)]]
    yield "windows-small", "windows", few
    shaken = added(
        noise(300, 5),
        [["turns", 300, *(round(3.0 * (k * 37 % 100 / 50 - 1), 3) for k in range(100))]],
    )
    counts = [_told(_alike(count)) for count in (400, 255, 256, 257, 511, 512, 33)]
    more = [
        noise(513, 6),
        shaken,
        [["turns", 64, 0.5, -0.5]],
        [["turns", 64, *map(float, range(8))]],
        [["line", 300, 0.0, 0.4]],
    ]
    more += [noise(258, 61, 5.0), [["line", 257, 0.0, 0.0021]], [["line", 258, 0.0, 0.0021]]]
    yield "windows-alike", "windows", [*counts, *map(_told, more)]
    drifts = [
        added(noise(200, 7, 0.1), [["line", 200, 0.0, slope / 1000]])
        for slope in (2.0, 5.0, 20.0, 60.0, -40.0)
    ]
    yield (
        "windows-drifting",
        "windows",
        [
            *map(_told, drifts),
            _told(added(noise(200, 8, 0.1), [["fading", 200, 30.0, 0.97]])),
        ],
    )
    for count in (60, 200):
        places = (
            (0.1, 4.0),
            (0.13, 4.0),
            (0.2, 0.4),
            (0.3, 0.6),
            (0.5, -1.2),
            (0.5, 0.8),
            (0.6, 12.0),
            (0.85, 5.0),
            (0.9, 5.0),
            (0.95, 5.0),
        )
        stepped = [
            _told(added(noise(count, 9, 0.15), step(count, round(count * at), size)))
            for at, size in places
        ]
        for share in (0.02, 0.1, 0.2, 0.4, 0.6):
            first, rising = round(0.4 * count), round(share * count)
            slow = [
                ["same", first, 0.0],
                ["line", rising, 0.0, 6.0 / rising],
                ["same", count - first - rising, 6.0],
            ]
            stepped.append(_told(added(noise(count, 10, 0.05), slow)))
        yield f"windows-stepped-{count}", "windows", stepped
    sizes = [
        added(noise(count, 11, 0.1), step(count, count // 2, 5.0))
        for count in (6, 7, 8, 9, 31, 32, 33, 63, 64, 65)
    ]
    sizes += [
        added(noise(64, 12, sigma), step(64, 30, 3.0)) for sigma in (0.4, 0.5, 0.6, 0.8)
    ]
    sizes += [
        added(noise(64, 13, 0.05), step(64, 20, 3.0), step(64, 44, back))
        for back in (-3.0, -1.5, 1.5, 3.0)
    ]
    sizes += [
        added(noise(96, 131, 0.02), step(96, at, size))
        for at in (11, 12, 13, 48, 83, 84, 85)
        for size in (0.45, 0.55)
    ]
    yield "windows-steps-of-few", "windows", list(map(_told, sizes))
    uneven: list[Series] = [
        [-2.5, 2.25, ["same", 18, 5.0]],
        [-3.5, 3.15, 0.0, ["same", 21, 5.0]],
        [["same", 18, 5.0], 2.25, -2.5],
    ]
    uneven += [
        [["same", at, 0.0], ["same", count - at, 5.0]]
        for count, at in ((12, 1), (12, 11), (96, 9), (96, 87), (15, 2), (16, 1))
    ]
    yield "windows-steps-near-the-edge", "windows", list(map(_told, uneven))
    wrong = [
        spiked(noise(120, 14), {(k * 23 + 5) % 100: 40.0 + k for k in range(count)})
        for count in (1, 3, 4, 5, 6, 8)
    ]
    wrong += [spiked(noise(120, 14), {50: size, 70: -size}) for size in (0.9, 1.4, 2.0)]
    wrong += [
        spiked(noise(520, 141), {k * 57 % 500: -30.0 - k for k in range(count)})
        for count in (7, 8, 9)
    ]
    wrong += [
        spiked(noise(100, 14), {(k * 23 + 5) % 90: 40.0 + k for k in range(count)})
        for count in (4, 5)
    ]
    yield "windows-spiked", "windows", list(map(_told, wrong))
    leaving = [
        spiked(noise(120, 15), {120 - gone + k: 12.0 * (k + 1) ** 2 for k in range(gone)})
        for gone in (7, 12, 13, 20)
    ]
    tails = (
        [50.0] * 7,
        [10.0, 20.0, *[30.0] * 4],
        [14.0, 16.0, *[30.0] * 4],
        [16.0, *[30.0] * 5],
        [-9.0, -30.0, *[-50.0] * 3],
        [30.0, 20.0, -40.0, -50.0, -60.0, -70.0],
    )
    leaving += [[["noise", 120 - len(tail), 15, 0.2], *tail] for tail in tails]
    yield "windows-leaving", "windows", list(map(_told, leaving))
    runs = ((20, 9), (20, 10), (18, 9), (19, 10), (21, 10), (30, 14), (30, 15), (60, 40))
    frozen: list[Series] = [
        [["noise", count - same, 16, 0.2], ["same", same, 0.25]] for count, same in runs
    ]
    frozen += [
        [["same", 12, 0.25], ["noise", 8, 17, 0.2]],
        [0.5, ["same", 12, 0.25], ["noise", 8, 17, 0.2]],
        [["same", 9, 0.25]],
        [["same", 10, 0.25]],
    ]
    yield "windows-frozen", "windows", list(map(_told, frozen))


def _plateaus() -> Iterator[Case]:
    moves: Series = []
    last = 0.0
    for level, stand in ((0.0, 60), (20.0, 40), (40.0, 25), (60.0, 8), (80.0, 30)):
        moves += [
            ["line", 10, last + (level - last) / 10, (level - last) / 10],
            *at_mm(level, noise(stand, stand)),
        ]
        last = level
    gaps = [
        ["line", 31, 0, 10 * MS],
        ["line", 30, 380 * MS, 10 * MS],
        ["line", 30, 730 * MS, 10 * MS],
        ["line", 29, 1070 * MS, 10 * MS],
    ]
    levels = [
        part
        for k in range(8)
        for part in (["same", 20, round(0.0029 * k + 0.0002 * (k // 3), 6)],)
    ]
    streams = [
        {"from_ns": 5 * MS, "every_ns": 10 * MS, "mm": moves},
        {"every_ns": 10 * MS, "mm": [["line", 120, 0.0, 0.0001]]},
        {"every_ns": 10 * MS, "mm": [["line", 120, 0.0, 0.0016]]},
        {"time_ns": gaps, "mm": at_mm(0.0, noise(120, 3))},
        {"every_ns": 4 * MS, "mm": levels},
        {"mm": [1.0]},
        {"every_ns": 30 * MS, "mm": [1.0, 1.0]},
        {"mm": []},
    ]
    yield (
        "plateaus",
        "plateaus",
        [stream | {"at_least_s": [0.0, 0.06, 0.21, 0.34, 0.41, 0.5]} for stream in streams],
    )


def _certain() -> Iterator[Case]:
    quiet = at_mm(10.0, noise(300, 21))
    settling = at_mm(10.0, added([["fading", 300, 50.0, 0.97]], noise(300, 22)))
    come: Series = [["line", 40, -10.0, 0.5]]
    late = [["turns", 340, 3 * MS, 4 * MS, 5 * MS]]
    base = {
        "from_ns": 0,
        "every_ns": 5 * MS,
        "late_ns": late,
        "resolution_um": 0.05,
        "beam": [["turns", 340, 0.5, 0.501, 0.502, 0.51]],
    }
    rules = {"settle_s": 0.2, "min_window_s": 0.3}
    breaks = [
        [700 * MS, "beam lost", True],
        [1000 * MS, "no sample", False],
        [1601 * MS, "after", True],
        [2101 * MS, "far after", True],
        [200 * MS, "before", True],
    ]
    dwells = [
        [200, 1600],
        [200, 700],
        [200, 690],
        [200, 412],
        [200, 408],
        [200, 200],
        [1690, 1700],
    ]
    steps_mm = [20.0, -20.0, 0.9, 0.5, 0.08, 0.079, -0.08, 0.0]
    plateaus = [
        [0, 1700, 10.0],
        [0, 1700, 10.01],
        [0, 1700, 10.021],
        [300, 900, 10.0],
        [300, 550, 10.0],
    ]
    for name, mm, lost in (
        ("quiet", quiet, []),
        ("settling", settling, []),
        ("broken", quiet, breaks),
        ("broken-settling", settling, breaks[:2]),
    ):
        stream = base | {"mm": [*come, *mm], "breaks": lost}
        yield (
            f"certain-{name}",
            "certain",
            {
                "stream": stream,
                "rules": rules,
                "dwells_ms": dwells,
                "steps_mm": steps_mm,
                "plateaus": plateaus,
            },
        )
    for name, changed in (
        ("unusable", {"unusable": [["line", 120, 90, 2]]}),
        ("mostly-unusable", {"unusable": [["line", 4, k, 1] for k in range(81, 340, 5)]}),
        ("dark", {"unusable": [["line", 280, 60, 1]]}),
        ("finer", {"resolution_um": 0.0001}),
        ("unknown", {"beam": [["same", 340, -1.0]]}),
        ("scatters", {"mm": [*come, *at_mm(10.0, noise(300, 23, 3.0))]}),
        (
            "half-scatters",
            {"mm": [*come, *at_mm(10.0, [["noise", 150, 24, 3.0], ["noise", 150, 24, 0.2]])]},
        ),
        ("jumps", {"mm": [*come, ["same", 150, 10.0], ["same", 150, 10.004]]}),
        ("frozen", {"mm": [*come, ["same", 300, 10.0]], "resolution_um": 0.021}),
    ):
        for at, allowed_um in (("", 0.15), ("-by-default", None)):
            told = {
                "stream": base | {"mm": [*come, *quiet]} | changed,
                "rules": rules | ({"max_scatter_um": allowed_um} if allowed_um else {}),
            }
            yield (
                f"certain-{name}{at}",
                "certain",
                told | {"dwells_ms": dwells[:3], "steps_mm": steps_mm[:2]},
            )
    thrice = base | {
        "mm": [*come, *at_mm(10.0, noise(300, 23, 3.0))],
        "breaks": [[600 * MS, "b", True], [1000 * MS, "c", False]],
    }
    dwells_ms = [[200, 1010], [200, 999], [200, 1000], [200, 1001], [200, 1500]]
    yield (
        "certain-broken-doubtful",
        "certain",
        {"stream": thrice, "rules": rules | {"max_scatter_um": 0.15}, "dwells_ms": dwells_ms},
    )
    approaches: dict[str, Series] = {
        "back": [["same", 10, 12.0], ["line", 40, 9.5, -0.5], ["same", 30, 10.0]],
        "near": [["same", 20, 9.9], ["same", 30, 10.0]],
        "beyond": [*come, ["same", 3, 10.3], ["same", 30, 10.0]],
        "beyond-shortly": [*come, ["same", 2, 10.3], ["same", 30, 10.0]],
        "edge": [["same", 3, 9.79], ["same", 40, 10.0]],
        "at-edge": [["same", 3, 9.81], ["same", 40, 10.0]],
        "two": [["same", 2, 9.0], ["same", 30, 10.0]],
    }
    counts = {
        "back": 80,
        "near": 50,
        "beyond": 73,
        "beyond-shortly": 72,
        "edge": 43,
        "at-edge": 43,
        "two": 32,
    }
    short = {"settle_s": 0.05, "min_window_s": 0.1}
    towards = [20.0, -20.0, 0.8, 0.4, 0.08, 0.07]
    for name, mm in approaches.items():
        stream = {
            "every_ns": 10 * MS,
            "mm": mm,
            "resolution_um": 0.1,
            "breaks": [[5000 * MS, "beam lost", True]],
        }
        begins = 10 * (counts[name] - 30)
        asked = [[begins, begins + 290], [begins + 100, begins + 290]]
        yield (
            f"approach-{name}",
            "certain",
            {"stream": stream, "rules": short, "dwells_ms": asked, "steps_mm": towards},
        )
    lost = {
        "every_ns": 10 * MS,
        "mm": [*come, ["same", 60, 10.0]],
        "breaks": [[390 * MS, "b", True]],
    }
    yield (
        "approach-lost",
        "certain",
        {
            "stream": lost,
            "rules": short,
            "dwells_ms": [[400, 900], [500, 900], [5410, 5500]],
            "steps_mm": [20.0],
        },
    )
    long_ago = {
        "time_ns": [["line", 40, 0, 10 * MS], ["line", 40, 5_300 * MS, 10 * MS]],
        "mm": [*come, ["same", 40, 10.0]],
    }
    asked = [[begin, 5680] for begin in (5300, 5330, 5400, 5450)]
    yield (
        "approach-long-ago",
        "certain",
        {"stream": long_ago, "rules": short, "dwells_ms": asked, "steps_mm": [20.0]},
    )
    spans = [
        [count, unusable, seconds, 0.05]
        for count in (0, 2, 3, 4, 20)
        for unusable in (0, 3, 4, 20, 21)
        for seconds in (0.149, 0.151, 0.5)
    ]
    yield "taken", "taken", {"rules": rules, "spans": [*spans, [5, 0, 0.5, 0.0]]}


def _dwells() -> Iterator[Case]:
    one, other = (
        {"stopped": True, "at": [0.0, 0.0, 0.0], "stop_count": 1},
        {"stopped": True, "at": [100.0, 0.0, 0.0], "stop_count": 2},
    )
    near = [
        {"stopped": True, "at": at}
        for at in (
            [0.04, 0.0, 0.0],
            [0.0, 0.049, 0.0],
            [0.0, 0.0, 0.11],
            [0.0, 0.06, 0.11],
            [5.0, 0.0, 0.0],
            [5.01, 0.0, 0.0],
        )
    ]
    third = {"stopped": True, "stop_count": 3}
    silent: dict[str, Any] = {}
    told: list[Any] = [
        {},
        one,
        one,
        other,
        other,
        None,
        other,
        None,
        {},
        {"stopped": False},
        None,
        other,
        None,
        one,
        None,
        None,
        {},
        {"stopped": True},
        *near[:4],
        third,
    ]
    told += [
        third | {"at": [9.0, 0.0, 0.0]},
        510,
        third,
        100,
        {},
        580,
        *near[4:],
        near[5],
        2000,
        near[5],
        {},
        one,
        1010,
        one,
        None,
        1040,
        one,
        {},
        other,
        {},
    ]
    steps: list[Any] = []
    for k, each in enumerate(told):
        steps.append(
            ["silent", 0]
            if each is None
            else ["stale", each]
            if isinstance(each, int)
            else ["poll", 25 * k, silent | each]
        )
    yield (
        "dwells",
        "dwells",
        {
            "steps": steps,
            "counts": [
                [before, after]
                for before in (0, 1, 65535, 65530)
                for after in (0, 1, 65535, 3)
            ],
        },
    )


def _standstills() -> Iterator[Case]:
    def shifted(first: int, count: int, mm: float) -> Series:
        return [["same", first, 1.0], ["same", count, mm], ["same", 400 - first - count, 1.0]]

    every = {"every_ns": 10 * MS}
    streams: dict[str, Any] = {
        "still": every | {"mm": at_mm(1.0, noise(400, 31))},
        "moved": every
        | {"mm": [["same", 100, 1.0], ["line", 20, 1.0, 0.5], ["same", 280, 11.0]]},
        "shaken": every | {"mm": shifted(100, 3, 1.03)},
        "halved": every | {"mm": shifted(90, 23, 1.021)},
        "half": every | {"mm": shifted(96, 5, 1.021)},
        "within": every | {"mm": shifted(90, 23, 1.019)},
        "crept": every | {"mm": [["line", 400, 1.0, 0.0009]]},
        "cut": every
        | {"mm": at_mm(1.0, noise(400, 31)), "breaks": [[1050 * MS, "beam lost", True]]},
        "few": {"every_ns": 90 * MS, "mm": [["same", 40, 1.0]]},
        "blind": None,
    }
    spans = ((1100, 1500), (1299, 1600), (1300, 1600), (1020, 1020), (1100, 1120))
    ways = (
        (),
        (400, 1),
        (1050, 1),
        (1050, 2),
        (1050, 1, 7.0),
        (500, 1),
        (501, 1),
        (1050, None),
        (450, None),
        (1050, None, None),
    )
    pairs = [[[500, 1000], [*span, *more]] for span in spans for more in ways]
    pairs += [
        [[900, 1000, None, 1, 0.0, True], [1100, 1200, 400, 2]],
        [[900, 1000], [1100, 1200, 400, 2, 0.0, True]],
        [[900, 1000], [1100, 1201, 1050, 1]],
    ]
    pairs += [
        [[900, 1000], [1100, 1199, 1050, 1]],
        [[900, 1000], [1100, 1199, 400, 2]],
        [[900, 1000, 800, None, None], [1100, 1200, 400, None, None]],
    ]
    yield "standstills", "standstills", {"streams": streams, "pairs": pairs}
    fine = {
        name: {
            "every_ns": MS,
            "mm": [["same", 1100, 1.0], ["same", count, 1.5], ["same", 900 - count, 1.0]],
        }
        for name, count in (("begins", 9), ("begins-long", 12), ("moves", 30))
    }
    soon: list[Any] = [
        [[500, 1000], [1100, to_ms, 1050, 1]] for to_ms in (1100, 1105, 1119, 1121, 1400)
    ]
    even: list[Any] = [
        [[900, 1000], [1100, 1200, 1050, 1]],
        [[900, 1000], [1101, 1200, 1050, 1]],
        [[900, 1000], [1100, 1200, 899, 1]],
    ]
    yield "standstills-begun", "standstills", {"streams": fine, "pairs": soon}
    yield (
        "standstills-as-long",
        "standstills",
        {"streams": {"still": streams["still"]}, "pairs": even},
    )
    waits: list[Any] = [
        ["add", [500, 1000]],
        ["add", [1100, 1150, 1050, 1]],
        *(["settled", now, None] for now in (1599, 1600, 1601)),
    ]
    yield (
        "standstill-parts-unseen",
        "parts",
        {"stream": {"every_ns": 10 * MS, "mm": [["same", 110, 1.0]]}, "steps": waits},
    )
    for count in (1, 2, 3):
        late = {"time_ns": [1000 * MS, 1104 * MS, 1110 * MS][:count], "mm": [1.0] * count}
        at = [1000, 1000]
        asked: list[Any] = [
            ["add", [500, 1000]],
            ["are", at],
            *(["settled", now, at] for now in (1200, 1500, 1499)),
            ["take"],
            ["goes_on", at],
            ["goes_on", [1000, 1000, None, None]],
        ]
        yield f"standstills-of-{count}", "parts", {"stream": late, "steps": asked}
    parts: list[Any] = [
        ["add", [500, 700, 400, 1, 0.0]],
        ["add", [720, 800, 600, 1, 0.0]],
        ["add", [820, 1100, 600, 2, 5.0]],
        ["settled", 1150, None],
        ["settled", 1399, None],
        ["settled", 1400, None],
    ]
    parts += [
        ["are", [1120, 1300, 600, 2, 5.0]],
        ["settled", 1700, [1120, 1300, 600, 2, 5.0]],
        ["take"],
        ["goes_on", [1120, 1300, 600, 2, 5.0]],
        ["add", [1120, 1300, 600, 2, 5.0]],
        ["add", [1900, 2000, 1800, 3, 9.0]],
    ]
    parts += [
        ["are", [2010, 2100]],
        ["settled", 2600, None],
        ["take"],
        ["settled", 2600, None],
        ["take"],
        ["goes_on", [2010, 2100, 1800, 3, 9.0]],
    ]
    for name in ("still", "moved", "blind"):
        yield (
            f"standstill-parts-{name}",
            "parts",
            {"stream": streams[name] or {"mm": []}, "steps": parts},
        )


def _heads() -> Iterator[Case]:
    count = 120
    light = spiked([["same", count, 1e6]], {50: 0.0, 51: -5.0})
    spot, slow = noise(count, 41, 400.0), noise(count, 42, 160.0)
    channels = [
        added([["same", count, 1e4]], spot),
        added([["same", count, -2e4]], slow),
        light,
        [["line", count, 0.0, 3.0]],
        [["same", count, 5.0]],
        [["same", count, 2e6]],
        noise(count, 43, 9.0),
        [["same", count, 9.0]],
        [["same", count, 1e6]],
    ]
    flags = spiked(
        [["same", count, 0]], {60: 1, 61: 1, 70: 32, 71: 64, 80: 128, 81: 128, 82: 128}
    )
    head = {
        "every_ns": 10 * MS,
        "mm": [["same", count, 0.0]],
        "flags": flags,
        "unusable": [60, 61],
        "breaks": [[5, "beam lost", True]],
        "resolution_um": 0.5,
    }
    laser = {"every_ns": 20 * MS, "mm": [["line", 30, 7.0, 0.001]]}
    rest = {
        "laser": laser,
        "route": BOX | {"setup": "fourdof-z", "n": 3},
        "rules": {"settle_s": 0.05, "min_window_s": 0.2},
    }
    spans = [
        [0, 1190],
        [100, 520],
        [600, 900],
        [0, 20],
        [5000, 6000],
        [500, 510],
        [700, 705],
        [650, 750],
        [800, 1100],
    ]
    yield "heads", "heads", {"head": head | {"channels": channels}, "dwells_ms": spans} | rest
    lively = [channels[1], channels[0], *channels[2:]]
    yield (
        "heads-lively",
        "heads",
        {"head": head | {"channels": lively}, "dwells_ms": spans[:2]} | rest,
    )
    yield "heads-without-channels", "heads", {"head": head, "dwells_ms": spans[:2]} | rest


def inputs() -> Iterator[Case]:
    """Yield the name of every case, who plays it, and its input."""
    for cases in (_windows, _plateaus, _certain, _dwells, _standstills, _heads):
        yield from cases()
