"""Inputs of the reference cases of what daq/capture says of sensors, of the machine and of its
streams."""

from collections.abc import Iterator
from typing import Any

from _capture_kit import BOX, FIXED, SENSOR, UNCOMPENSATED, Case

from testkit.timeline import STOPPED_ONLY

GOOD = {
    "material_temperature_c": 20.1,
    "air_temperature_c": 21.5,
    "air_pressure_hpa": 1013.2,
    "relative_humidity_percent": 45.5,
}
BAD: dict[str, list[Any]] = {
    "material_temperature_c": [
        -41.0,
        -39.9,
        0.0,
        4.9,
        5.1,
        21.05,
        21.15,
        30.0,
        45.0,
        60.0,
        61.0,
        "nan",
    ],
    "air_temperature_c": [0.0, 4.9, 5.1, 23.45, 23.55, 19.45, 40.0, 45.1, 50.1, "nan"],
    "air_pressure_hpa": [
        0.0,
        599.0,
        601.0,
        1015.15,
        1015.25,
        1011.1,
        1011.3,
        1099.0,
        1101.0,
        "nan",
    ],
    "relative_humidity_percent": [-1.0, 0.0, 0.1, 30.4, 30.6, 60.4, 60.6, 99.9, 100.1, "nan"],
}


def _conditions() -> Iterator[Case]:
    def case(name: str, stops: list[Any], *, air: bool = True, **more: Any) -> Case:
        return (
            f"conditions-{name}",
            "conditions",
            {"good": GOOD, "stops": stops}
            | ({"changed": UNCOMPENSATED} if air else {})
            | more,
        )

    silent = dict.fromkeys(GOOD, "nan")
    absent = dict.fromkeys(GOOD)
    for name, values in BAD.items():
        stops: list[Any] = [
            [{name: values[0]}, 5.0],
            [{name: "nan"}, 8.0],
            [{name: "nan"}, 9.0],
            [absent, 10.0],
            [{}, 11.0],
        ]
        for k, value in enumerate(values):
            stops += [
                [{}, 100.0 + 100.0 * k],
                [{name: value}, 110.0 + 100.0 * k],
                [{name: value}, 120.0 + 100.0 * k],
            ]
        yield case(name.replace("_", "-"), stops)
        yield case(f"compensated-{name.replace('_', '-')}", stops[:20], air=False)
    warm = [
        [{"material_temperature_c": value}, 5.0 + k]
        for k, value in enumerate(("nan", 0.0, "nan", 20.0, 45.0))
    ]
    yield case("expansion", warm, air=False, added="[machine]\napply_expansion = true\n")
    creeping = [[{"air_pressure_hpa": 990.0 + 0.4 * k}, 10.0 * k + 10] for k in range(7)]
    restless = [
        [{"air_pressure_hpa": 990.0 + 2.1 * (k % 2)}, 10.0 * k + 100] for k in range(9)
    ]
    yield case("agreed", [[{}, 0.0], *creeping, [{}, 90.0], *restless])
    air = [
        [{"air_temperature_c": 28.4}, 1800.0],
        [{"air_temperature_c": 28.6}, 1810.0],
        [{"material_temperature_c": 26.0}, 3600.0],
    ]
    yield case(
        "hours",
        [
            [{}, 0.0],
            *air,
            [{"material_temperature_c": 33.0}, 7200.0],
            [{"relative_humidity_percent": 98.0}, 7200.0],
            [{}, -100.0],
        ],
    )
    for name, at_once, an_hour in zip(
        GOOD, (1.0, 2.0, 2.0, 15.0), (5.0, 10.0, 5.0, 30.0), strict=True
    ):
        beyond, within = at_once + 0.5 * an_hour + 0.05, at_once + an_hour - 0.05
        yield case(
            f"hour-{name.replace('_', '-')}",
            [
                [{}, 0.0],
                *(
                    [{name: GOOD[name] + off}, s]
                    for off, s in ((beyond, 1800.0), (within, 3600.0))
                ),
            ],
        )
    yield case("fixed", [[{"air_pressure_hpa": 5.0}, 0.0]], air=False, added=FIXED)
    before = {name: {"value": value, "time_s": 940.0} for name, value in GOOD.items()}
    yield case(
        "told-before",
        [[silent, time_s] for time_s in (999.0, 999.999, 1000.001, 1060.0)],
        air=False,
        credible=before,
    )
    pressures = ("nan", 0.0, "nan", "nan", 1013.0, 5.0, 5.0, 1013.0, 5.0)
    yield case(
        "silent-then-wrong",
        [
            [absent | {"air_pressure_hpa": value}, 5000.0 + k]
            for k, value in enumerate(pressures)
        ],
        air=False,
        credible=before,
    )


def _told() -> Iterator[Case]:
    times = (
        ("air_temperature_c", 21.0, 40_000),
        ("air_pressure_hpa", 1000.0, 39_999),
        ("relative_humidity_percent", 44.0, 90_000),
        ("odd", 1.0, 99_000),
        ("material_temperature_c", 20.5, 100_000),
    )
    sensor = '[environment]\nsource = "sensor"\n' + SENSOR
    surveys = [
        {"survey": {"signals": signals}, "added": added}
        for added in ("", sensor)
        for signals in ("", STOPPED_ONLY)
    ]
    surveys.append({"added": FIXED})
    told = {
        "now_ms": [100_000, 99_999, 100_001, 160_000, 161_000],
        "signals": {"air_temperature_c": 3.0},
    }
    yield (
        "sensors",
        "sensors",
        {"surveys": surveys, "told": [list(each) for each in times]} | told,
    )
    few = STOPPED_ONLY + "[plc.signals.x_mm]\naddress = 4\n"
    stopped: dict[str, Any] = {"survey": {"signals": STOPPED_ONLY}}
    cube, square = [200.0, 200.0, 200.0], [200.0, 300.0, 200.0]
    silent = [["poll_hz = 40\n", 'transport = "none"\n']]
    unsaid: list[dict[str, Any]] = [
        {},
        stopped,
        {"survey": {"signals": few, "setups": ["ppp", "npp"]}},
        {"survey": {"signals": STOPPED_ONLY, "size": cube, "setups": ["npp", "linear-x"]}},
        {"survey": {"signals": STOPPED_ONLY, "size": square}},
        {"survey": {"signals": STOPPED_ONLY, "setups": ["linear-x", "linear-y"]}},
        stopped | {"changed": UNCOMPENSATED},
        stopped | {"changed": UNCOMPENSATED, "without": ["air_temperature_c"]},
        stopped | {"changed": UNCOMPENSATED, "added": FIXED},
        stopped | {"changed": UNCOMPENSATED, "added": sensor},
        {"changed": silent, "added": FIXED},
        {
            "survey": {"size": cube, "setups": ["ppp", "linear-z"]},
            "changed": [*silent, *UNCOMPENSATED],
            "added": FIXED,
        },
        {"survey": {"size": cube, "signals": few}},
    ]
    yield "unsaid", "unsaid", unsaid
    record = (
        '{"hints": {"ppp": {}}, "last_count": 5, "skip_open_dwell": true, "beyond": false}'
    )
    yield (
        "starts",
        "starts",
        [
            {},
            *(
                {"start": text}
                for text in (
                    "",
                    "{",
                    "{}",
                    '{"hints": {}}',
                    record,
                    "[" * 300,
                    '{"hints": 5}',
                )
            ),
        ],
    )


def _remarks() -> Iterator[Case]:
    still = [
        (5, 0, 4),
        (5, 100, 104),
        (5, 1500, 1504),
        (5, 1501, 1504.000001),
        (5, 1600, 1700),
        (6, 1800, 1804),
        (6, 3300, 3304.000001),
        (None, 3400, 3404),
        (6, 3500, 3504),
        (6, 9000, 9004),
        (7, 9100, 9104),
    ]
    beats = [[value, send_ms, round(recv_ms * 1e6)] for value, send_ms, recv_ms in still]
    alarms: list[Any] = [
        ["look", False, 0, False],
        ["look", True, 5000, False],
        ["look", True, 6000, True],
        ["look", False, 7000, True],
        *(["doubts", at] for at in (4999, 5000, 9000)),
    ]
    alarms += [
        ["look", True, 8000, True],
        ["look", None, 9000, True],
        ["look", True, 10_000, True],
        ["doubts", 8500],
        ["doubts", 20_000],
        ["look", False, 21_000, False],
        ["look", True, 22_000, False],
    ]
    codes = (
        "garbage g1 0",
        "garbage g2 1000",
        "gap g3 1001",
        "gap g4 1999",
        "device d1 2000",
        "device d2 3100",
        "device d1 4200",
        "restart r 5300",
        "banner b 6400",
        "rate r 7500",
        "environment e 8600",
        "duplicate d 9700",
        "debug d 10800",
    )
    notices = [
        [int(at_ms), code, text] for code, text, at_ms in (each.split() for each in codes)
    ]
    stops = [
        {
            "time_s": 5.0,
            "material_temperature_c": 20.0,
            "air_temperature_c": 21.0,
            "held": ["air_temperature_c"],
        },
        {"doubtful": "old", "air_pressure_hpa": 1000.0},
        {"doubtful": "old", "doubt_codes": ["code"]},
        {"doubt_codes": ["other"], "doubtful": "x"},
    ]
    lost = ["3 bytes; 5 overruns", "7 bytes", "8 overruns; parity 3", "9 overruns"]
    walks = [[BOX, 3], [BOX, 6], [BOX, 7], [BOX | {"outward": False}, 0]]
    told = {
        "beats": beats,
        "alarms": alarms,
        "wall_ns": 1_700_000_000_000_000_000,
        "walks": walks,
        "notices": notices,
    }
    yield "remarks", "remarks", told | {"lost": lost, "stops": stops}


def inputs() -> Iterator[Case]:
    """Yield the name of every case, who plays it, and its input."""
    for cases in (_conditions, _told, _remarks):
        yield from cases()
