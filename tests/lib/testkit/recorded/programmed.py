"""NC programs of every dialect, byte for byte, with every signal and option; and what refuses
one."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from stepdiag.base.names import SETUP_NUMBERS
from stepdiag.base.setups import setup_code
from stepdiag.base.volume import Volume
from stepdiag.exporters.profiles.registry import CONTROLLERS
from stepdiag.exporters.profiles.template import profile_template
from stepdiag.exporters.programs import (
    CONTROLS,
    Sequence,
    Signals,
    default_decimals,
    default_signals,
    nc_programs,
    program_name,
)
from stepdiag.exporters.programs.linuxcnc import companion_files
from stepdiag.exporters.programs.sequence import passes_of, travel_mm
from stepdiag.exporters.programs.settings import program_section, program_template, travel_in
from testkit.recorded import plain

VOLUME = Volume(origin_mm=(-100.5, 20.0, -300.0), size_mm=(51.0, 44.0, 36.0), increments=2)
SHORT = Sequence(name="hall 3", volume=VOLUME, setups=("npp",), return_pass=False)
OWN = {
    "begin": "B1 {setup}\nB2",
    "stand": "S {setup} {count}",
    "leave": "L {setup} {count}\nL2",
    "wait": "W {count} {setup}",
    "end": "E",
}


def written(sequence: Sequence, control: str, **how: Any) -> Any:
    """Return the programs of a sequence as lines."""
    return plain.attempted(
        lambda: {
            f"{one.name} ({one.setup})": plain.lines(one.data)
            for one in nc_programs(sequence, control, **how)
        }
    )


def refused(sequence: Sequence, control: str = "siemens", **how: Any) -> Any:
    """Return the refusal of programs, or their names."""
    return plain.attempted(
        lambda: [one.name for one in nc_programs(sequence, control, **how)]
    )


def cases() -> dict[str, Callable[[], Any]]:
    """Return the programs by dialect, and what is refused."""
    found: dict[str, Callable[[], Any]] = {}
    for control in CONTROLS:
        found[f"{control}-short"] = lambda control=control: written(SHORT, control)
        several = replace(
            SHORT,
            setups=("ppn", "linear-y", "ppp+2"),
            return_pass=True,
            axis_order="zxy",
            handshake=True,
            dwell_s=0.75,
            feed_mm_min=1234.5,
            overrun_mm=0.25,
        )
        found[f"{control}-handshake"] = lambda control=control, several=several: written(
            replace(several, setups=("linear-y",)), control
        )
        found[f"{control}-own"] = lambda control=control: written(
            replace(SHORT, overrun_mm=0.0, handshake=True, name="Fräse (2) #4"),
            control,
            signals=Signals(**OWN),
        )
        found[f"{control}-several"] = lambda control=control, several=several: _stops(
            several, control
        )
        found[f"{control}-names"] = lambda control=control: {
            "names": [
                program_name(SHORT, control, setup)
                for setup in (*SETUP_NUMBERS.values(), "ppp+1", "ppn+12")
            ],
            "signals": {name: getattr(default_signals(control), name) for name in OWN},
            "decimals": default_decimals(control),
            "template": program_template(
                default_signals(control), default_decimals(control)
            ).split("\n"),
            "companions": {
                file.name: plain.lines(file.data)
                if file.name.endswith("hal")
                else len(file.data) > 0
                for file in companion_files(control, "box.hall-3:a", 1503)
            },
        }
    found["profiles"] = _profiles
    found["sequences"] = _sequences
    found["refused"] = _refused
    found["signals"] = _signals
    found["sections"] = _sections
    return found


def _profiles() -> Any:
    """The templates of profiles, all but the first said beside it."""
    texts = {
        name: profile_template(control).split("\n") for name, control in CONTROLLERS.items()
    }
    (first, text), *others = texts.items()
    return {first: text} | {name: plain.beside(other, text, first) for name, other in others}


def _stops(sequence: Sequence, control: str) -> Any:
    """Return the lines of several setups that say anything new."""
    whole = written(replace(sequence, handshake=bool(default_signals(control).wait)), control)
    return {
        name: [
            line for line in lines if not line.lstrip("0123456789 ").startswith(("(", ";"))
        ]
        for name, lines in whole.items()
    }


def _sequences() -> Any:
    """The passes of sequences: counters, approaches, stops."""
    found: dict[str, Any] = {}
    for name, sequence in {
        "there and back": replace(SHORT, setups=("ppp", "pnp", "linear-x"), return_pass=True),
        "twice": replace(SHORT, setups=("pnp", "linear-z"), repeats=2, axis_order="yzx"),
        "twice and back": replace(
            SHORT, setups=("ppn+1", "ppn"), repeats=2, return_pass=True, overrun_mm=0.0
        ),
    }.items():
        for setup in sequence.setups:
            found[f"{name}, {setup}"] = [
                [
                    one.number,
                    one.outward,
                    one.approach_mm,
                    [
                        [stop.stop, stop.count, stop.axis, list(stop.position_mm)]
                        for stop in one.stops
                    ],
                ]
                for one in passes_of(sequence, setup)
            ] + travel_mm(sequence, setup).tolist()
    found["numbers"] = {
        name: plain.attempted(lambda name=name: setup_code(name, ("linear-x+1",)))
        for name in (
            *SETUP_NUMBERS.values(),
            "ppp+1",
            "ppp+0",
            "ppp+",
            "ppp+x",
            "linear-x+1",
            "xyz",
            "",
            "ppp+1+1",
            "PPP",
        )
    }
    return found


def _refused() -> Any:
    found: dict[str, Any] = {}
    for name, values in {
        "feed_mm_min": (0.0, -1.0, float("nan"), float("inf"), 0.001),
        "dwell_s": (0.0, -1.0, float("inf"), 0.001),
        "overrun_mm": (-0.001, 0.0, float("nan"), 3.0),
        "repeats": (0, 1, -1),
        "axis_order": ("xyz", "xy", "xxyz", "zyx", ""),
        "setups": ((), ("ppp", "ppp"), ("qqq",), ("ppp", "ppp+1"), ("linear-x",)),
    }.items():
        for value in values:
            found[f"{name} {value}"] = refused(replace(SHORT, **{name: value}))
    for control in (*CONTROLS, "fagor", ""):
        found[f"control {control}"] = refused(SHORT, control)
    found["handshake without a wait"] = refused(
        replace(SHORT, handshake=True), signals=Signals(**{**OWN, "wait": ""})
    )
    found["no handshake without a wait"] = refused(
        SHORT, signals=Signals(**{**OWN, "wait": ""})
    )
    for increments, repeats in ((10922, 1), (5461, 2), (10923, 1), (5461, 3)):
        long = Volume(
            origin_mm=(0.0, 0.0, 0.0),
            size_mm=(10923.0, 10923.0, 10923.0),
            increments=increments,
        )
        found[f"{increments} increments {repeats} times"] = plain.attempted(
            lambda long=long, repeats=repeats: len(
                passes_of(replace(SHORT, volume=long, repeats=repeats), "npp")
            )
        )
    for decimals in (0, 1, 2, 3, 4, 6):
        fine = replace(
            SHORT,
            volume=Volume(
                origin_mm=(0.0, 0.0, 0.0), size_mm=(10.25, 9.0, 7.125), increments=1
            ),
        )
        found[f"decimals {decimals}"] = refused(fine, decimals=decimals)
    for name, limits in {
        "within": {"x": (-104.5 - 1.0, -44.5), "y": (15.0, 69.0), "z": (-305.0, -259.0)},
        "x": {"x": (-100.0, -40.0)},
        "x above": {"x": (-110.0, -49.6)},
        "y": {"y": (15.5, 80.0)},
        "z": {"z": (-305.0, -264.5)},
        "hardly": {"z": (-305.0, -259.0000005)},
        "not hardly": {"z": (-304.99, -259.0)},
    }.items():
        found[f"travel {name}"] = refused(SHORT, travel_mm=limits)
        found[f"travel {name}, linear"] = refused(
            replace(SHORT, setups=("npp", "linear-z")), travel_mm=limits
        )
    for host in ("127.0.0.1", "a-b.c:1", "a b", "", "x" * 100, "x" * 101, "a;b", "a_b"):
        found[f"host {host[:20]} {len(host)}"] = plain.attempted(
            lambda host=host: [file.name for file in companion_files("linuxcnc", host, 1502)]
        )
    return found


def _signals() -> Any:
    texts = (
        "",
        "{setup}",
        "{count}",
        "{other}",
        "{}",
        "{setup:9}",
        "{setup!r}",
        "{",
        "}",
        "{{",
        "a\nb",
        "a\tb",
        "\xe4",
        "x" * 1000,
        "x" * 1001,
        "{setup",
    )
    found = {
        f"{name} {text[:12]!r} {len(text)}": plain.attempted(
            lambda name=name, text=text: Signals(**{**OWN, name: text}).blocks(
                name, setup=7, count=8
            )[:3]
        )
        for name in OWN
        for text in texts
    }
    return plain.grouped(found)


def _sections() -> Any:
    texts = (
        "",
        "[program]\n",
        '[program]\ndecimals = 3\nbegin = "A"\nend = ""\n',
        "[program]\ndecimals = 7\n",
        "[program]\ndecimals = -1\n",
        "[program]\nbegin = 3\n",
        "[program]\nbgin = ''\n",
        '[machine]\ncontroller = "fanuc"\n',
        '[machine]\ncontroller = "siemens"\n',
        "program = 3\n",
        "[axes.X]\ntravel_mm = [1.0, 2.0]\n",
        "[axes.Y]\ntravel_mm = [2.0, 2.0]\n",
        "[axes.Z]\ntravel_mm = [3.0, 2.0]\n",
        "[axes.X]\ntravel_mm = [1.0]\n",
        "[axes.X]\ntravel_mm = 1.0\n",
        "axes = 3\n",
        "[axes]\nX = 3\n",
        "[axes.X]\nname = 'X'\n",
        "[program\n",
        "machine = 3\n",
    )
    return {
        f"{text!r}": [
            plain.attempted(
                lambda text=text: _section(program_section(text, "p.toml", "siemens"))
            ),
            plain.attempted(
                lambda text=text: {
                    name: list(ends) for name, ends in travel_in(text, "p.toml").items()
                }
            ),
        ]
        for text in texts
    }


def _section(section: Any) -> Any:
    signals = section.signals(default_signals("siemens"))
    return [section.decimals, *(getattr(signals, name) for name in OWN)]
