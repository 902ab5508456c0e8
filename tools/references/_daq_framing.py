"""Inputs of the reference cases of daq/formats: counters, checksums, frames, lines and layouts."""

from collections.abc import Iterator

from _daq_wire import Case, hexed


def _framing() -> Iterator[Case]:
    short = [[0, 9, 3], [-4, 3, 2]]
    yield (
        "counter",
        "counter",
        {
            "wraps": short,
            "steps": [
                {"counts": [3, 4, 5]},
                {"counts": [6, 6, 6, 7]},
                {"counts": [7]},
                {"counts": [7, 8]},
                {"counts": [9, 0, 1]},
                {"counts": [2]},
                {"counts": [8, 1]},
                {"counts": [9, 3]},
                {"counts": [9, 2]},
                {"counts": [2, -4]},
                {"counts": [3, -4]},
                {"counts": [3, -3]},
                {"counts": [3, -2]},
                {"counts": [-9, 3, -5]},
                {"counts": [10, 0]},
                {"counts": [11, 12, 20]},
                "forget",
                {"counts": [4, 5]},
                {"counts": [6], "restarted": True},
                {"counts": [1, 2], "restarted": True},
                {"counts": [7, 8, 10_000_008, 20_000_009]},
                {"counts": [0], "restarted": True},
                {"counts": [1], "restarted": True},
                {"counts": [1], "restarted": True},
                {"counts": [5, 4, 4, 4]},
                {"counts": [4, 5, 5, 9, 9]},
                {"counts": [0, 1], "restarted": True},
                {"counts": [2, 4, 4, 3, 3]},
            ],
        },
    )
    yield (
        "counter-fresh",
        "counter",
        {
            "wraps": [],
            "steps": [
                {"counts": [0, 1]},
                {"counts": [0], "restarted": True},
                {"counts": [-1, 5]},
            ],
        },
    )
    yield (
        "counter-begins-greeted",
        "counter",
        {
            "wraps": short,
            "steps": [{"counts": [8], "restarted": True}, {"counts": [8, 9, 1]}],
        },
    )
    yield (
        "checksums",
        "checksums",
        [
            "",
            "123456789",
            "\x00",
            "\xff\xff",
            "A\x80\x7f\x01",
            "the quick brown fox",
            "\x55\xaa\x31\xf7\x08",
        ],
    )

    def whole(text: bytes) -> bytes:
        return text + bytes((sum(text) % 256,))

    good = [whole(b"\xaa\x55" + bytes((k, 7 * k % 256, 3))) for k in range(6)]
    inner = whole(b"\xaa\x55\xaa\x55\x01")
    yield (
        "frames",
        "frames",
        {
            "sync": hexed(b"\xaa\x55"),
            "size": 6,
            "chunks": [
                hexed(each)
                for each in (
                    good[0] + good[1][:3],
                    good[1][3:],
                    b"xyz" + good[2],
                    b"\xaa",
                    b"\x55" + good[3][2:] + b"\xaa",
                    b"\xaa\x55\x01\x02\x03\x05",
                    inner + b"\xaa\x55\xaa" + inner[3:],
                    inner[:1] + inner,
                    b"0123456789abcdefghijklmnopqrstuvwxyz" + good[4][:5],
                    good[4][5:],
                    b"q" * 15,
                    b"r" * 3 + good[5],
                    b"s" * 16 + b"\xaa",
                    b"t" * 4000,
                    b"u" * 200,
                    b"v" * 9000,
                    good[0] + b"w",
                    good[1] * 3,
                    b"\x55\xaa\x55",
                    good[2][2:],
                    b"k" * 4096,
                    b"l" * 4095,
                    b"m",
                    good[3],
                    b"n" * 4095,
                    good[3],
                    b"",
                    b"\xaa\xaa\xaa" + good[0][1:],
                )
            ],
        },
    )
    yield (
        "frames-one-byte-sync",
        "frames",
        {
            "sync": hexed(b"\x10"),
            "size": 3,
            "chunks": [
                *map(
                    hexed, (b"\x10\x10", b"\x20\x10\x01", b"\x11\x10", b"\x10\x20", b"ab\x10")
                ),
                "clear",
                *map(hexed, (b"\x05\x15", b"\x10\x05\x15\x10\x06\x16")),
            ],
        },
    )
    yield (
        "lines",
        "lines",
        {
            "cap": 8,
            "chunks": [
                "one\ntwo",
                " 3\n",
                "four",
                "five",
                "\n",
                "12345678\n",
                "123456789\n",
                "12345678",
                "9",
                "rest\nnext\n",
                "a\nb\nlong line",
                "x",
                "yy\nz\n",
                "1234567890",
                {"skip": True},
                "no\nyes\n",
                "half",
                {"skip": True},
                "gone",
                "\nkept\n\n",
                "",
                "\xe9\x07\\\n",
                "abcdefgh",
                "\n",
                "abcdefghi\nz\n",
            ],
        },
    )
    yield (
        "lines-cr",
        "lines",
        {
            "cap": 60,
            "terminator": "\r",
            "chunks": [
                "ab\rcd",
                "\n\r",
                "x" * 39 + "\r",
                "y" * 40 + "\r",
                "z" * 60 + "\r",
                "z" * 61 + "\r\r",
            ],
        },
    )
    fields = [
        f"{name} {kind}"
        for name, kind in (
            ("position", "i32"),
            ("counter", "u16"),
            ("beam", "f32"),
            ("status", "u8"),
        )
    ]
    sizes = [
        [f"position {kind}{bits}"]
        for kind in "ui"
        for bits in (8, 16, 24, 32, 40, 48, 56, 64)
    ]
    yield (
        "layout",
        "layout",
        {
            "frame": hexed(
                bytes((17 * k + 40) % 256 for k in range(30))
                + bytes((255 - 11 * k) % 256 for k in range(30))
            ),
            "layouts": [
                [fields, 2],
                [["skip 3", *fields, "skip 10"], 0],
                *([each, 1] for each in sizes),
                [["position f32"], 4],
                [["position f64"], 4],
                [["position f16"], 0],
                [["position f24"], 0],
                [["position i12"], 0],
                [["skip"], 0],
                [["skip i8"], 0],
                [["position 4"], 0],
                [["position i8", "position i8"], 0],
                [["Position i8"], 0],
                [["status i8 "], 0],
                [["  status   u16"], 0],
                [["skip 1234"], 0],
                [["skip 999"], 0],
                [["skip 2", "skip 2", "beam u8"], 0],
                [[], 5],
                [["position f56"], 0],
                [["other i8"], 0],
            ],
        },
    )
    yield (
        "units",
        "units",
        [
            [unit, 632.9, optics]
            for unit in ("mm", "um", "nm", "pm", "inch", "counts")
            for optics in (1, 2, 4)
        ],
    )


def inputs() -> Iterator[Case]:
    """Yield the name of every case, who plays it, and its input."""
    yield from _framing()
