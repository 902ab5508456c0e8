"""Text that others write too: Etalon Exchange, volumetric error files by hand, punch files of any
machine; lines and numbers in them."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from stepdiag.base.result.result import Result
from stepdiag.base.settings import show
from stepdiag.exporters.beckhoff import csv
from stepdiag.exporters.fanuc.identity import identity_findings
from stepdiag.exporters.fanuc.punch import read_punch
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import (
    LONGEST_LINE,
    finite,
    read_lines,
    require_end,
    shown,
    whole,
)
from stepdiag.exporters.files.numbers import fixed, shortest
from stepdiag.exporters.neutral import etalon
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.tables.tables import Law
from testkit.exact.machines import EOB
from testkit.recorded import plain
from testkit.recorded.damaged import damages
from testkit.recorded.exported import fanuc_section, said
from testkit.recorded.profiles import INCLINED, STRAIGHT, profile_of, punched
from testkit.recorded.results import ANGLES, PLAIN, result_of, told

SMALL = """// by hand
[C0Y]
VALUE = 0.000020
[B0Z]
VALUE = -0.000007 // the second
[EXX]
Gridpoints = {
  -100.0 0.001
  50.0 0.003
  100.0 -0.002
} // end
[EYX]
Gridpoints = {
  -100.0 0.002
  100.0 0.007
}
[EZX]
Gridpoints = {
  -100.0 0.001
  100.0 -0.004
}
[ECX]
Gridpoints = {
  -100.0 0.000003
  100.0 0.000011
}
[EAX]
Gridpoints = {
  -50.0 0.000002
  100.0 -0.000005
}
[EYY]
Gridpoints = {
  10.0 0
  30.0 0.004
  80.0 0.005
  90.0 0.001
}
[EXY]
Gridpoints = {
  10.0 0.001
  90.0 0.003
}
[EZY]
Gridpoints = {
  10.0 0.001
  90.0 -0.006
}
[EBY]
Gridpoints = {
  10.0 -0.000004
  90.0 0.000009
}
[EZZ]
Gridpoints = {
  -20.0 0
  70.0 0.002
}
[EXZ]
Gridpoints = {
  -20.0 0.002
  0.0 0.004
  70.0 0.001
}
[EYZ]
Gridpoints = {
  -20.0 0
  70.0 -0.005
}
[EAZ]
Gridpoints = {
  -20.0 0.000006
  70.0 0.000001
}
"""
HAND = """C0Y B0Z A0Z X0X
0.000020 -0.000030 0.000040 0
#
X EXX EYX ECX // along X
-200.0 0.001 0.002 0.000001
0.0 0.0015 -0.0025 0.000003
100.0 0.003 0.004 -0.000007
#
Y EXY
40.0 0.01
160.0 0.013
280.0 0.02
"""


def _result(found: Result) -> Any:
    return {
        "errors": {
            name: [
                one.position_mm.tolist(),
                None if one.value is None else one.value.tolist(),
                str(one.u),
                one.unit,
            ]
            for name, one in found.errors.items()
        },
        "squareness": {name: one.value for name, one in found.squareness.items()},
        "volume": [
            list(found.volume.origin_mm),
            list(found.volume.size_mm),
            found.volume.increments,
        ],
        "said": [
            found.chain,
            found.method,
            found.source,
            list(found.findings),
            dict(found.setups),
            [str(one) for one in found.scale.values()],
        ],
    }


def cases() -> dict[str, Callable[[], Any]]:
    """Return what is read by its name."""
    return {
        "etalon": _etalon,
        "volumetric": _volumetric,
        "punched": _punched,
        "identity": _identity,
        "lines": _lines,
    }


def _etalon() -> Any:
    def read(text: str, chain: str = "FXYZ") -> Any:
        return plain.attempted(
            lambda: _result(
                etalon.parse(ControlFile(name="e.txt", data=text.encode("latin-1")), chain)
            )
        )

    found: dict[str, Any] = {
        f"by hand, {chain}": read(SMALL, chain)
        for chain in ("FXYZ", "XFYZ", "XYFZ", "ZYXF", "FXY")
    }
    for chain in ("XFYZ", "ZYXF"):
        made = etalon.render(result_of(angles=ANGLES, chain=chain))
        found[f"written, {chain}"] = plain.lines(made.data)
        found[f"back, {chain}"] = read(made.data.decode("ascii"), chain)
    unknown = replace(
        told(),
        squareness={**PLAIN.squareness, "B0Z": replace(PLAIN.squareness["B0Z"], value=None)},
    )
    found["written, told"] = plain.lines(etalon.render(unknown).data)
    lines = SMALL.split("\n")
    texts = {what: text for what, text in damages("\n".join(lines[:22])) if "cut" not in what}
    texts |= {
        "one row": SMALL.replace("  10.0 0\n  30.0 0.004\n  80.0 0.005\n", ""),
        "falling": SMALL.replace("  30.0 0.004\n", "  9.0 0.004\n"),
        "twice": SMALL + "[EXX]\n",
        "value twice": SMALL + "[C0Y]\n",
        "no EYY": SMALL.replace("[EYY]", "[EBZ]"),
        "no EXX, EZZ": SMALL.replace("[EXX]", "[EBZ]").replace("[EZZ]", "[ECZ]"),
        "a rotary axis": SMALL.replace("[EXY]", "[EXC]"),
        "in a block": SMALL.replace("  30.0 0.004\n", "[EBZ]\n"),
        "value in a block": SMALL.replace("  30.0 0.004\n", "VALUE = 3\n"),
        "open": SMALL.rstrip()[:-1],
        "only a value": "[C0Y]\nVALUE = 1e-6\n",
        "no block": "VALUE = 1e-6\n",
        "three cells": SMALL.replace("30.0 0.004", "30.0 0.004 1"),
        "long": "x" * 70,
    }
    found["damaged"] = plain.grouped({what: read(text) for what, text in texts.items()})
    return found


def _volumetric() -> Any:
    """Volumetric error files as they stand on machines: squareness with and without a column,
    angles with and without a chain."""
    profile = profile_of(
        "beckhoff",
        steps={"X": 100.0, "Y": 120.0, "Z": 90.0},
        axis={"Z": "reference_mm = -60.0"},
    )
    controls = {
        "plain": profile,
        "turned": profile_of(
            "beckhoff", 'negate = "XZ"', steps={"X": 100.0, "Y": 120.0, "Z": 90.0}
        ),
        "chain": profile_of(
            "beckhoff", 'chain = "FXYZ"', steps={"X": 100.0, "Y": 120.0, "Z": 90.0}
        ),
        "chain turned": profile_of(
            "beckhoff",
            'chain = "XYFZ"\nturned = false\nnegate = "XYZ"',
            steps={"X": 100.0, "Y": 120.0, "Z": 90.0},
        ),
    }
    texts = {
        "whole": HAND,
        "no angle": HAND.replace("0.000001", "0")
        .replace("0.000003", "0")
        .replace("-0.000007", "0"),
        "no squareness": HAND.partition("#\n")[2].replace("ECX", "EZX"),
        "squareness last": HAND.partition("#\n")[2].replace("ECX", "EZX")
        + "#\n"
        + HAND.partition("#\n")[0],
        "squareness alone": HAND.partition("#\n")[0],
        "squareness of zero": HAND.partition("#\n")[0]
        .replace("20", "00")
        .replace("30", "00")
        .replace("40", "00"),
        "foreign": HAND.replace("0.000040 0\n", "0.000040 1e-5\n").replace("C0Y", "A0C"),
        "two rows": HAND.replace("#\nX", "0 0 0 0\n#\nX"),
        "too few": HAND.replace("0.000040 0\n", "0.000040\n"),
        "another axis": HAND.replace("EYX", "EYZ"),
        "doubled": HAND.replace("EYX", "EXX"),
        "no heading": HAND.replace("Y EXY", "V EXY"),
        "only positions": HAND.replace("Y EXY", "Y")
        .replace("40.0 0.01\n", "40.0\n")
        .replace("160.0 0.013", "160.0")
        .replace("280.0 0.02", "280.0"),
        "one row": HAND.replace("160.0 0.013\n280.0 0.02\n", ""),
        "falling": HAND.replace("280.0", "150.0"),
        "standing": HAND.replace("280.0", "160.0"),
        "empty block": HAND.replace("#\nY", "#\n#\nY"),
        "nothing": "// a comment\n",
        "a heading": "X EXX\n",
        "lower": HAND.replace("EXX", "exx"),
    }
    found: dict[str, Any] = {}
    control = controller_named("beckhoff")
    for name, own in controls.items():
        for what, text in texts.items():
            if what not in ("whole", "no angle", "squareness alone") and name != "chain":
                continue
            file = ControlFile(name="v.csv", data=text.encode("ascii"))
            found[f"{what}, {name}"] = plain.attempted(
                lambda file=file, own=own: [
                    plain.table(one) for one in control.parse([file], own)
                ]
            )
    found["recognised"] = {
        what: csv.recognises(ControlFile(name="v", data=text.encode("ascii")))
        for what, text in texts.items()
    }
    found["recognised"] |= {
        text: csv.recognises(ControlFile(name="v", data=text.encode("latin-1")))
        for text in (
            "X",
            "X EXX",
            "Y EXX ECX",
            "W EXX",
            "X EXX q",
            "C0Y",
            "C0Y EXX",
            "",
            "\xe4",
            "x EXX",
            "X ECX",
            "XEXX X",
            "EXX X",
        )
    }
    own = csv.Reading(
        kind="k",
        angle_kind="a",
        laws={letter: Law(sense="as-error") for letter in "XYZ"},
        levers=None,
    )
    found["read"] = [
        plain.table(one)
        for one in csv.read(
            ControlFile(name="v", data=texts["squareness alone"].encode()), profile, own
        )
    ]
    return found


def _punched() -> Any:
    """Punch files of new and old controls: what is read of each, and what is changed in each."""
    new = punched({3: -7, 4: 12}, *INCLINED, points=6, N3624="25.0 0.5 1.0")
    old = EOB.join(
        [
            b"%",
            b"N01825 A1 P 3000 A2 P -200",
            b"N03620 A1 P 4",
            b"N10003 P -7",
            b"N10004 P 12 ",
            b"N00012 P 1.5",
            b"%",
            b"",
        ]
    )
    path = EOB.join(
        [
            b"%",
            b"N03620Q1L1P7",
            b"N10000Q0P0",
            b"N10001Q1P5",
            b"N10002Q0P-999999999",
            b"N10003Q0P1000000000",
            b"(N10004Q0P1)",
            b"%",
        ]
    )
    states = {
        "new": new,
        "old": old,
        "path": path,
        "twice": new.replace(b"N10004", b"N10003"),
        "line ends": new.replace(b"\n\r\r", b"\r\n"),
        "one other end": new.replace(b"N10003", b"\nN10003"),
        "a CR more": new.replace(b"N10003", b"\rN10003"),
        "no end": new.rstrip(b"%\n\r"),
        "a % between": new.replace(b"N10003", b"%N10003"),
        "text before": b"x" + EOB + new,
        "blanks around": b"  " + EOB + new + b" " + EOB,
        "small letters": new.replace(b"N10003", b"n10003"),
        "a semicolon": new.replace(b"P-7", b"P-7;"),
        "a plus": new.replace(b"P-7", b"P+7"),
        "a question": new.replace(b"P-7", b"P?"),
        "not ASCII": new.replace(b"P-7", b"P\xe4"),
        "empty": b"",
        "ends alone": EOB * 3,
        "marks alone": b"%" + EOB + b"%",
    }
    found: dict[str, Any] = {}
    for name, data in states.items():

        def read(data: bytes = data) -> Any:
            file = read_punch(ControlFile(name="P.TXT", data=data))
            return [
                [[block.number, block.where] for block in file.blocks][:4],
                {str(point): value for point, value in file.pitch.items()},
                [
                    file.parameter(number, axis)
                    for number in (1825, 3620, 3624, 5861, 12, 10001, 10003)
                    for axis in (None, 1, 2, 3, 12)
                ],
            ]

        found[name] = plain.attempted(read)
    changes = {
        "nothing": ({}, {}),
        "points": ({3: 0, 4: -100}, {}),
        "of axes": ({}, {(3620, 1): "9", (3624, 2): "12.5", (1825, 2): "7", (3620, 4): "8"}),
        "of none": ({}, {(3620, None): "9", (12, None): "3", (10001, None): "1"}),
        **{
            f"{count} missing": ({100 + point: 1 for point in range(count)}, {})
            for count in (1, 5, 6, 7, 8)
        },
    }
    for name in ("new", "old", "path"):
        whole_file = read_punch(ControlFile(name="P.TXT", data=states[name]))
        for what, (pitch, parameters) in changes.items():
            found[f"{name}, {what}"] = plain.attempted(
                lambda pitch=pitch, parameters=parameters, whole_file=whole_file: (
                    plain.beside(
                        plain.lines(whole_file.changed(pitch, parameters)),
                        plain.lines(b"\n".join(each.text for each in whole_file.blocks)),
                        "",
                    )
                )
            )
    return found


def _identity() -> Any:
    """What the machine's own parameters say against the profile."""

    def of(
        *more: str,
        section: str = "",
        machine: str = "",
        x: str = "",
        unit: str = "",
        **own: str,
    ) -> Any:
        words = fanuc_section(section, x=x)
        if unit:
            words = words.replace(
                "increment_limit", f"least_input_um = {unit}\nincrement_limit"
            )
        profile = profile_of("fanuc", section=words, machine=machine)
        file = read_punch(
            ControlFile(name="P.TXT", data=punched(None, *more, points=2, **own))
        )
        return plain.attempted(
            lambda: [
                said(item) for item in identity_findings([file], profile, profile.options)
            ]
        )

    found: dict[str, Any] = {"plain": of(), "named": of("N01020Q1A1P88A2P89A3P90")}
    for number in (32, 33, 65, 89, 126, 127, 0):
        found[f"A1 is {number}"] = of(f"N01020Q1A1P{number}A2P89A3P90")
    found["two axes"] = of("N01020Q1A1P88A2P89")
    found["no third reference"] = of(N3620="12 32")
    for text in ("12.0", "12.", "-12", "1X", "13"):
        found[f"reference {text}"] = of(N3620=f"{text} 32 52", N3622="20 40 60")
    found["reference, no highest"] = of(N3620="13 32 52")
    for bits in ("00000001", "00000010", "0", "1", "11111110"):
        found[f"8135 {bits}"] = of(f"N08135Q1P{bits}")
        found[f"1001 {bits}"] = of(f"N01001Q1P{bits}")
        found[f"1001 {bits}, inch"] = of(f"N01001Q1P{bits}", machine='units = "inch"')
        found[f"3605 {bits}"] = of(N3605=f"{bits} 00000000 00000000")
    both = "experimental_bidirectional = true"
    found["3605, both"] = of(
        N3605="00000001 00000000 00000000", section=both, machine='direction = "both"'
    )
    found["3605, mean"] = of(N3605="00000001 00000000 00000000", section=both)
    found["3605, unasked"] = of(
        N3605="00000001 00000000 00000000", machine='direction = "both"'
    )
    for bits in ("00001000", "00000100", "00010000", "1000", "000"):
        found[f"1006 {bits}"] = of(f"N01006Q1A1P{bits}A2P00000000A3P00000000")
    for bits in ("00000000", "00000001", "00000010", "00000011", "0"):
        for unit in ("", "10.0", "0.1"):
            found[f"1013 {bits}, unit {unit}"] = of(
                f"N01013Q1A1P{bits}A2P{bits}A3P{bits}", unit=unit
            )
    used = [
        text.replace("N05711Q1P0", "N05711Q1P1").replace("N05721Q1P0", "N05721Q1P2")
        for text in STRAIGHT
    ]
    for what, lines in (
        ("empty", STRAIGHT),
        ("used, zeros", used),
        ("used", [text.replace("N05763Q1P0", "N05763Q1P4") for text in used]),
        (
            "used by an axis of itself",
            [
                text.replace("N05763Q1P0", "N05763Q1P4").replace("N05721Q1P2", "N05721Q1P1")
                for text in used
            ],
        ),
        (
            "of an unknown axis",
            [
                text.replace("N05763Q1P0", "N05763Q1P4").replace("N05721Q1P2", "N05721Q1P7")
                for text in used
            ],
        ),
    ):
        for section in ("", "straightness_option = true"):
            found[f"straightness {what} {section}"] = of(*lines, section=section)
    return found


def _lines() -> Any:
    """Numbers and lines as all readers take and write them."""
    words = (
        "1",
        "-1.5",
        "+2",
        " 3 ",
        "1e3",
        "1e9",
        "1e10",
        "1e12",
        "1e13",
        "-1e300",
        "nan",
        "inf",
        "",
        "x",
        "1,5",
        "0x10",
        "1_000",
        "x" * 60,
        "x" * 61,
    )
    found: dict[str, Any] = {
        f"{word[:20]} {len(word)}": [
            plain.attempted(lambda word=word, read=read: read(word, "here"))
            for read in (finite, whole)
        ]
        + [shown(word)]
        for word in words
    }
    for digits in (9, 10, 11, 12, 13, 15, 16):
        for number in (f"1{'0' * digits}", f"1{'0' * (digits - 1)}1", f"-1{'0' * digits}"):
            found[number] = [
                plain.attempted(lambda number=number, read=read: read(number, "here") != 0)
                for read in (finite, whole)
            ]
    for data in (
        b"",
        b"a",
        b"a\nb\n",
        b"a\r\n\r\nb",
        b"a\x0cb",
        b"ab\xe4\n",
        b"x" * LONGEST_LINE,
        b"x" * (LONGEST_LINE + 1),
        b"\n" * 3,
    ):
        found[f"{data[:9]!r} {len(data)}"] = plain.attempted(
            lambda data=data: [
                [where, text[:9]]
                for where, text in read_lines(ControlFile(name="f", data=data))
            ]
        )
    for data in (
        b"// mark\n1\n// end\n",
        b"// mark\n1\n",
        b"1\n",
        b"// end // mark\n \n// end\n\n",
        b"// mark // end x",
    ):
        found[f"end {data!r}"] = plain.attempted(
            lambda data=data: require_end(
                ControlFile(name="f", data=data), b"// mark", b"// end"
            )
        )
    numbers = (
        0.0,
        -0.0,
        0.04,
        -0.04,
        0.06,
        -0.06,
        1.25,
        -1234.5678,
        1e-10,
        -1e-10,
        6.25,
        200.0,
        1.0000000001,
        0.000000001,
    )
    found["written"] = [
        [fixed(value, 1), fixed(value, 0), fixed(value, 3), shortest(value)]
        for value in numbers
    ]
    for value in (
        "x" * 57,
        "x" * 58,
        "x" * 59,
        "x" * 70,
        "ä",
        [1, "b"],
        {"a": 1},
        None,
        True,
        1.5,
        np.float64(2.5).item(),
    ):
        found[f"shown {str(value)[:20]} {len(str(value))}"] = show(value)
    return found
