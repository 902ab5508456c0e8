"""Inputs of the reference cases of whole logs: machines that do what machines in halls do, with
signals and without."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from _capture_kit import FIXED, NOMINAL, SENSOR, UNCOMPENSATED, Case

from testkit.timeline import STOPPED_ONLY, diagonal

TRUTH, BACK = diagonal("ppp", n=2), diagonal("ppp", n=2, back=True)
COUNTED = (
    STOPPED_ONLY + "[plc.signals.stop_count]\naddress = 1\n[plc.signals.setup]\naddress = 3\n"
)
SIGNALS = {"whole": "", "counted": COUNTED, "stopped": STOPPED_ONLY}
STARTS = [round(1.0 + 1.1 * k, 1) for k in range(12)]
"""Arrivals: a lead of 1 s, then 0.7 s of dwell and 0.4 s of move."""
HEAD = """
[head]
format = "fourdof"
port = "/dev/null1"
id = "head 1"
calibration = "head-1.json"
[head.fourdof]
encoding = "ascii"
rate_hz = 50.0
"""
SILENT = [["poll_hz = 40\n", 'transport = "none"\n']]

OVERRUN = replace(
    TRUTH[-1], reading=TRUTH[-1].reading + 3.0, seconds=0.1, shown=False, counts=0
)
BEYOND = replace(TRUTH[4], reading=TRUTH[4].reading + 3.0, seconds=0.1, shown=False, counts=0)
BEFORE = replace(TRUTH[0], reading=TRUTH[0].reading - 3.0, seconds=0.1, shown=False, counts=0)
TURNED = [*TRUTH, *BACK[1:]]
OTHER = diagonal("npp", n=2)
OVERRAN = [*TRUTH, OVERRUN, *BACK]


def _case(
    name: str,
    stops: list[Any],
    *,
    signals: str = "",
    back: bool = False,
    machine: dict[str, Any] | None = None,
    **told: Any,
) -> Case:
    rows: list[list[Any]] = []
    for each in stops:
        rest = [
            each.setup,
            0.7 if each.seconds == 0.8 else each.seconds,
            each.counts,
            int(each.shown),
        ]
        rows.append(
            [
                *each.position,
                round(each.reading, 4),
                *(rest if rest != [1, 0.7, 1, 1] else []),
            ]
        )
    survey = {"signals": signals} if signals else {}
    survey |= {"back": True} if back else {}
    survey |= told.pop("of_survey", {})
    return (
        f"log-{name}",
        "log",
        {"survey": survey, "machine": machine or {}, "stops": rows} | told,
    )


def _at(stop: int, since_s: float) -> float:
    return round(STARTS[stop] + since_s, 3)


def _passes() -> Iterator[Case]:
    """Yield one pass out, as each kind of signals shows it."""
    hidden = [replace(stop, shown=k != 3) for k, stop in enumerate(TRUTH)]
    past = [
        replace(stop, seconds=0.02 if k == 4 else 0.8, shown=k != 4)
        for k, stop in enumerate(TRUTH)
    ]
    held = replace(
        TRUTH[3],
        reading=(TRUTH[2].reading + TRUTH[3].reading) / 2,
        position=(150.0, 100.0, 25.0),
        counts=0,
    )
    for words, signals in SIGNALS.items():
        yield _case(f"hidden-{words}", hidden, signals=signals)
        yield _case(f"held-{words}", [*TRUTH[:3], held, *TRUTH[3:]], signals=signals)
        yield _case(f"anew-{words}", [*TRUTH[:4], *TRUTH[:5]], signals=signals)
        yield _case(
            f"beam-lost-inside-{words}",
            TRUTH[:6],
            signals=signals,
            machine={"beam_lost": [[_at(3, 0.4), _at(3, 0.42)]]},
        )
        if words != "whole":
            yield _case(
                f"twice-{words}",
                [*TRUTH[:3], TRUTH[2], *TRUTH[3:]],
                signals=signals,
                machine={"move_s": 0.3},
            )
            yield _case(f"driven-past-{words}", past, signals=signals)
            yield _case(f"overrun-{words}", OVERRAN, signals=signals, back=True)
    first = [replace(stop, shown=k != 1) for k, stop in enumerate(TRUTH[:5])]
    two = [replace(stop, shown=k not in (2, 3)) for k, stop in enumerate(TRUTH[:6])]
    for words, signals in SIGNALS.items():
        yield _case(f"hidden-first-{words}", first, signals=signals)
        yield _case(f"hidden-two-{words}", two, signals=signals)
    yield _case(
        "unwatched-twice",
        TRUTH[:5],
        machine={"move_s": 2.0, "deaf": [[7.2, 7.9], [8.1, 8.95]]},
    )
    yield _case(
        "beam-lost",
        TRUTH[:6],
        machine={"beam_lost": [[_at(3, 0.74), _at(3, 0.8)], [_at(3, 0.9), _at(3, 0.96)]]},
    )
    yield _case(
        "beam-lost-stopped",
        TRUTH[:6],
        signals=STOPPED_ONLY,
        machine={"beam_lost": [[_at(3, 0.8), _at(3, 0.9)]]},
    )


def _machines() -> Iterator[Case]:
    """Yield one pass, or the beginning of one, with something odd about it."""
    machines: dict[str, dict[str, Any]] = {
        "clean": {},
        "lagging": {
            "late_s": {"position": 0.2, "count": 0.1, "stopped": 0.02},
            "flicker": [[0.3, 0.4]],
        },
        "running-in": {"running_in": True, "late_s": {"position": 0.4}},
        "restless": {"noise_um": 3.0, "dither_um": 4.0, "drift_um_s": 2.5},
        "coarse": {"resolution_mm": 0.001},
        "slips": {"slips": [[_at(2, 0.9), 0.5], [_at(4, 0.4), 0.004]]},
        "slip-huge": {
            "slips": [[_at(3, 0.4), 2.0]],
            "spikes": [[_at(2, 0.4), 3.0], [_at(4, 0.5), -0.1]],
        },
        "stuck": {"stuck": [_at(2, -0.1), _at(2, 0.8)], "rate_hz": 250.0, "noise_um": 0.02},
        "garbage": {"garbage_at": [2.0, 2.1, 5.0]},
        "deaf": {"deaf": [[_at(2, 0.2), _at(2, 0.8)], [_at(4, 0.1), _at(4, 1.2)]]},
        "poll-gaps": {"poll_gaps": [[_at(1, 0.1), _at(1, 0.5)], [_at(2, -0.2), _at(3, 0.2)]]},
        "frozen": {"frozen": [_at(3, 0.3), _at(5, 0.4)]},
        "alarms": {"alarm": [_at(3, 0.3), _at(4, 0.9)]},
        "aborted": {"aborted_s": _at(4, -0.2)},
        "aborted-inside": {"aborted_s": _at(4, 0.5)},
        "zeroed": {"zeroed_at": [_at(3, -0.2)]},
        "count-reset": {"words": {"1": [[_at(k, -0.2), k + 4] for k in (3, 4, 5, 6)]}},
        "count-stuck": {"words": {"1": [[_at(3, -0.2), 65533]]}},
        "count-ahead": {"words": {"1": [[_at(3, -0.2), 0], [_at(4, -0.2), 3]]}},
        "setup-changes": {"words": {"3": [[_at(4, -0.2), 2]]}},
        "setup-none": {"words": {"3": [[_at(4, -0.2), 0]]}},
        "setup-foreign": {"words": {"3": [[0.0, 3]]}},
        "links": {
            "links": [
                [1.5, "laser", "connected", "bytes lost: 5 overruns"],
                [_at(2, 0.9), "laser", "lost", "gone"],
                [_at(3, 0.2), "machine", "lost", ""],
                [_at(3, 0.25), "machine", "connected", ""],
                [_at(4, 0.2), "loss", 12, 3456],
                [_at(5, 0.3), "laser", "silent", ""],
                [_at(5, 0.4), "head", "lost", ""],
            ]
        },
        "over": {"over_mm": [[_at(3, -0.2), _at(3, -0.02), 2.0]]},
        "slow-polls": {"poll_hz": 5.0, "rate_hz": 20.0},
        "bad-start": {"beam_lost": [[0.2, 0.6]], "alarm": [0.2, 0.5]},
    }
    for name, machine in machines.items():
        yield _case(
            name,
            TRUTH if name in ("clean", "links", "setup-changes") else TRUTH[:6],
            machine=machine,
        )
    air = {
        "10": [[_at(k, -0.2), 2010 + 30 * k] for k in range(4)] + [[_at(4, -0.2), -3000]],
        "11": [[_at(k, -0.2), 2150 + 100 * k] for k in range(6)],
    }
    jumps = air | {
        "13": [[0.0, 0], [_at(3, -0.2), 455]],
        "12": [[_at(2, -0.2), 9000], [_at(3, -0.2), 10132]],
        "5": [[0.0, 20]],
    }
    yield _case("warm-up", TRUTH[:6], machine={"words": jumps}, changed=UNCOMPENSATED)
    for name in ("restless", "slips", "links", "deaf", "poll-gaps", "bad-start"):
        for words in ("counted", "stopped"):
            if words == "stopped" or name in ("poll-gaps", "slips"):
                yield _case(
                    f"{name}-{words}",
                    TRUTH[:6],
                    signals=SIGNALS[words],
                    machine=machines[name],
                )


def _two_ways() -> Iterator[Case]:
    ways: dict[str, tuple[list[Any], dict[str, Any]]] = {
        "turned": (TURNED[:10], {}),
        "turned-lost": (TURNED[:10], {"beam_lost": [[_at(6, 0.75), _at(6, 0.85)]]}),
        "turned-hidden": ([*TRUTH, replace(BACK[0], shown=False), *BACK[1:4]], {}),
        "overran": (OVERRAN[:11], {"rate_hz": 40.0}),
        "from-beyond": ([*TRUTH[:4], BEYOND, *TRUTH[4:]], {}),
        "back-twice": ([*OVERRAN, BEFORE, *TRUTH[:3]], {"rate_hz": 40.0}),
        "zeroed": (
            OVERRAN[:11],
            {"zeroed_at": [_at(7, -0.1)], "beam_lost": [[_at(6, 0.8), _at(6, 0.84)]]},
        ),
        "out-again": ([*TRUTH, *TRUTH[:4]], {}),
        "slipped-at-turn": (OVERRAN[:11], {"slips": [[_at(6, 0.75), 26.7]]}),
        "left-in-the-middle": ([*TRUTH[:4], *BACK[:4]], {}),
        "back-first": (BACK[:5], {}),
        "from-beyond-early": (
            [TRUTH[0], replace(BEYOND, reading=TRUTH[1].reading + 3.0), *TRUTH[1:]],
            {},
        ),
        "first-again": ([TRUTH[0], replace(BEYOND, reading=3.0), *TRUTH], {}),
        "first-again-before": ([TRUTH[0], BEFORE, *TRUTH[:4]], {}),
        "stands-again": ([*TRUTH, *BACK[:4]], {}),
        "stands-again-sparse": ([*TRUTH, *BACK[:4]], {"rate_hz": 25.0}),
        "turned-sparse": (TURNED[:10], {"rate_hz": 25.0}),
        "turn-flickers": (
            [*TRUTH[:-1], replace(TRUTH[-1], seconds=2.0), *BACK[1:4]],
            {"flicker": [[0.5, 0.6]], "deaf": [[_at(6, 0.48), _at(6, 1.6)]]},
        ),
    }
    for name, (stops, machine) in ways.items():
        yield _case(f"both-{name}", stops, back=True, machine=machine)
        if name not in ("back-first", "turned-hidden"):
            yield _case(
                f"both-{name}-stopped",
                stops,
                back=True,
                signals=STOPPED_ONLY,
                machine=machine,
            )
    yield _case(
        "one-log",
        [*TRUTH, *BACK[:3]],
        one_log=True,
        back=True,
        machine={"alarm": [_at(8, 0.2), _at(8, 0.5)]},
    )
    anew, before = [*TRUTH[:4], *TRUTH[:5]], replace(BEFORE, seconds=0.05)
    for name, stops in (
        ("anew", anew),
        ("anew-before", [*TRUTH[:4], before, *TRUTH[:5]]),
        ("anew-one", [*TRUTH[:2], *TRUTH[:3]]),
    ):
        for words in ("whole", "stopped", "counted"):
            yield _case(f"both-{name}-{words}", stops, back=True, signals=SIGNALS[words])
    lost = {"beam_lost": [[_at(3, 0.8), _at(3, 0.9)]]}
    yield _case("anew-lost-stopped", anew, signals=STOPPED_ONLY, machine=lost)
    yield _case("anew-lost-counted", anew, signals=COUNTED, machine=lost)
    levels = {str(k): round(TRUTH[k].reading, 4) for k in range(4)}
    hint = {"next_stop": 4, "known": levels, "last_reading_mm": levels["3"]}
    for name, stops, more in (
        ("behind", TRUTH[1:4], {}),
        ("on", TRUTH[4:], {}),
        ("again", TRUTH[3:], {}),
        (
            "lost",
            TRUTH[4:],
            {"breaks": [{"time_ns": 1, "reason": "told before", "watched": True}]},
        ),
        ("off", [replace(stop, reading=stop.reading + 31.0) for stop in TRUTH[4:]], {}),
    ):
        for words in ("whole", "stopped", "counted"):
            start = {
                "hints": {"ppp": hint},
                "last_count": 65530 if words != "stopped" else None,
            } | more
            yield _case(
                f"resumed-{name}-{words}",
                stops,
                back=True,
                signals=SIGNALS[words],
                start=start,
                machine={"lead_s": 0.0 if name == "behind" else 0.6},
            )
    for words in ("whole", "stopped"):
        stops = [
            replace(stop, seconds=2.2) if k == 1 else stop for k, stop in enumerate(TRUTH[:4])
        ]
        breaks = {"beam_lost": [[2.9, 2.92], [3.6, 3.62]]}
        yield _case(f"breaks-inside-{words}", stops, signals=SIGNALS[words], machine=breaks)
        yield _case(
            f"breaks-inside-unseen-{words}",
            stops,
            signals=SIGNALS[words],
            machine={
                "links": [[2.9, "laser", "lost", "gone"], [3.6, "laser", "lost", "gone"]]
            },
        )


def _goes_on() -> Iterator[Case]:
    """Yield logs that begin at a turn, and machines that go on after one."""
    turn = {"stop": 6, "outward": True, "reading_mm": round(TRUTH[-1].reading, 4)}
    back = {"outward": False, "turn": turn, "known": {"6": turn["reading_mm"], "0": 0.0}}
    for beyond in (None, True, False):
        for words in ("whole", "stopped"):
            for name, stops in (("turned", BACK[1:5]), ("again", BACK[:4])):
                start = {
                    "hints": {"ppp": back},
                    "last_count": 65530 if words == "whole" else None,
                    "beyond": beyond,
                }
                said = {None: "unsaid", True: "beyond", False: "not-beyond"}[beyond]
                yield _case(
                    f"{name}-{said}-{words}",
                    stops,
                    back=True,
                    signals=SIGNALS[words],
                    start=start,
                    machine={"lead_s": 0.6},
                )
    start = {"hints": {"ppp": back}, "last_count": 65530, "beyond": False}
    for name, machine in (
        ("sparse", {"rate_hz": 25.0}),
        ("lost", {"beam_lost": [[0.2, 0.3]]}),
    ):
        for words, stops in (("turned", BACK[1:5]), ("again", BACK[:4])):
            yield _case(
                f"{words}-not-beyond-{name}",
                stops,
                back=True,
                start=start,
                machine={"lead_s": 0.6} | machine,
            )
    edges, ends = diagonal("ppp", n=1), diagonal("ppp", n=1, back=True)
    past = [
        replace(stop, reading=stop.reading + 3.0, seconds=0.1, shown=False, counts=0)
        for stop in edges
    ]
    for k in (0, 1, 2):
        stops = (
            [*edges[:k], past[k], *edges[k:], *ends[1:]]
            if k
            else [*edges, *ends, past[0], *edges]
        )
        yield _case(
            f"both-edges-from-beyond-{k}",
            stops,
            back=True,
            of_survey={"n": 1},
            machine={"rate_hz": 40.0},
        )
    yield _case(
        "setup-goes-on", [*TRUTH[:4], *OTHER[:3]], of_survey={"setups": ["ppp", "npp"]}
    )


def _handshakes() -> Iterator[Case]:
    bits = {
        name: f'address = 2\ntype = "bit"\nbit = {k}'
        for k, name in enumerate(("stopped", "running", "alarm"))
    }
    places = {
        f"{axis}_mm": f'address = {4 + 2 * k}\ntype = "int32"\nscale = 1e-4'
        for k, axis in enumerate("xyz")
    }
    mapped = (
        bits
        | {"stop_count": "address = 1", "heartbeat": "address = 0", "setup": "address = 3"}
        | places
    )
    whole = (
        "".join(f"[plc.signals.{name}]\n{words}\n" for name, words in mapped.items())
        + "[plc.handshake]\nenabled = true\n"
    )
    machines: dict[str, dict[str, Any]] = {
        "noise": {"noise_um": 3.0},
        "lagging": {"late_s": {"position": 0.3, "count": 0.2}, "flicker": [[0.3, 0.4]]},
        "frozen": {"frozen": [_at(2, 0.1), _at(3, 0.4)]},
        "deaf": {"deaf": [[_at(2, 0.1), _at(2, 0.6)]]},
        "loss": {"beam_lost": [[_at(3, 0.4), _at(3, 0.42)]]},
        "loss-early": {"beam_lost": [[_at(3, 0.2), _at(3, 0.22)]]},
    }
    for name, machine in machines.items():
        yield _case(f"shaken-{name}", TRUTH[:5], signals=whole, machine=machine)
    skips = {"skip_open_dwell": True, "last_count": 65531}
    yield _case(
        "shaken-skips-open", TRUTH[:4], signals=whole, start=skips, machine={"lead_s": 0.0}
    )
    stands = [*TRUTH[:3], *(replace(stop, seconds=1.3) for stop in OTHER[:3])]
    yield _case(
        "shaken-setup-goes-on", stands, signals=whole, of_survey={"setups": ["ppp", "npp"]}
    )
    long = [replace(stop, seconds=2.6) for stop in TRUTH[:3]]
    yield _case(
        "shaken-long",
        long,
        signals=whole,
        machine={
            "noise_um": 3.0,
            "slips": [[2.0, 0.01], [2.5, -0.01], [3.0, 0.01], [5.5, 0.02]],
        },
    )


def _begun() -> Iterator[Case]:
    skips = {"skip_open_dwell": True, "last_count": 65531}
    yield _case("skips-open", TRUTH[:4], start=skips, machine={"lead_s": 0.0})
    yield _case(
        "skips-open-uncounted",
        TRUTH[:4],
        signals=STOPPED_ONLY,
        start={"skip_open_dwell": True},
        machine={"lead_s": 0.0},
    )
    told = {
        "breaks": [{"time_ns": 1, "reason": "told before", "watched": True}],
        "wall_offset_ns": 1_700_000_000_000_000_000,
    }
    yield _case("breaks-before", TRUTH[:4], start=told)
    moved = [
        replace(stop, position=(stop.position[0] + 0.3, *stop.position[1:]))
        for stop in TRUTH[:4]
    ]
    swapped = replace(TRUTH[1], position=(0.0, 100.0, 0.0), reading=100.0 * 200.0 / 374.1657)
    for name, stops in (
        ("mirrored", [replace(stop, reading=-stop.reading) for stop in TRUTH[:4]]),
        ("other-end", BACK[:5]),
        ("scaled", [replace(stop, reading=1.05 * stop.reading) for stop in TRUTH[:4]]),
        ("elsewhere", moved),
        ("wrong-order", [TRUTH[0], swapped, *TRUTH[2:5]]),
    ):
        yield _case(name, stops)
        if name != "elsewhere":
            yield _case(f"{name}-stopped", stops, signals=STOPPED_ONLY)


def _others() -> Iterator[Case]:
    """Yield machines without signals, runs of the head, and sensors of their own."""
    for name, stops, machine in (
        ("overrun", OVERRAN[:11], {}),
        ("lost", TRUTH, {"beam_lost": [[_at(3, 0.8), _at(3, 0.9)]]}),
        ("restless", TRUTH, {"noise_um": 2.0, "slips": [[_at(4, 0.4), 0.5]]}),
        (
            "held",
            [*TRUTH[:3], replace(TRUTH[3], reading=TRUTH[2].reading + 9.0), *TRUTH[3:]],
            {},
        ),
    ):
        yield _case(
            f"silent-{name}",
            stops,
            back=name == "overrun",
            changed=SILENT,
            added=FIXED,
            machine=machine,
        )
    head = HEAD
    runs = [
        replace(stop, position=(0.0, 0.0, 100.0 / 3 * k), reading=100.0 / 3 * k, setup=23)
        for k, stop in enumerate(TRUTH[:4])
    ]
    lateral = [
        [[0, 0], [0, 0], [0, 0]],
        [[9600, -5600], [100, 200], [-300, 400]],
        [[-24000, 3200], [0, 50], [60, 0]],
        [[44000, 16000], [1, 2], [3, 4]],
    ]
    status = [
        [1, _at(1, 0.4), _at(1, 0.6)],
        [128, _at(2, 0.3), _at(2, 0.4)],
        [4, _at(3, 0.0), _at(3, 0.2)],
    ]
    heads = {
        "clean": {},
        "dark": {"dark": [[_at(1, 0.3), _at(1, 0.5)], [_at(2, -0.1), _at(2, 0.8)]]},
        "saturated": {"status": status},
    }
    never = {"words": {"12": [[0.0, 0]], "10": [[0.0, 0]]}}
    moving = {"drift_um_s": 500.0, "flicker": [[0.3, 0.4]]}
    for name, more in heads.items():
        told = {
            "head": {"rate_hz": 50.0, "lateral": lateral} | more,
            "changed": UNCOMPENSATED,
            "machine": never if name == "dark" else moving if name == "saturated" else {},
        }
        yield _case(
            f"head-{name}",
            runs,
            of_survey={"n": 3, "setups": ["fourdof-z"]},
            added=head,
            **told,
        )
    turned = [*runs, *runs[2::-1]]
    wide = {"rate_hz": 50.0, "lateral": [*lateral, *lateral]}
    for name, stops in (("turned", turned), ("again", [*runs, *runs[:1:-1]])):
        yield _case(
            f"head-{name}",
            stops,
            back=True,
            of_survey={"n": 3, "setups": ["fourdof-z"]},
            added=head,
            head=wide,
        )
    beside = {"rate_hz": 25.0, "lateral": [lateral[k % 4] for k in range(10)]}
    yield _case("head-beside", TURNED[:10], back=True, added=head, head=beside)
    yield _case("head-beside-again", [*TRUTH, *BACK[:3]], back=True, added=head, head=beside)
    angles = {
        "rate_hz": 25.0,
        "angles": [[0.0, 5.0], [12.5, -3.0], [40.0, 80.0], [0.2, 0.1]],
        "dark": [[_at(2, 0.2), _at(2, 0.3)]],
    }
    collimator = (
        '[head]\nformat = "elcomat"\nport = "/dev/null1"\nid = "head 2"\n[head.angles]\nz = '
        '["+A", "+B"]\n'
    )
    for name, more in {
        "angles": {},
        "angles-dark": {"dark": [[_at(2, -0.1), _at(2, 0.8)]]},
    }.items():
        yield _case(
            f"head-{name}",
            runs,
            of_survey={"n": 3, "setups": ["fourdof-z"]},
            added=collimator,
            head=angles | more,
        )
    words = [
        [
            round(0.2 + 1.1 * k, 1),
            f"P= {1000.0 + 0.1 * k:.1f} hPa T= {20.0 + 0.05 * k:.2f} 'C RH= 40.0 %RH\r\n",
        ]
        for k in range(9)
    ]
    odd = [
        *words[:2],
        [3.0, "P= 500.0 hPa T= ***** 'C RH= 40.0 %RH\r\n"],
        [4.0, "what\r\n"],
        *words[5:],
    ]
    yield _case(
        "air",
        TRUTH[:5],
        signals=STOPPED_ONLY,
        changed=UNCOMPENSATED,
        added='[environment]\nsource = "sensor"\n' + SENSOR,
        air=odd,
    )


def _by_laser() -> Iterator[Case]:
    levels = NOMINAL
    out: list[list[float]] = [[level, 0.3, 1.0] for level in levels]
    back, end, away = out[::-1], [500.0, 0.3, 1.0], [-60.0, 0.3, 1.0]
    turn: dict[str, Any] = {
        "hint": {"outward": False, "known": {"6": levels[-1]}},
        "level_mm": levels[-1],
    }
    shaken = [
        [levels[2], 0.3, 0.5],
        [levels[2] + 0.015, 0.02, 0.05],
        [levels[2], 0.02, 0.5],
        [levels[3], 0.3, 0.4],
        [levels[3] + 0.05, 0.1, 0.0],
        [levels[3], 0.1, 0.6],
    ]
    known = {"outward": False, "known": {str(k): level for k, level in enumerate(levels)}}
    cases: dict[str, dict[str, Any]] = {
        "pass": {"acts": [[-40.0, 0.3, 1.0], *out, end]},
        "shifted": {"acts": [[17.0 + each[0], *each[1:]] for each in [*out, end]]},
        "stands-on": {"acts": [*out[:-1], [levels[-1], 0.3, 4.0]]},
        "short": {
            "acts": [*([level, 0.3, 0.45 + 0.04 * k] for k, level in enumerate(levels)), end]
        },
        "missed": {"acts": [*out[:3], out[4], out[6], end]},
        "missed-many": {"acts": [out[0], out[1], out[6], end]},
        "held": {"acts": [*out[:3], [(levels[2] + levels[3]) / 2, 0.2, 1.0], *out[3:], end]},
        "shaken": {"acts": [*out[:2], *shaken, *out[4:], end]},
        "again": {"acts": [*out[:4], out[2], out[3], out[4], *out[5:], end]},
        "lost": {"acts": [*out[:4], [levels[3], 0.05, 0.0, 0.0], *out[4:], end]},
        "lost-at-first": {"acts": [out[0], [levels[0], 0.05, 0.0, 0.0], *out, end]},
        "lost-at-last": {
            "acts": [*out, [levels[6], 0.05, 0.0, 0.0], [levels[6], 0.05, 1.0], end]
        },
        "wrong-sign": {"acts": [[-level, 0.3, 1.0] for level in levels]},
        "elsewhere": {"acts": [[3.0 * level, 0.3, 1.0] for level in levels]},
        "back-known": {"hint": known, "level_mm": levels[-1], "acts": [*back, away]},
        "back-known-at-turn": turn | {"acts": [[levels[-1], 0.01, 1.0], *back[1:], away]},
        "back-overrun": {
            "hint": {"outward": False, "known": {"6": levels[-1], "0": 0.0}},
            "level_mm": levels[-1],
            "acts": [[levels[-1] + 5.0, 0.3, 0.2], *back, away],
        },
        "back-breaks": turn
        | {"level_mm": 0.0, "breaks": [[1, "b", True]], "acts": [*back, away]},
        "back-late": turn
        | {"level_mm": levels[-1] + 0.5, "acts": [[levels[-1], 0.1, 1.0], *back[1:], away]},
        "back-soon": turn
        | {"level_mm": levels[-1] + 0.5, "acts": [[levels[-1], 0.02, 1.0], *back[1:], away]},
        "out-known": {
            "hint": {"known": {"0": 0.0, "6": levels[-1]}},
            "acts": [[0.0, 0.01, 1.0], *out[1:], end],
        },
        "out-known-late": {
            "hint": {"known": {"0": 0.0}},
            "level_mm": -9.0,
            "acts": [*out[:3], end],
        },
        "held-late": {"acts": [*out[:6], [levels[5] + 5.0, 0.2, 1.0], out[6], end]},
        "shaken-shortly": {
            "acts": [
                *out[:3],
                [levels[2] + 0.05, 0.01, 0.01],
                [levels[2], 0.01, 0.7],
                out[3],
                end,
            ]
        },
        "shaken-less": {
            "acts": [
                *out[:3],
                [levels[2] + 0.015, 0.01, 0.01],
                [levels[2], 0.01, 0.7],
                out[3],
                end,
            ]
        },
        "back-unwatched": turn | {"breaks": [[1, "b", False]], "acts": [*back, away]},
        "goes-on-instead": turn
        | {"acts": [[levels[-1] + 26.7, 0.3, 1.0], [levels[-1] + 60.0, 0.3, 1.0]]},
        "drives-out-again": turn
        | {
            "acts": [
                [-1000.0, 0.5, 1.0],
                *([level - 900.0, 0.3, 1.0] for level in levels),
                end,
            ]
        },
        "middle": {
            "hint": {"next_stop": 3, "last_reading_mm": levels[2], "known": {"2": levels[2]}},
            "level_mm": levels[2],
            "acts": [*out[3:], end],
        },
        "on-by-a-step": turn
        | {"acts": [[levels[-1] + 13.363, 0.3, 1.0], [levels[-1] + 26.7, 0.3, 1.0]]},
        "back-held": turn
        | {"acts": [[400.0, 0.3, 0.1], *back[:1], [365.0, 0.3, 1.0], *back[1:], away]},
        "marked": {
            "marked": True,
            "acts": [*out[:4], [out[3][0] + 0.03, 0.2, 0.4], *out[4:], end],
        },
        "marked-back": turn | {"marked": True, "acts": [*back[:4], away]},
        "slow-rate": {"rate_hz": 25, "acts": [*out, end]},
        "linear": {
            "setup": "linear-x",
            "acts": [
                [0.0, 0.3, 1.0],
                [150.0, 0.3, 1.0],
                [300.0, 0.3, 1.0],
                [260.0, 0.3, 1.0],
            ],
        },
    }
    for name, told in cases.items():
        told["acts"] = [[round(mm, 4), *rest] for mm, *rest in told["acts"]]
        yield f"by-laser-{name}", "by-laser", told


def inputs() -> Iterator[Case]:
    """Yield the name of every case, who plays it, and its input."""
    for cases in (
        _by_laser,
        _passes,
        _machines,
        _two_ways,
        _goes_on,
        _handshakes,
        _begun,
        _others,
    ):
        yield from cases()
