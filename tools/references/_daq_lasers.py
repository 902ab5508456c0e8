"""Inputs of the reference cases of daq/formats: interferometers and displays."""

import binascii
import struct
from collections.abc import Iterator

from _daq_wire import (
    Case,
    answer,
    fed,
    fourdof,
    fourdof_line,
    hexed,
    lasertex,
    lasertex_distance,
    qudis,
    qudis_data,
    qudis_pair,
    streamed,
    umd_line,
)


def _qudis() -> Iterator[Case]:
    spread = (
        0,
        1,
        -1,
        123_456_789,
        -987_654_321_012,
        (1 << 47) - 1,
        -(1 << 47),
        1 << 24,
        -(1 << 24),
        0x800000,
        1 << 23,
    )
    first = [
        qudis_data(5, *spread),
        qudis_data(16, 4000, 5000, marker=16383),
        qudis_data(18, 7, marker=0x2AAA),
        qudis_data(19, 8, marker=0x1555),
    ]
    counts = [
        qudis_data(index, 100, 200)
        for index in (20, 21, 25, 24, -2, 0, 2**31 - 1, -(2**31) + 1, 5)
    ]
    wraps = [
        qudis_data(index, 1, 2, 3)
        for index in (
            2**31 - 3,
            0,
            999_999,
            2**31 - 3,
            1_000_003,
            -4,
            -1,
            2,
            5,
            -4,
            999_995,
            1,
        )
    ]
    answers = [
        qudis(3, 0x0773, 0, 0, 1),
        qudis(3, 0x0773, 0, 0, 0),
        qudis_data(40, 11),
        qudis(4, 0x0773, 0, 2),
        qudis_data(41, 12),
        qudis(4, 0x0773, 0, 2),
        qudis(4, 0x0773, 0, 7),
        qudis_data(42, 13),
        qudis(4, 0x0773, 0, 1),
        qudis_data(43, 14),
        qudis(4, 0x0773, 0, 1, 2),
        qudis(3, 0x0773, 0, 0),
        qudis(4, 0x0773),
        qudis_data(44, 15),
        *(qudis(3, 0x0771, 0, reason, 5) for reason in range(7)),
        qudis(3, 0x0145, 0, 1),
        qudis(1, 0x0145, 0, 1),
        qudis(3, 0x0145),
    ]
    sources = [qudis(3, 0x0031, 0, 0, source) for source in (1, 2, 3, 4, 5, 6)]
    sources += [
        qudis(3, 0x0031, 1, 0, 9),
        qudis(3, 0x0031, 0, 0),
        qudis(3, 0x0031, 0, 0, 9, 9),
        qudis(4, 0x0031, 0, 0, 9),
        qudis(3, 0x0031, 0, 4, 9),
    ]
    channels = [
        qudis(4, 0x0F00 + channel, 0, *qudis_pair(5)) for channel in (1, 2, 15, 16, -1)
    ]
    pair = qudis_pair(77)
    unpaired = [
        qudis(4, 0x0F00, 50),
        qudis(4, 0x0F00, 50, pair[0]),
        qudis(4, 0x0F00, 50, *pair, pair[0]),
        qudis(4, 0x0F00, 50, pair[1], pair[0]),
        qudis(4, 0x0F00, 50, pair[0], pair[0]),
        qudis(4, 0x0F00, 50, pair[1], pair[1]),
        qudis(3, 0x0F00, 50, *pair),
        qudis(4, 0x0EFF, 50, *pair),
    ]
    junk = [
        b"\x05",
        b"\x06\x07" + qudis_data(60, 1),
        b"0123456789abcdefghijkl",
        qudis_data(61, 2),
        bytes(range(64, 84)) + qudis_data(62, 3)[:9],
        qudis_data(62, 3)[9:],
    ]
    junk += [
        struct.pack("<iiiii", length, opcode, 1, 2, 3)
        for length, opcode in (
            (16, 2),
            (16, 5),
            (15, 4),
            (12, 4),
            (17, 4),
            (18, 4),
            (16, 0),
            (16, 1),
            (16, -1),
            (4096, 4),
            (4093, 3),
        )
    ]
    largest = qudis(4, 0x0F10, 0, *range(1019))
    junk += [
        largest,
        qudis(4, 0x0F10, 0, *range(1020)),
        qudis_data(63, 4),
        b"z" * 4090,
        b"z" * 20,
        b"y" * 4096,
        qudis_data(64, 5),
        b"w",
        qudis_data(65, 6),
    ]
    for name, settings in (
        ("1", {}),
        ("2", {"axis": 2, "average": 0, "absolute": True, "sign": -1, "latency_s": 0.002}),
        ("3", {"axis": 3, "average": 16}),
    ):
        yield streamed(
            f"qudis-{name}",
            "qudis",
            fed(*first, *counts, *answers, *sources, qudis_data(45, 5), *channels),
            **settings,
        )
    yield streamed("qudis-wraps", "qudis", fed(*wraps))
    yield streamed(
        "qudis-junk",
        "qudis",
        fed(*unpaired, *junk, qudis_data(66, 9)[:20], ["resync"], qudis_data(67, 10)),
    )


def _lasertex() -> Iterator[Case]:
    air = [
        lasertex(0xB00A, bytes((0, *data)) + bytes(12 - 1 - len(data)))
        for data in (
            (0x08, 0x35, 45, 90, 3, 0x27, 0x94),
            (0xFF, 0x38, 101, 1, 2, 0x00, 0x01),
            (0x01, 0x00, 7, 0, 0, 0xFF, 0x00),
        )
    ]
    material = [
        lasertex(0xB00A, bytes((sensor, high, low)) + bytes(9))
        for sensor, high, low in ((1, 7, 208), (2, 8, 52), (255, 255, 156), (1, 7, 255))
    ]
    distances = [
        lasertex_distance(steps)
        for steps in (0, 1, -1, 1_234_567_890_123, -(1 << 55), (1 << 55) - 1)
    ]
    distances += [lasertex_distance(5, speed=1 << bit) for bit in range(8)] + [
        lasertex_distance(6, state=9 ^ 1 << bit) for bit in range(8)
    ]
    distances += [
        lasertex_distance(7, level=level) for level in (0, 9, 10, 11, 19, 20, 49, 50, 51, 255)
    ]
    others = [
        lasertex(code, bytes(12))
        for code in (0xB016, 0xB02F, 0xB030, 0xB03C, 0xB07F, 0xB080, 0xB014, 0xA015, 0xB00B)
    ]
    broken = bytearray(lasertex_distance(8))
    broken[9] ^= 1
    mixed = (
        lasertex_distance(9) * 2
        + air[0]
        + lasertex_distance(10)
        + others[0]
        + material[0]
        + lasertex_distance(11)
    )
    yield streamed(
        "lasertex",
        "lasertex",
        fed(
            *distances,
            b"".join(distances),
            *air,
            *material,
            *others,
            bytes(broken),
            b"\xaa\xaa" + distances[3][:7],
            distances[3][7:],
            mixed,
            distances[2][:9],
            ["resync"],
            distances[1],
        ),
        level_full=50.0,
        sign=-1,
        latency_s=0.01,
    )
    yield streamed(
        "lasertex-answers",
        "lasertex",
        fed(
            *distances[:2],
            *(
                ["respond", hexed(each)]
                for each in (
                    *distances[4:],
                    mixed,
                    bytes(broken),
                    lasertex_distance(5, speed=8, state=1),
                    lasertex_distance(1, state=1) + lasertex_distance(2),
                    lasertex_distance(1) + lasertex_distance(2, speed=8),
                    air[0],
                    distances[0][:8],
                    distances[0][8:],
                    b"",
                    lasertex_distance(1, state=0)[:10],
                    lasertex_distance(1, state=0)[10:],
                )
            ),
        ),
        beam_threshold=0.1,
    )


def _ids3010() -> Iterator[Case]:
    warnings = [
        answer(1, warning, 1_000_000_001 + warning, 2_000_000_002, -3_000_000_003)
        for warning in range(11)
    ]
    qualities = [
        answer(2, 0, contrast, 7) + answer(1, 0, 1, 2, 3)
        for contrast in (0, 99, 100, 101, 199, 200, 250, 499, 500, 600, -5, 1000)
    ]
    errors = [
        answer(1, error={"code": -32601, "message": "Method not found"}),
        answer(1, error={"code": -32600, "message": "Bad"}),
        answer(2, error={"code": 1, "message": 5}),
        answer(1, error="text"),
        answer(1),
        answer(2),
        answer(1, 0, 1, 2),
        answer(1, 0, 1, 2, 3, 4),
        answer(2, 0, 1),
        answer(2, 0, 1, 2, 3),
        answer(3, 0, 21.5),
        answer(4, 0, 1013.25),
        answer(5, 0, 44.5),
        answer(3, 1, 21.5),
        answer(3, 0),
        answer(3, 0, 1, 2),
        answer(6, 0, 1),
        answer(0, 0, 1),
        '{"id": 1, "result": [0, 1, "x", 3]}\n',
        '{"id": 1, "result": null}\n',
        '{"id": "1"}\n',
        "not json\n",
        "\n",
        "  \n",
        "\xff\xfe\n",
        '{"id": 1, "result": [0, 1e400, 2, 3]}\n',
        '{"id": 1, "result": [0, ' + "9" * 400 + ", 2, 3]}\n",
        "[]\n",
        '{"result": [0, 1, 2, 3]}\n',
        '{"id": 1, "result": [true, 1, 2, 3]}\n',
        "x" * 4097 + "\n",
        '{"id": 1, "result": [0, 1, 2, 3], "pad": "' + "p" * 4040 + '"}\n',
        '{"id": 1, "res',
        'ult": [0, 4, 5, 6]}\n',
    ]
    for axis, interface, is_air in ((1, "ids", False), (2, "sen", True), (3, "ids", True)):
        steps = fed(
            *warnings,
            *qualities,
            *errors,
            '{"id": 1,',
            ["resync"],
            answer(1, 0, 7, 8, 9),
            answer(1, 0, 1, 1, 1) * 2,
        )
        yield streamed(
            f"ids3010-{axis}",
            "ids3010",
            steps,
            axis=axis,
            interface=interface,
            air=is_air,
            contrast_full=500.0 * axis - 500.0 * (axis == 3),
            poll_hz=20.0 * axis,
            sign=(-1) ** axis,
            latency_s=0.01 * axis,
        )


def _displays() -> Iterator[Case]:
    readings = [
        "\x02+123456789\r\n",
        "\x02-000000001\r\n",
        "\x06",
        "\x15",
        "\x02ERROR 60\r\n",
        "\x02+12.5\r\n",
        "\x0212\r\n",
        "junk\r\n",
        "\r\n",
        "\x02+00",
        "0042\r\n",
        "\x02+1\x02+2\r\n",
        "\x02\x02+3\r\n",
        "\x02" + "9" * 256 + "\r\n",
        "\x02" + "9" * 257 + "\r\n",
        "\x02+1234567890\r\n",
        "\x02+5\r\n+6\r\n+7\r\n",
        "\x02+8\r\nERROR\r\n+9\r\n",
        "\x02+1\r\n\x15+2\r\n",
        "+3\r\n",
        "\x02 +4 \r\n",
        "\x02-0.125\r\n",
        "\x02.5\r\n",
        "\x025.\r\n",
        "\x02-1.25\r\n\x020.75\r\n",
    ]
    for name, settings in (
        ("current", {}),
        ("third", {"axis": 2, "resolution_mm": 0.005, "sign": -1}),
        ("displayed", {"value": "displayed", "poll_hz": 50.0, "latency_s": 0.03}),
        ("inch", {"value": "displayed", "unit": "inch", "axis": 8}),
    ):
        eight = [
            "\x02" + "".join(f"+{k}.5\r\n" for k in range(10)),
            "\x02" + "".join(f"+{k}\r\n" for k in range(3)) + "\x02",
        ]
        yield streamed(
            f"nd-{name}",
            "nd",
            fed(*readings, *eight, "\x02+7", ["resync"], "8\r\n", "\x02+1\r\n"),
            **settings,
        )


def _lines() -> Iterator[Case]:
    pattern = r"(?P<counter>-?\d+),(?P<position>[-+ .0-9eExA-F]*),(?P<beam>[.0-9x]+)"
    told = [
        "1,0.5,1.0",
        "2,-0.25,0.39",
        "3,+ 1.5,0.4",
        "4,- .5,0.41",
        "5,1e3,0.79",
        "6,1E-12,0.8",
        "7,,0.81",
        "8,0x1F,2.0",
        "9,5.,x",
        "9,5.,0.9",
        "10,--5,0.9",
        "12,1,0.9",
        "99,1,0.9",
        "0,2,0.9",
        "49,3,0.9",
        "0,4,0.9",
        "-1,5,0.9",
        "100,6,0.9",
        "101,7,0.9",
        "bad",
        "102,8",
        "",
        "  ",
        "103,9,0.9",
        "103,9,0.9",
        "10" * 12 + ",1,0.9",
        "5,1e123,0.9",
        "6," + "0" * 4090 + ",1",
        "7," + "0" * 4080 + "5,1.5",
        "8,1.5.5,1",
        "9,\xe9,1",
    ]
    body = [each + "\r\n" for each in told]
    for name, settings in (
        ("mm", {}),
        (
            "counts",
            {
                "unit": "counts",
                "optics": 2,
                "sign": -1,
                "counter_modulus": None,
                "scale": 3.0,
            },
        ),
        (
            "full",
            {
                "beam_full": 2.0,
                "beam_threshold": 0.4,
                "counter_modulus": 2,
                "unit": "inch",
                "rate_hz": 50.0,
                "latency_s": 0.5,
                "encoding": "utf-8",
            },
        ),
    ):
        kept = {"pattern": pattern, "counter_modulus": 100} | settings
        yield streamed(
            f"line-{name}",
            "line",
            fed(
                *body,
                "".join(body[:12]),
                "bad\r\n" + "".join(body[3:6]),
                "5,1",
                ["resync"],
                ".5,1.0\r\n",
                body[0],
            ),
            **kept,
        )
    yield streamed(
        "line-bare",
        "line",
        fed("1.5\r", "2.5", "\r\r3.5\rx\r4.5\r", "1.5\r", ["resync"], "9\r", "1.5\r"),
        pattern=r"(?P<position>\d+\.\d)",
        terminator="\r",
        unit="um",
    )
    yield streamed(
        "line-first-is-odd", "line", fed("odd\n1.5\n2.5\n"), pattern=r"(?P<position>\d+\.\d)"
    )
    yield streamed(
        "line-wraps",
        "line",
        fed(
            *(
                f"{count} 1.0\n"
                for count in (
                    65535,
                    0,
                    64536,
                    999,
                    64536,
                    1000,
                    65000,
                    463,
                    65000,
                    464,
                    10_065_000,
                )
            )
        ),
        pattern=r"(?P<counter>\d+) (?P<position>.*)",
    )


def _frames() -> Iterator[Case]:
    def framed(position: int, counter: int, beam: float, status: int) -> bytes:
        return struct.pack(">2siHfB", b"\xaa\x55", position, counter, beam, status)

    def summed(body: bytes, start: int = 0) -> bytes:
        return body + bytes((sum(body[start:]) % 256,))

    statuses = [framed(1000 + k, k, 0.9, 0x10 | 1 << k) for k in range(8)] + [
        framed(2000, 8, 0.9, 0)
    ]
    beams = [
        framed(-5, 9 + k, beam, 0x10)
        for k, beam in enumerate(
            (
                0.0,
                0.19,
                0.2,
                0.39,
                0.4,
                0.41,
                1.9,
                2.0,
                2.1,
                5.0,
                -1.0,
                float("nan"),
                float("inf"),
                0.78,
                0.81,
            )
        )
    ]
    ends = [
        framed(position, counter, 2.0, 0x10)
        for position, counter in (
            (2**31 - 1, 65535),
            (-(2**31), 0),
            (0, 5),
            (1, 5),
            (2, 65000),
            (3, 463),
            (4, 65000),
            (5, 464),
        )
    ]
    layout = ["position i32", "counter u16", "beam f32", "status u8"]
    meant = {
        "layout": layout,
        "byte_order": "big",
        "lost_bits": 0x03,
        "error_bits": 0x0C,
        "good_bits": 0x10,
        "beam_full": 2.0,
    }
    yield streamed(
        "frames-summed",
        "frames",
        fed(
            *(summed(each) for each in (*statuses, *beams, *ends)),
            b"junk" + summed(statuses[0]),
            summed(statuses[1])[:-1] + b"\x00",
            summed(statuses[2])[:5],
            ["resync"],
            summed(statuses[3]),
        ),
        sync="AA55",
        checksum="sum-8",
        unit="um",
        scale=0.1,
        sign=-1,
        rate_hz=100.0,
        latency_s=0.001,
        **meant,
    )
    yield streamed(
        "frames-checksum-from",
        "frames",
        fed(*(summed(each, 2) for each in statuses), summed(statuses[0])),
        sync="AA55",
        checksum="sum-8",
        checksum_from=2,
        unit="counts",
        optics=2,
        **meant,
    )
    yield streamed(
        "frames-plain",
        "frames",
        fed(
            *(
                struct.pack("<Bd", 0x7E, value)
                for value in (1.5, -2.5, float("nan"), float("inf"), 1e12)
            ),
            struct.pack("<Bd", 0x7E, 3.0) * 3,
            b"\x01\x02",
        ),
        sync="7E",
        layout=["position f64"],
        unit="inch",
    )

    def crced(position: int, counter: int) -> bytes:
        body = struct.pack("<Bih", 0x55, position, counter)
        return body + struct.pack(">H", binascii.crc_hqx(body, 0xFFFF))

    signed = [
        crced(7 * k, counter)
        for k, counter in enumerate(
            (32766, 32767, -32768, -32767, 31769, 32767, -31769, 32767, -31768, -5, -4)
        )
    ]
    yield streamed(
        "frames-crc",
        "frames",
        fed(*signed, crced(1, 2)[:-2] + b"\x00\x00", crced(1, 2)),
        sync="55",
        layout=["position i32", "counter i16"],
        checksum="crc-16/ccitt-false",
        checksum_order="big",
        unit="nm",
    )
    small = [
        struct.pack("<BBh", 0x31, counter, 10 * counter)
        for counter in (250, 255, 0, 127, 255, 127, 255, 126, 0)
    ]
    yield streamed(
        "frames-small-counter",
        "frames",
        fed(*small),
        sync="31",
        layout=["counter u8", "position i16"],
        good_bits=0,
    )
    wide = [struct.pack("<Bqi", 0x31, counter, 1) for counter in (5, 6, 2**62, 7, 8)]
    yield streamed(
        "frames-wide-counter",
        "frames",
        fed(*wide),
        sync="31",
        layout=["counter i64", "position i32"],
    )


def _recognised() -> Iterator[Case]:
    heads = [lasertex_distance(k) for k in range(3)]
    yield (
        "recognised",
        "recognised",
        [
            hexed(b"".join(heads)),
            hexed(heads[0]),
            hexed(b"".join(fourdof(k) for k in range(3))),
            "".join(fourdof_line(k) for k in range(4)),
            hexed(b"".join(qudis_data(k, 5) for k in range(3))),
            "".join(answer(1, 0, 1, 2, 3) for _ in range(3)),
            "".join(umd_line(k) for k in range(5)),
            "\x02+123\r\n\x02+124\r\n",
            "\x02+123\r\n",
            "",
            "Hello world, this is nothing\r\n" * 3,
            hexed(bytes(range(256))),
            hexed(heads[0][5:] + b"".join(heads)),
            hexed(b"\x01\x02" + b"".join(heads) + b"\x03\x04" + heads[0]),
            "".join(umd_line(k, ref=0) for k in range(5)),
            "x\r\n" + "".join(umd_line(k) for k in range(3)) + "y\r\n",
            "\x02ERROR\r\n\x02ERROR\r\n",
        ],
    )


def inputs() -> Iterator[Case]:
    """Yield the name of every case, who plays it, and its input."""
    yield from _qudis()
    yield from _lasertex()
    yield from _ids3010()
    yield from _displays()
    yield from _lines()
    yield from _frames()
    yield from _recognised()
