"""Inputs of the reference cases of daq/formats: the uMD boards."""

from collections.abc import Iterator

from _daq_wire import Case, fed, streamed, umd_line, umd_three


def _umd() -> Iterator[Case]:
    told = [
        (8, 100_000),
        (10, 108),
        (1, 40),
        (2, 50),
        (3, 2134),
        (4, -250),
        (5, 101325),
        (6, 452),
        (20, 0),
        (77, 5),
        (9, 1),
    ]
    plain = [
        umd_line(k + 1, at=1000 * k, code=code, data=data)
        for k, (code, data) in enumerate([(0, 0), *told, *told])
    ]
    bits = [
        umd_line(k + 30, at=512 + k, phase=value)
        for k, value in enumerate(
            (*(1 << bit for bit in range(16)), -1, -256, 255, 0x7E00, 0x1FF)
        )
    ]
    rates = [
        umd_line(60, code=8, data=100_000),
        *(
            umd_line(61 + k, ref=ref, meas=meas, at=9)
            for k, (ref, meas) in enumerate(
                (
                    (2000, 99),
                    (2000, 100),
                    (2000, 101),
                    (2000, 3899),
                    (2000, 3900),
                    (2000, 3901),
                    (0, 50),
                    (1, 0),
                    (0, 0),
                    (2000, 1),
                    (60, 100),
                )
            )
        ),
    ]
    yield streamed(
        "umd-one-axis",
        "umd",
        fed(*plain, "".join(bits), "".join(rates), umd_line(72)),
        sign=-1,
        latency_s=0.024,
    )
    three = [
        umd_three(k + 1, *(told[k] if k < len(told) else (0, 0)), phase=3 * k)
        for k in range(16)
    ]
    for axis in (1, 2, 3):
        steps = fed(
            "".join(three),
            umd_line(17),
            umd_three(18),
            "".join(umd_three(19 + k, phase=1) for k in range(12)),
        )
        yield streamed(
            f"umd-axis-{axis}",
            "umd",
            steps,
            axis=axis,
            optics=(1, 2, 4)[axis - 1],
            wavelength_nm=632.8 + axis,
            phase_bits=(None, 8, 16)[axis - 1],
        )
    sequence = [
        1,
        2,
        2,
        2,
        3,
        9,
        32767,
        32766,
        32767,
        -32768,
        -32767,
        -31769,
        32767,
        -31769,
        32767,
        -31768,
        2**31 - 1,
        -(2**31) + 5,
        2**32 - 2,
        998,
        2**32 - 1,
        1000,
        10_001_001,
        20_001_002,
    ]
    yield streamed(
        "umd-counts", "umd", fed(*(umd_line(seq, at=7 * k) for k, seq in enumerate(sequence)))
    )
    odd = [
        "98 7 5\r\n",
        umd_line(1),
        "Minimalist Homodyne Test:\r\n",
        umd_line(1),
        umd_line(2),
        "!debug \xe9 words \r\n",
        "ab\r\n",
        "abcd\r\n",
        "\r\n",
        "   \r\n",
        umd_line(3).replace(" ", "\t"),
        "  " + umd_line(4),
        umd_line(5, at=-(10**18) + 1),
        umd_line(6, at=10**18 - 1),
        umd_line(7, at=10**18),
        umd_line(8, at=-(10**18)),
        "0 1 2 3 4 5 6\r\n",
        "0 1 2 3 4 5 6 7 8\r\n",
        "1 2 3 4 5 6 7 8.5\r\n",
        "1 2 3 4 5 - 7 8\r\n",
        "1 2 -3 4 5 9 0 0\r\n",
        "0" * 1008 + umd_line(10)[4:],
        "0" * 1030 + umd_line(11),
        "Banner again\r\n",
        "Banner twice\r\n",
        umd_line(12),
        "uMD ~",
        "\x7f\r\n",
        "1banner\r\n",
        "!" + "x" * 1100 + "\r\n",
        "!" + "y" * 60 + "\r\n",
    ]
    yield streamed(
        "umd-odd-lines",
        "umd",
        fed(
            *odd,
            ["resync"],
            "5 5 5\r\n",
            umd_line(13),
            "2000 21",
            ["resync"],
            "00 7 0\r\n",
            umd_line(14),
        ),
    )
    yield streamed(
        "umd-first-line-cut", "umd", fed("100 7 0 0 5 0 0\r\n" + umd_line(5), umd_line(6))
    )
    yield streamed(
        "umd-first-line-whole",
        "umd",
        fed(umd_line(5, phase=4)[4:], umd_line(6), umd_line(5, phase=4)),
    )
    yield streamed(
        "umd-homodyne",
        "umd",
        fed(
            umd_line(1, ref=0, meas=0, at=400),
            umd_line(2, ref=0, meas=0, at=404),
            umd_line(3, ref=0, meas=0, at=408, code=20, data=0x0401),
            umd_line(4, ref=0, at=411, phase=64),
            umd_line(5, ref=0, at=412, code=10, data=100),
            umd_line(6, ref=0, at=413, phase=64),
            umd_line(7, ref=0, at=413, code=20, data=0x0001),
            umd_line(8, ref=0, at=414),
            umd_line(9, ref=0, at=414, code=20, data=0x0400),
            umd_line(10, at=415),
            umd_line(11, ref=0, at=416),
            umd_line(12, at=417, code=8, data=24414),
            umd_line(13, at=418, code=8, data=24700),
            umd_line(14, code=8, data=0),
            umd_line(15, code=8, data=-5),
            umd_line(16, code=8, data=1),
        ),
    )
    steady = [
        [["".join(umd_line(k, at=k) for k in range(a, b)), 1000 * a] for a, b in pairs]
        for pairs in (
            [(2, 6), (6, 15), (15, 16)],
            [(16, 40), (40, 41)],
            [(41, 44), (46, 50)],
            [(43, 60)],
        )
    ]
    other = [
        [[umd_line(44, at=1, code=8, data=50_000), 5], [umd_line(45), 6]],
        [[umd_line(45, code=8, data=50_000) * 1, 7]],
        [[umd_line(46, meas=0), 8]],
        [["2000 2100 5", 9]],
        [[" 5 0 46 0 0\r\n", 10], [umd_line(47), 11]],
        [["Greeting of it\r\n", 12]],
        [[umd_three(48), 13]],
    ]
    yield streamed(
        "umd-steady",
        "umd",
        fed(
            ["steady", [[umd_line(1), 3]]],
            umd_line(1),
            *(["steady", each] for each in steady[:2]),
            ["steady", steady[2]],
            "".join(umd_line(k) for k in range(41, 44)),
            ["steady", other[0]],
            umd_line(44, at=1, code=8, data=50_000),
            *(["steady", each] for each in other[1:5]),
            ["steady", other[5]],
            "Greeting of it\r\n",
            ["steady", [[umd_line(48), 14]]],
            umd_line(48),
            ["steady", [[umd_line(49), 15], [umd_line(50), 16]]],
            ["steady", other[6]],
        ),
    )
    for axis in (2, 3):
        cut = [
            ["".join(umd_three(k) for k in range(5 * a + 2, 5 * a + 7)), a] for a in range(3)
        ]
        yield streamed(
            f"umd-steady-axis-{axis}",
            "umd",
            fed(umd_three(1), ["steady", cut], ["steady", [[umd_line(17), 9]]]),
            axis=axis,
        )
    rows = "".join(umd_line(k, at=-k) for k in range(9))
    yield (
        "umd-lines",
        "umd-lines",
        [
            "",
            "\r\n",
            umd_line(1),
            rows,
            rows + "x\r\n" + rows,
            rows.replace(" 5 0 4 0", " 5 0 4"),
            rows.replace("2100 -4", "2100 4-"),
            rows.replace("2100 -4", "2100 -0"),
            rows.replace("2100 -4", "2100 --4"),
            rows.replace("2100 -4 ", "2100 -"),
            rows.replace("2100 -4", "2100-4"),
            rows.replace("\r", ""),
            "".join(umd_three(k) for k in range(5)),
            "".join(umd_three(k).replace(" \r", "\r") for k in range(5)),
            rows.replace("2000", "0" * 41 + "1"),
            rows.replace("2000", "0" * 39 + "1"),
            rows.replace("2100", str(10**18)),
            rows.replace("2100", str(10**18 - 1)),
            rows.replace("2100", str(1 - 10**18)),
            rows.replace("2100", str(-(10**18))),
            rows.replace(" 5 ", " 5  "),
            rows.replace(" 2100", "\t2100"),
            umd_line(1) * 4 + "1" * 70 + umd_line(2)[70:] + umd_line(3),
            "".join(umd_line(7) for _ in range(5)) + "-",
            "2 2 2 2 2 2 2 2\n" * 12,
            "2 2 2 2 2 2 2 22\n" * 12,
            "1 1 1 1 1 1 1 1\n" * 12 + "1 1 1 1 1 1 1\n",
            "2 2 2 2 2 2 2 -\n" * 14,
            "- 2 2 2 2 2 2 2\n" * 14,
            rows.replace("2000", "").replace("  ", " "),
            "1 2 3 4 5 6 7 8 9\n" * 14,
            "Header of the thing\r\n" + rows,
            rows + "!done\r\n",
            "1 2 3 4 5 6 7 \n" * 16,
            "1 2 3 4 5 6 7 8 \n" * 16,
        ],
    )
    firmwares = (
        0,
        1,
        100,
        263,
        264,
        299,
        300,
        314,
        315,
        316,
        6000,
        0xFFFF,
        0x10000 + 264,
        0x10000 + 315,
        0x20000,
    )
    codes = [[10, firmware] for firmware in firmwares]
    flags = [
        [10, 264],
        *([112, value] for value in (0, 1, 2, 3, 4, 0xFFFD, 2)),
        [10, 108],
        [112, 2],
        [10, 299],
        [10, 300],
    ]
    more = [
        [3, 100],
        [3, 100],
        [4, 5],
        [5, 7],
        [6, 8],
        [1, 3],
        [1, 3],
        [2, 4],
        [7, 1],
        [11, 1],
        [111, 2],
        [113, 2],
        [20, 0x0301],
        [20, 0x0300],
        [20, 0x01FF],
        [20, 0x10002],
    ]
    rates = [
        [8, value]
        for value in (24414, 24414, 24657, 24659, 24170, 24168, 100, 0, -100, 1, 100_000)
    ]
    for phase_bits in (None, 8, 16):
        yield (
            f"umd-board-{phase_bits}",
            "umd-board",
            {"phase_bits": phase_bits, "codes": [*codes, *flags, *more, *rates]},
        )
    rows_of = [
        [ref, meas, 1000 + k, phase]
        for k, (ref, meas) in enumerate(
            (
                (2000, 2100),
                (0, 5),
                (5, 0),
                (0, 0),
                (2000, 99),
                (2000, 100),
                (2000, 3900),
                (2000, 3901),
                (50, 100),
            )
        )
        for phase in (
            0,
            64,
            -64,
            255,
            256,
            0x200,
            0x400,
            0x4000,
            0x8000,
            0x7E00,
            -0x7E00,
            65535,
        )
    ]
    for use in ("unknown", "8-bit", "16-bit", "ignored"):
        for homodyne, rate_hz, counts in (
            (None, 1000.0, 1),
            (False, None, 1),
            (True, 1000.0, 4),
        ):
            reading = {
                "rate_hz": rate_hz,
                "homodyne": homodyne,
                "counts_per_cycle": counts,
                "phase_use": use,
            }
            yield (
                f"umd-reading-{use}-{homodyne}",
                "umd-reading",
                {"reading": reading, "rows": rows_of},
            )


def inputs() -> Iterator[Case]:
    """Yield the name of every case, who plays it, and its input."""
    yield from _umd()
