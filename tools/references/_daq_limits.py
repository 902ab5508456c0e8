"""Inputs of the reference cases of daq/formats: Every setting at its limits and just outside."""

from typing import Any


def limits() -> dict[str, list[Any]]:
    """Return every setting at its limits and just outside, by kind."""
    loss = [0, 0.001, 0.999, 1, -0.001]
    signs, lengths = (
        [1, -1, 0, 2, -2],
        {"wavelength_nm": [300, 300.001, 1999.999, 2000, 299], "optics": [0, 1, 2, 3, 4, 5]},
    )
    angles, first = {"pattern": "(?P<first>.*)"}, "(?P<air_temperature_c>.*)"
    frame: dict[str, Any] = {"sync": "AA55", "layout": ["position i32"]}
    stated = {"sync": "AA55", "layout": ["position i32", "status u8"]}
    tables: dict[str, tuple[dict[str, Any], dict[str, list[Any]]]] = {
        "umd": (
            {},
            {
                "axis": [0, 1, 2, 3, 4],
                "phase_bits": [None, 7, 8, 9, 15, 16, 17, 0],
                "sign": signs,
                **lengths,
            },
        ),
        "nd": (
            {},
            {
                "axis": [0, 1, 8, 9],
                "resolution_mm": [0, 1e-9, -1e-9],
                "poll_hz": [0, 0.001, 100, 100.001, -1],
                "sign": signs,
            },
        ),
        "qudis": ({}, {"axis": [0, 1, 2, 3, 4], "average": [-1, 0, 16, 17], "sign": signs}),
        "ids3010": (
            {},
            {
                "axis": [0, 1, 2, 3, 4],
                "poll_hz": [0, 0.001, 100, 100.001],
                "contrast_full": [0, 0.001, 0.5, 1000, 1000.001, 1001],
                "beam_threshold": loss,
                "sign": signs,
            },
        ),
        "lasertex": (
            {},
            {
                "level_full": [0, 0.001, 0.5, 255, 255.001, 256],
                "beam_threshold": loss,
                "sign": signs,
            },
        ),
        "fourdof": (
            {},
            {
                "full_sum": [None, [1, 1, 1], [1e-9, 1, 1], [0, 1, 1], [1, 1, -1]],
                "beam_threshold": loss,
                "rate_hz": [None, 0, 1e-9, 0.5, -1],
            },
        ),
        "tqd": (
            {},
            {
                "poll_hz": [0, 0.001, 0.5, 200, 200.001, 201],
                "full_sum_v": [0, 0.001, 0.5, 40, 40.001, 41],
                "beam_threshold": loss,
            },
        ),
        "angles": (
            angles,
            {
                "pattern": [
                    "(?P<first>.*)",
                    "(?P<second>.*)",
                    "(.*)",
                    "(?P<first>.)(?P<second>.)(?P<valid>.)",
                    "(?P<first>.)(?P<third>.)",
                    "(?P<first>",
                ],
                "poll_hz": [0, 0.001, 0.5, 100, 100.001, 101],
                "request": ["", "P\r", "\xe9"],
                "greeting": ["A", "\xe9"],
            },
        ),
        "air": (
            {"pattern": first},
            {
                "pattern": [
                    first,
                    "(.*)",
                    "",
                    "(?P<other>.*)",
                    first + "(?P<dew>.)",
                    "(?P<air_temperature_c>",
                    "(?=a)" + first,
                    "(?P<air_temperature_c>a{1000}){1000}" + "x" * 300,
                ],
                "request": ["", "SEND\r", "\xe9"],
                "greeting": ["R", "\xe9"],
            },
        ),
        "line": (
            {"pattern": "(?P<position>.*)"},
            {
                "pattern": [
                    "(?P<position>.*)",
                    "(?P<counter>.*)",
                    ".*",
                    "(?P<position>",
                    "(?P<position>.*)(?=x)",
                    "(?P<position>.*)" + "y" * 183 + "(",
                    "(?P<position>.*)" + "y" * 184 + "(",
                ],
                "counter_modulus": [None, 0, 1, 2, 65536],
                "beam_full": [0, 1e-9, 0.5, -1],
                "beam_threshold": loss,
                "rate_hz": [None, 0, 1e-9, 0.5, -1],
                "encoding": ["ascii", "latin-1", "utf-8", "utf-16", "cp037", "none-such"],
                "sign": signs,
                **lengths,
            },
        ),
        "frames": (
            frame,
            {
                "sync": ["", "A", "AA", "ZZ", "AA " * 16, "AA" * 17],
                "layout": [
                    ["position i32"],
                    ["counter u8"],
                    [],
                    ["position x8"],
                    ["position i32", "counter f32"],
                    ["position i32", "status f32"],
                    ["position f32", "counter u8"],
                    ["position i32", "skip 999", "skip 19"],
                    ["position i32", "skip 999", "skip 20"],
                ],
                "checksum": ["none", "sum-8", "crc-8", "crc-32"],
                "checksum_from": [-1, 0, 5, 6, 7],
                "lost_bits": [0, 1],
                "error_bits": [1],
                "good_bits": [1],
                "scale": [0, 1e-12, -1],
                "beam_full": [0, 1e-9, 0.5, -1],
                "beam_threshold": loss,
                "rate_hz": [None, 0, 1e-9, 0.5, -1],
                "sign": signs,
                **lengths,
            },
        ),
        "frames-status": (
            stated,
            {
                "lost_bits": [-1, 0, 255],
                "error_bits": [-1, 0, 1],
                "good_bits": [-1, 0, 1],
                "checksum_from": [6, 7],
            },
        ),
    }
    words: dict[str, list[Any]] = {}
    for kind, (base, values) in tables.items():
        own = kind.partition("-")[0]
        words[kind] = [
            [own, base | {name: value}]
            for name, several in values.items()
            for value in several
        ]
    words["frames"] += [
        [
            "frames",
            {
                "sync": "AA55",
                "layout": ["position i32", "skip 999", f"skip {rest}"],
                "checksum": "crc-16/arc",
            },
        ]
        for rest in (17, 18)
    ]
    words["frames"] += [
        ["frames", frame | {"checksum": "sum-8", "checksum_from": start}] for start in (6, 7)
    ]
    return words
