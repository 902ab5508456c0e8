"""Inputs of the reference cases of daq/formats: 4-DOF heads, angular instruments, sensors of
air."""

import struct
from collections.abc import Iterator

from _daq_wire import Case, fed, fourdof, fourdof_line, streamed


def _heads() -> Iterator[Case]:
    sums = [
        (1, 2, qd, 3, 4, one, 5, 6, two)
        for qd, one, two in (
            (1000, 1000, 1000),
            (199, 800, 500),
            (200, 800, 500),
            (1000, 319, 500),
            (1000, 320, 500),
            (1000, 800, 99),
            (1000, 800, 100),
            (1000, 800, 199),
            (1000, 800, 200),
            (2000, 2000, 2000),
            (-5, 1, 1),
        )
    ]
    odd = [
        (1.5, float("nan"), 900.0, 1, 2, 800.0, 3, 4, 700.0),
        (1, 2, 900.0, 1, float("inf"), 800.0, 3, 4, 700.0),
        (1, 2, float("nan"), 3, 4, 5, 6, 7, 8),
        (1.25, 2.5, 3.75, 4.125, 5, 6, 7, 8, 9),
    ]
    frames = [
        *(fourdof(k, status=1 << k) for k in range(8)),
        *(fourdof(8 + k, values=each) for k, each in enumerate(sums)),
        *(fourdof(19 + k, b"f", values=each) for k, each in enumerate(odd)),
    ]
    counts = [
        fourdof(counter)
        for counter in (
            30,
            30,
            35,
            2**32 - 1,
            0,
            1,
            2**32 - 2,
            999_997,
            2**32 - 2,
            999_999,
            3,
        )
    ]
    broken = [
        frames[0][:44] + b"\x00\x00",
        fourdof(40, b"i").replace(b"i", b"j", 1),
        b"\xf4",
        frames[1][:20],
        ["resync"],
        frames[2],
        b"\xf4\xd0" + frames[3],
        b"noise" * 5 + frames[4] + frames[5],
    ]
    for name, full in (("plain", None), ("judged", [1000.0, 1600.0, 500.0])):
        yield streamed(
            f"fourdof-{name}",
            "fourdof",
            fed(*frames, *counts, *broken),
            full_sum=full,
            rate_hz=250.0,
            latency_s=0.004,
        )
    texts = [
        *(fourdof_line(k, 1 << k) for k in range(8)),
        *(fourdof_line(8 + k, values=each) for k, each in enumerate(sums)),
        fourdof_line(20, values=(1.5, "-.5", "+3.", "1e3", "2E-2", 4, 5, 6, "1e+05")),
        fourdof_line(21, values=("1e400", *range(8))),
        fourdof_line(22, values=range(8)),
        fourdof_line(23, values=range(10)),
        fourdof_line(24, 1000),
        fourdof_line(25, 255),
        fourdof_line(99999999999),
        fourdof_line(4294967295),
        fourdof_line(0),
        fourdof_line(1).replace("*", "*0"),
        fourdof_line(1).lower(),
        fourdof_line(1)[:-2] + "\n",
        "\r\n",
        " \n",
        "$4D,1,0\r\n",
        fourdof_line(2).replace("900", "901"),
        fourdof_line(3, values=("1." + "0" * 240, *range(8))),
        "$4D,5",
        ["resync"],
        "9\n",
        fourdof_line(4),
        fourdof_line(5) * 2,
    ]
    yield streamed(
        "fourdof-ascii",
        "fourdof",
        fed(*texts),
        encoding="ascii",
        full_sum=[900.0, 900.0, 900.0],
        beam_threshold=0.3,
    )

    def detector(x: int, y: int, total: int) -> bytes:
        return bytes.fromhex("72080c0081500300") + struct.pack("<hhHhh", x, y, total, 5, 6)

    sees = [
        detector(*each)
        for each in (
            (0, 0, 30000),
            (1, -1, 30000),
            (32766, 0, 30000),
            (32767, 0, 30000),
            (0, 32767, 30000),
            (-32766, 0, 30000),
            (-32767, 0, 30000),
            (-32768, 5, 30000),
            (5, -32768, 30000),
            (0, 0, 65534),
            (0, 0, 65535),
            (0, 0, 0),
            (0, 0, 3276),
            (0, 0, 3277),
            (0, 0, 6553),
            (0, 0, 6554),
            (10, 20, 16383),
        )
    ]
    yield streamed(
        "tqd",
        "tqd",
        fed(
            *sees,
            b"".join(sees),
            b"\x01\x02" + sees[0],
            sees[1][:9],
            ["resync"],
            sees[2],
            sees[3][:8],
        ),
        poll_hz=40.0,
        latency_s=0.02,
    )
    yield streamed("tqd-volts", "tqd", fed(*sees), full_sum_v=20.0, beam_threshold=0.5)

    lines = [
        "3 003 10.5 -20.25",
        "3 001 1 2",
        "3 002 1 2",
        "3 000 1 2",
        "3 004 1 2",
        "4 003 1 2",
        "2 003 1 2",
        "3 003 1",
        "3 003 1 2 3",
        "",
        " ",
        "  3  993   -7.  +8.5  ",
        "3 03 1 2",
        "3 003 206264 1",
        "3 003 206265 1",
        "3 003 1 -206265",
        "3 003 x 1",
        "3 003 1e3 1",
    ]
    from_elcomat = [each + "\r" for each in lines]
    elcomat = (
        r"\s*3\s+[0-9][0-9](?P<valid>[0-3])\s+(?P<first>[-+]?[0-9]+(?:\.[0-9]*)?)\s+(?P<second>"
        r"[-+]?[0-9]+(?:\.[0-9]*)?)\s*"
    )
    yield streamed(
        "elcomat",
        "elcomat",
        fed(
            "cut 3 003 1 2\r",
            *from_elcomat,
            "".join(from_elcomat),
            "x" * 200 + "\r",
            "x" * 201 + "\r",
            " " * 187 + "3 003 5 6    \r",
            " " * 188 + "3 003 5 6    \r",
            "3 003",
            ["resync"],
            " 1 2\r",
            from_elcomat[0],
        ),
        pattern=elcomat,
        greeting="A",
        latency_s=0.1,
    )
    for unit in ("arcsec", "urad", "mrad", "deg"):
        level = [
            "a 1.5 x 7\n",
            "b,-2.25,c\n",
            "c;3\n",
            "d\n",
            "\n",
            "e 57.2958\n",
            "f 58\n",
            "g 999\n",
            "h 1001\n",
            "i 1000000\n",
            "j 1000001\n",
        ]
        yield streamed(
            f"wyler-{unit}",
            "wyler",
            fed(*level, "a 1", ["resync"], "b 2\n"),
            pattern=r"\s*[^\s,;]+[\s,;]+(?P<first>[-+]?[0-9]+(?:\.[0-9]*)?)(?:[\s,;].*)?",
            unit=unit,
            request="P",
            poll_hz=5.0,
            terminator="\n",
        )
    loose = r"(?P<valid>[^ ]*) (?P<first>[^ ]*)(?: (?P<second>[^ ]*))?"
    yield streamed(
        "angles-loose",
        "elcomat",
        fed(
            "\r",
            *(
                f"{each}\r"
                for each in (
                    "3 1 2",
                    "1 1 2",
                    "2 1 2",
                    " 1 2",
                    "3  2",
                    "3 1 ",
                    "3 1",
                    "x 1 2",
                    "3 a 2",
                    "3 1 nan",
                    "7 1 2",
                    "0 1 2",
                    "3 inf 1",
                )
            ),
        ),
        pattern=loose,
        unit="urad",
    )


def _sensors() -> Iterator[Case]:
    groups = {
        "air_temperature_c": "T",
        "air_pressure_hpa": "P",
        "relative_humidity_percent": "H",
        "material_temperature_c": "M",
    }
    pattern = " ".join(f"{letter}=(?P<{name}>[^ ]*)" for name, letter in groups.items())
    said = [
        "T=20.5 P=1013.25 H=45 M=21.25",
        "T=** P=1000 H=** M=**",
        "T= P= H= M=",
        "T=-5 P=1e3 H=0 M=nan",
        "T=inf P=1 H=1 M=1",
        "what",
        "",
        ">",
        "SEND",
        "> send \r",
        "T=1 P=2 H=3 M=4\r",
        "\0T=1 P=2 H=3 M=4\r\0",
        "T=1 P=2 H=3",
    ]
    body = [each + "\n" for each in said]
    for unit, pressure in (
        ("C", "hPa"),
        ("F", "mbar"),
        ("K", "kPa"),
        ("C", "Pa"),
        ("C", "bar"),
        ("C", "mmHg"),
        ("C", "inHg"),
    ):
        yield streamed(
            f"air-{unit}-{pressure}",
            "air-line",
            fed("cut\n", *body),
            pattern=pattern,
            temperature_unit=unit,
            pressure_unit=pressure,
            greeting="R\r",
        )
    ptu = (
        r"[>\s]*P\s*=\s*(?P<air_pressure_hpa>[-+.0-9*]+)\s*hPa"
        r"\s+T\s*=\s*(?P<air_temperature_c>[-+.0-9*]+)"
        r"\s*'C\s+RH\s*=\s*(?P<relative_humidity_percent>[-+.0-9*]+)\s*%RH\s*"
    )
    asked = [
        "SEND\r\n",
        "P= 1013.2 hPa T= 31.1 'C RH= 38.3 %RH\r\n",
        ">P= 1013.2 hPa T= **** 'C RH= 38.3 %RH\r\n",
        "P= **** hPa T= **** 'C RH= **** %RH\r\n",
        "x" * 500 + "\n",
        "x" * 501 + "\n",
        " " * 463 + "P= 1013.2 hPa T= 31.1 'C RH= 38.3 %RH\n",
        " " * 464 + "P= 1013.2 hPa T= 31.1 'C RH= 38.3 %RH\n",
        "P= 10",
        ["resync"],
        "13.2 hPa T= 31.1 'C RH= 38.3 %RH\r\n",
    ]
    yield streamed("ptu300", "ptu300", fed(*asked), pattern=ptu, request="SEND\r", poll_s=4.0)
    yield streamed(
        "air-speaks",
        "air-line",
        fed("a 5\r", "a 6\r", "a", ["resync"], " 7\r", "a 8\r"),
        pattern=r"a (?P<material_temperature_c>.*)",
        terminator="\r",
    )


def inputs() -> Iterator[Case]:
    """Yield the name of every case, who plays it, and its input."""
    yield from _heads()
    yield from _sensors()
