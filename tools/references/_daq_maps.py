"""Inputs of the reference cases of daq/formats: registers of the machine, and expressions over
them."""

import struct
from collections.abc import Iterator
from typing import Any

from _daq_wire import Case, hexed


def _maps() -> Iterator[Case]:
    block = struct.pack(
        ">HHHHiiiHHHH", 7, 65535, 0b101, 11, 1_234_567, -7_654_321, 5, 2010, 63036, 10132, 455
    )
    bits = [
        struct.pack(">HHHHiiiHHHH", k, 300 + k, 1 << k, k, 10 * k, 20 * k, 30 * k, 0, 0, 0, 0)
        for k in range(16)
    ]
    yield (
        "signals-contract",
        "signals",
        {
            "signals": "contract",
            "blocks": [
                {"data": [hexed(each)]}
                for each in (block, block, *bits, b"", block[:-1], block + b"\0")
            ],
        },
    )
    order = {"ABCD": "abcd", "CDAB": "cdab", "BADC": "badc", "DCBA": "dcba"}
    signals: dict[str, Any] = {}
    for k, (table, kind) in enumerate(
        (
            ("holding", "uint16"),
            ("holding", "int16"),
            ("input", "uint32"),
            ("input", "int32"),
            ("db7", "float32"),
            ("B", "int32"),
        )
    ):
        signals[
            (
                "x_mm",
                "y_mm",
                "z_mm",
                "air_temperature_c",
                "air_pressure_hpa",
                "material_temperature_c",
            )[k]
        ] = {
            "address": 10 + 7 * k,
            "table": table,
            "type": kind,
        }
    for name in order:
        told = {
            each: spec | {"order": name, "scale": 0.5, "offset": -3.0}
            for each, spec in signals.items()
        } | {"stopped": {"address": 3, "type": "bit", "bit": 9}}
        answers = {
            "holding 3": b"\x02\x00",
            "holding 10": b"\xf1\x23",
            "holding 17": b"\xf1\x24",
            "input 24": b"\x81\x02\x03\x04",
            "input 31": b"\xfa\x02\x03\x05",
            "db7 38": b"\x41\x20\x30\x44",
            "B 45": b"\xff\x12\x34\x56",
        }
        ranges = [
            [
                key.split()[0],
                int(key.split()[1]),
                1 if key.startswith("holding") else 2 if key.startswith("input") else 4,
            ]
            for key in answers
        ]
        blocks = [
            {"ranges": ranges, "data": [hexed(each) for each in answers.values()]},
            {
                "ranges": ranges,
                "data": [
                    hexed(b"") if k % 2 else hexed(each)
                    for k, each in enumerate(answers.values())
                ],
            },
            {
                "ranges": [["holding", 3, 15], *ranges[3:]],
                "data": [
                    hexed(
                        b"\x02\x00"
                        + bytes(range(12))
                        + b"\x81\x82"
                        + bytes(range(12))
                        + b"\x91\x92"
                    ),
                    *(hexed(each) for each in list(answers.values())[3:]),
                ],
            },
            {
                "ranges": ranges[1:],
                "data": [hexed(each) for each in list(answers.values())[1:]],
            },
            {"ranges": [], "data": []},
        ]
        yield f"signals-{name}", "signals", {"signals": told, "blocks": blocks}
    coils = {
        name: {"address": address, "table": table}
        for name, address, table in (
            ("stopped", 3, "coil"),
            ("running", 12, "coil"),
            ("alarm", 5, "discrete"),
        )
    }
    counted = {
        "stop_count": {"address": 4, "type": "float32"},
        "setup": {"address": 6, "type": "float32"},
        "heartbeat": {"address": 2, "table": "db1", "type": "uint16"},
        "x_mm": {"address": 40, "type": "float32", "scale": 1e3},
    }
    reads = [
        ["coil", 3, 1],
        ["db1", 2, 2],
        ["coil", 12, 1],
        ["discrete", 5, 1],
        ["holding", 4, 4],
        ["holding", 40, 2],
        ["coil", 3, 1],
    ]
    reals = [
        struct.pack(">ff", *pair)
        for pair in ((1.4, 2.6), (float("nan"), float("inf")), (65535.0, -0.4))
    ]
    blocks = [
        {
            "ranges": reads,
            "data": [
                hexed(each)
                for each in (
                    bytes((first,)),
                    b"\x12\x34",
                    b"\x01",
                    b"\xff",
                    real,
                    struct.pack(">f", 0.3),
                    bytes((last,)),
                )
            ],
        }
        for first, last, real in (
            (1, 1, reals[0]),
            (1, 0, reals[1]),
            (0, 1, reals[2]),
            (2, 3, reals[0]),
        )
    ]
    blocks += [
        {
            "ranges": reads,
            "data": [
                hexed(each)
                for each in (b"", b"\x12\x34", b"", b"\xff", reals[0], b"", b"\x01")
            ],
        }
    ]
    yield "signals-coils", "signals", {"signals": coils | counted, "blocks": blocks}
    wide = {f"b{k}": {"address": 9 + k, "table": "coil"} for k in range(20)} | {
        "stopped": {"address": 9, "table": "coil"}
    }
    yield (
        "signals-many-coils",
        "signals",
        {
            "signals": wide,
            "blocks": [
                {"data": [hexed(each)]} for each in (b"\x01\x00\x08", b"\xff\xfe\x00")
            ],
            "expressions": {"running": "b1 and b8", "alarm": "b19 or not b3"},
        },
    )
    inputs = {
        "axis_moving": {"address": 20, "type": "bit", "bit": 3},
        "override": {"address": 21, "scale": 0.1, "offset": 5.0},
        "stop": {"address": 90},
        "block": {"address": 91, "type": "float32"},
    }
    made = {
        "stopped": "not axis_moving and override > 5.5",
        "stop_count": "latch(stop)",
        "x_mm": "block",
        "alarm": "block < 0",
    }
    asked = [["holding", 20, 2], ["holding", 90, 3], ["holding", 20, 2]]
    values = [
        (0, 100, 4, 1.5, 0, 100),
        (8, 100, 0, -1.5, 0, 100),
        (0, 100, 0, float("nan"), 8, 100),
        (0, 5, 7, float("inf"), 0, 5),
        (0, 6, 0, 0.0, 0, 5),
        (0, 100, 65535, 2.5, 0, 100),
    ]
    polls = [
        {
            "ranges": asked,
            "data": [
                hexed(struct.pack(">HH", a, b)),
                hexed(struct.pack(">Hf", c, d)),
                hexed(struct.pack(">HH", e, f)),
            ],
        }
        for a, b, c, d, e, f in values
    ]
    polls += [
        {
            "ranges": asked,
            "data": [
                hexed(b""),
                hexed(struct.pack(">Hf", 0, 2.0)),
                hexed(struct.pack(">HH", 0, 100)),
            ],
        },
        {
            "ranges": asked,
            "data": [hexed(struct.pack(">HH", 0, 100)), hexed(b""), hexed(b"")],
        },
    ]
    yield (
        "signals-expressions",
        "signals",
        {
            "signals": inputs,
            "expressions": made,
            "blocks": polls,
            "standing": ["axis_moving", "override"],
        },
    )
    standing = {"address": 60, "type": "bit"}
    far: dict[str, Any] = {
        "registers": {
            "runs": [[60, 1, {"address": 0}], [199, 1, {"address": 61}]],
            "stopped": standing,
        },
        "pairs": {"runs": [[70, 2, {"address": 1, "type": "int32"}]], "stopped": standing},
        "coils": {"runs": [[2003, 1, {"address": 0, "table": "coil"}]]},
        "bytes": {
            "runs": [
                [110, 2, {"address": 0, "table": "db1"}],
                [1, 0, {"address": 220, "table": "db1", "type": "float32"}],
            ]
        },
        "bytes-to-the-end": {
            "runs": [
                [98, 2, {"address": 0, "table": "db1"}],
                [1, 0, {"address": 196, "table": "db1", "type": "float32"}],
            ]
        },
        "bytes-beyond": {
            "runs": [
                [99, 2, {"address": 0, "table": "db1"}],
                [1, 0, {"address": 198, "table": "db1", "type": "float32"}],
            ]
        },
        "one": {"runs": [[3, 1, {"address": 57}]], "stopped": standing},
        "overlap": {
            "runs": [
                [1, 0, {"address": 5, "type": "uint32"}],
                [2, 1, {"address": 6}],
                [1, 0, {"address": 9}],
                [1, 0, {"address": 7, "table": "input"}],
                [1, 0, {"address": 65535}],
            ],
            "stopped": {"address": 9, "type": "bit", "bit": 15},
        },
    }
    for name, told in far.items():
        yield f"plan-{name}", "plan", told
    bits_of = {
        "stopped": {"address": 1, "table": "M", "type": "bit", "bit": 2},
        "running": {"address": 4, "type": "bit", "bit": 15},
        "setup": {"address": 2, "table": "B", "type": "uint16"},
    }
    ranges = [["M", 1, 1], ["B", 2, 2], ["holding", 4, 1], ["M", 1, 1]]
    yield (
        "signals-bits",
        "signals",
        {
            "signals": bits_of,
            "blocks": [
                {
                    "ranges": ranges,
                    "data": [
                        hexed(bytes((1 << k,))),
                        hexed(b"\x01\x0b"),
                        hexed(b"\x80\x00" if k % 2 else b"\x40\x00"),
                        hexed(b"\x04"),
                    ],
                }
                for k in range(8)
            ],
        },
    )
    rounds = [
        {"a": a, "b": b, "v": v, "w": w}
        for a, b, v, w in (
            (1, 0, 5, 5),
            (0, 1, 0, -2.5),
            (None, 1, None, 7),
            (1, None, 3, None),
            (0, 0, 0, 0),
            (None, None, None, None),
            (1, 1, 2, 3),
        )
    ]
    texts = [
        "a",
        "not a",
        "not not a",
        "a and b",
        "a or b",
        "a and not b",
        "not a or b",
        "a and b or v > 3",
        "a or b and v > 3",
        "(a or b) and v > 3",
        "v == 5",
        "v != 5",
        "v < 3",
        "v <= 3",
        "v > 3",
        "v >= 3",
        "v == w",
        "v < w",
        "-1 < v",
        "v > -2.5",
        "latch(v)",
        "latch(v) == 5",
        "latch(w) > 0 and a",
        "w",
        "3",
        "-0.5",
        "v == -w",
        "(v) == (w)",
        "a and",
        "and a",
        "",
        " ",
        "a b",
        "v",
        "v and a",
        "a == 1",
        "a < b",
        "latch(a)",
        "latch v",
        "latch(",
        "latch()",
        "latch(3)",
        "latch(v",
        "latch(or)",
        "(a",
        "a)",
        "()",
        "x",
        "x and a",
        "3 == 3.5.5",
        "v == - -1",
        "v == -a",
        "v = 5",
        "v == $",
        "a & b",
        "\xe9",
        "not v",
        "not",
        "v == 5 == 6",
        "a or v",
        "a and v",
        "(a and b) == 1",
        "not " * 20 + "a",
        "not " * 21 + "a",
        "(" * 20 + "a" + ")" * 20,
        "(" * 21 + "a" + ")" * 21,
        "a or " * 99 + "a",
        "a or  " * 83 + "a ",
        "a or  " * 83 + "a  ",
        "a or  " * 83 + "a" + "  ",
        "((a)) and (not (not b)) and " + "(" * 19 + "a" + ")" * 19,
        "orb",
        "latch",
        "or",
        "a or not",
        "v >",
        "v > (w",
        "v<w",
        "1.5<v",
        "v==1and a",
        "not(a)",
    ]
    yield (
        "expressions",
        "expressions",
        [{"text": text, "inputs": rounds} for text in texts]
        + [
            {"text": "a", "kinds": {}, "inputs": rounds},
            {"text": "q", "kinds": {"z": "bit", "m": "word"}, "inputs": rounds},
        ],
    )


def inputs() -> Iterator[Case]:
    """Yield the name of every case, who plays it, and its input."""
    yield from _maps()
