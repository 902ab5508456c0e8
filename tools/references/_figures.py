"""Made-up numbers for the solver's functions of plain arrays; drawn once, then recorded."""

import numpy as np

from testkit.exact.optics import channels_of

RNG = np.random.default_rng(20261124)


def short(values, digits=5):
    """Return numbers as a person would write them."""
    return np.round(np.asarray(values, dtype=float), digits).tolist()


def air():
    """Return airs from cold to hot, at the ends of each scale, and some that are none."""
    usual = {
        "temperature_c": 21.3,
        "pressure_hpa": 1007.0,
        "humidity_percent": 47.0,
        "wavelength_nm": 632.991,
    }
    changes = [
        {},
        {"temperature_c": -38.0},
        {"temperature_c": 62.0, "humidity_percent": 88.0},
        {"pressure_hpa": 640.0},
        {"humidity_percent": 0.0},
        {"humidity_percent": 100.0},
        {"wavelength_nm": 543.5, "pressure_hpa": 1100.0},
        {"temperature_c": -40.0},
        {"temperature_c": 100.0},
        {"pressure_hpa": 100.0},
        {"pressure_hpa": 1400.0},
        {"temperature_c": -40.1},
        {"temperature_c": 100.2},
        {"pressure_hpa": 99.9},
        {"pressure_hpa": 1400.1},
        {"humidity_percent": -0.1},
        {"humidity_percent": 100.1},
    ]
    return {"air": [usual | change for change in changes]}


def expansion():
    """Return the readings of a warm diagonal."""
    travel = np.outer(np.arange(5), [100.0, 60.0, 40.0])
    warm = 20.0 + np.array([[1.5, 0.3, -0.7]]) + 0.2 * np.arange(5)[:, None]
    moved = {
        "travel_mm": short(travel),
        "direction": [0.6, -0.64, 0.48],
        "coefficient_um_m_c": [11.7, 10.5, 0.9],
        "temperature_c": short(warm),
    }
    return {"moved": moved, "reading_mm": short(np.arange(5) * 87.0)}


def _table(targets, ups, downs, span, reversal=4.0):
    at = np.linspace(0.0, span, targets)
    shape = 6.0 * np.sin(at / span * 4.0) + 0.01 * at
    up = shape[:, None] + RNG.normal(0, 0.8, (targets, ups))
    table = {"target_mm": short(at), "up_um": short(up, 3)}
    if downs:
        table["down_um"] = short(
            shape[:, None]
            + reversal * np.cos(at / span * 3.0)[:, None]
            + RNG.normal(0, 1.1, (targets, downs)),
            3,
        )
    return table


def positioning():
    """Return tables of runs: as the standard asks, too few of each, one way, single runs, long
    axes, and incomplete ones."""
    good = _table(6, 5, 5, 900.0)
    return {
        "tables": [
            good,
            _table(5, 5, 5, 1000.0),
            _table(5, 5, 4, 1001.0),
            _table(4, 3, 3, 400.0),
            _table(7, 5, 0, 1400.0),
            _table(6, 1, 1, 500.0),
            _table(6, 2, 1, 500.0),
            _table(9, 5, 5, 2000.0),
            _table(10, 5, 5, 2001.0),
            _table(9, 1, 1, 2100.0, -3.0),
            _table(10, 6, 5, 1801.0),
            good | {"up_um": good["up_um"][:-1]},
            good | {"down_um": good["down_um"][1:]},
            good | {"up_um": [1.0] * 6},
            good | {"up_um": [[] for _ in range(6)]},
        ]
    }


def arranged():
    """Return rows of passes in any order."""
    at = [0.0, 100.0, 200.0, 300.0]
    rows = [
        (mm, number, 0.01 * mm + number + 0.3 * (number % 2))
        for number in (3, 1, 2, 4)
        for mm in (at if number % 2 else at[::-1])
    ]
    columns = [
        dict(
            zip(
                ("target_mm", "pass_number", "deviation_um"),
                zip(*some, strict=True),
                strict=True,
            )
        )
        for some in (rows, rows[:8], rows[:4])
    ]
    return {
        "rows": [
            *columns,
            dict(
                zip(
                    ("target_mm", "pass_number", "deviation_um"),
                    zip(*rows[:-1], strict=True),
                    strict=True,
                )
            ),
        ]
    }


def lines():
    """Return deviations of guideways: drawn, repeated positions, two points, symmetric zones, and
    what spans no line."""
    at = np.arange(0.0, 900.0, 75.0)
    drawn = [
        {
            "position_mm": short(at),
            "deviation_um": short(RNG.normal(0, 3, len(at)) + 0.02 * at + 5.0, 3),
        }
        for _ in range(3)
    ]
    mixed = RNG.permutation(np.repeat(at[:6], 3))
    return {
        "runs": [
            *drawn,
            {"position_mm": short(mixed), "deviation_um": short(RNG.normal(0, 2, 18), 3)},
            {"position_mm": [10.0, 30.0], "deviation_um": [1.0, 4.0]},
            {"position_mm": [0.0, 1.0, 2.0, 3.0], "deviation_um": [0.0, 2.0, -1.5, 0.5]},
            {"position_mm": [5.0, 5.0], "deviation_um": [0.0, 2.0]},
            {"position_mm": [5.0], "deviation_um": [0.0]},
            {"position_mm": [5.0, 6.0], "deviation_um": [0.0, float("nan")]},
            {"position_mm": [float("inf"), 6.0], "deviation_um": [0.0, 1.0]},
        ]
    }


def head():
    """Return the channels of a head whose detectors are turned, bent and leak, with samples that
    are dark, blinded, far and tilted."""
    count = 16
    time_s = np.arange(count) * 7.0
    shifts = np.column_stack(
        [
            40.0 * np.sin(time_s / 30.0),
            25.0 * np.cos(time_s / 21.0),
            6.0 * np.sin(time_s / 44.0),
            3.0 + time_s / 50.0,
            9.0 * np.cos(time_s / 18.0),
            -7.0 + time_s / 31.0,
        ]
    )
    shifts += RNG.normal(0, 0.3, shifts.shape)
    shifts[9, 0], shifts[10, 4] = 1900.0, 2400.0
    channels = channels_of(shifts)
    channels[3, 2], channels[5, 5], channels[7, 8] = 0.3, 9.5, 0.5
    channels[12, 6] = 3.4
    channels[14, 0] = 2.94

    def axis(sign, *coefficients, kind="polynomial", u_um=0.0):
        return {
            "sign": sign,
            "curve": {
                "kind": kind,
                "coefficients_um": coefficients,
                "low": -0.93,
                "high": 0.91,
                "u_um": u_um,
            },
        }

    return {
        "head": {
            "detectors": {
                "qd": {
                    "x": axis(1, 0.2, 4400.0, 0.0, 90.0, kind="erf", u_um=0.4),
                    "y": axis(-1, 0.0, 4500.0, kind="erf", u_um=0.3),
                    "rotation_mrad": 3.0,
                },
                "psd1": {
                    "x": axis(1, 0.0, 5000.0, 7.0, u_um=0.2),
                    "y": axis(1, -0.3, 5000.0, u_um=0.25),
                    "rotation_mrad": -2.0,
                },
                "psd2": {
                    "x": axis(-1, 0.0, 5100.0, u_um=0.15),
                    "y": axis(1, 0.0, 4900.0, 3.0, u_um=0.35),
                    "rotation_mrad": 5.0,
                },
            },
            "lengths": {
                "psd1_focal_length_mm": 300.0,
                "psd2_focal_length_mm": 280.0,
                "dead_path_mm": 320.0,
                "extra_path_mm": 60.0,
                "lever_scale": 1.01,
            },
            "crosstalk": {
                "vertex_mm": [12.0, -8.0, 30.0],
                "psd1_leak": [0.02, -0.03],
                "psd2_leak": [0.04, 0.01],
                "qd_gain_per_m": [0.05, -0.02],
                "qd_calibrated_at_mm": 400.0,
            },
        },
        "channels": short(channels, 7),
        "travel_mm": short(np.linspace(0.0, 1500.0, count)),
        "edges": [
            [0.0, 0.0, 1.0],
            [0.92, 0.0, 1.0],
            [0.0, 0.92, 1.0],
            [-0.95, 0.5, 1.0],
            [0.5, -0.95, 1.0],
            [0.93, -0.94, 1.0],
            [1.01, 0.0, 1.0],
            [4.0, -3.0, 9.1],
            [0.1, 0.1, 0.5],
        ],
        "roll_urad": short(np.linspace(-20.0, 30.0, count)),
        "time_s": short(np.roll(time_s, 2)),
        "u_psd1_urad": short(np.full((count, 2), 0.7) + 0.1 * np.arange(count)[:, None]),
    }


def mounts():
    """Return a run with repeated stops, and heads that stood in every way; some cannot."""
    at = np.repeat(np.arange(5) * 120.0, [2, 3, 1, 2, 2])
    ways = [
        ("x", "+x", "+y", "+z", "tool", "end-point"),
        ("x", "-x", "+z", "-y", "work", "least-squares"),
        ("y", "+y", "-x", "+z", "tool", "minimum-zone"),
        ("z", "-z", "-y", "-x", "work", "end-point"),
        ("z", "+z", "+x", "+y", "tool", "least-squares"),
        ("x", "+y", "+x", "+z", "tool", "end-point"),
        ("x", "+x", "+y", "-y", "tool", "end-point"),
    ]
    return {
        "position_mm": short(at),
        "straightness_um": short(RNG.normal(0, 3, (10, 2)), 3),
        "angle_urad": short(RNG.normal(0, 5, (10, 2)), 3),
        "mounts": [
            {
                "mount": {
                    "axis": a,
                    "beam": b,
                    "detector_x": dx,
                    "detector_y": dy,
                    "target_on": on,
                },
                "line": line,
            }
            for a, b, dx, dy, on, line in ways
        ],
    }


def commissioning():
    """Return curves of detectors."""
    reading = np.linspace(-0.8, 0.8, 17)
    shift = 900.0 * reading + 60.0 * reading**3 + RNG.normal(0, 0.5, 17)
    return {
        "curves": [
            {
                "reading": short(reading),
                "shift_um": short(shift),
                "degree": 3,
                "u_reference_um": 0.3,
            },
            {
                "reading": short(reading),
                "shift_um": short(-shift),
                "kind": "erf",
                "degree": 5,
            },
            {"reading": short(reading), "shift_um": short(shift), "degree": 1},
            {"reading": short(reading), "shift_um": short(reading**2), "degree": 3},
            {"reading": short(reading[:7]), "shift_um": short(shift[:7]), "degree": 5},
            {"reading": short(reading[:8]), "shift_um": short(shift[:8]), "degree": 5},
            {
                "reading": [*short(reading[:-1]), 1.2],
                "shift_um": short(shift),
                "kind": "erf",
                "degree": 3,
            },
            {
                "reading": short(reading),
                "shift_um": [*short(shift[:-1]), float("nan")],
                "degree": 3,
            },
        ],
        "erf": [-1.0, -0.999999, -0.7, -1e-3, 0.0, 0.2, 0.9, 0.9999, 1.0, 1.5],
    }


def drifts():
    """Return runs of a source that drifts slowly, fast, not at all, with gaps in time, and too
    few."""
    runs = []
    for count, walk, noise, told in (
        (12, 0.3, 1.0, 0.9),
        (30, 2.0, 0.3, 0.0),
        (60, 0.0, 1.0, 1.0),
        (4, 1.0, 1.0, 0.5),
        (5, 1.0, 1.0, 0.5),
        (20, 5.0, 0.01, 0.0),
    ):
        drift = np.cumsum(RNG.normal(0, walk, count))
        lever = 350.0 + np.linspace(0, 2000.0, count)
        time_s = np.cumsum(5.0 + (np.arange(count) % 7 == 3) * 40.0)
        runs.append(
            {
                "time_s": short(time_s),
                "seen_urad": short(drift + RNG.normal(0, noise, count), 4),
                "u_urad": short(np.full(count, told)),
                "spot_um": short(1e-3 * lever * drift + RNG.normal(0, 0.2, count), 4),
                "lever_mm": short(lever),
            }
        )
    rng = np.random.default_rng(77)
    for real, noise, told in (
        (5.0, 0.2, 4.0),
        (3.0, 1.5, 3.0),
        (4.0, 4.0, 5.0),
        (1.0, 6.0, 6.0),
    ):
        quick, lever = rng.normal(0, real, 24), 350.0 + np.linspace(0, 2000.0, 24)
        runs.append(
            {
                "time_s": short(np.arange(24) * 6.0),
                "seen_urad": short(quick + rng.normal(0, noise, 24), 4),
                "u_urad": short(np.full(24, told)),
                "spot_um": short(1e-3 * lever * quick + rng.normal(0, 0.5, 24), 4),
                "lever_mm": short(lever),
            }
        )
    still = {
        "time_s": [1.0] * 6,
        "seen_urad": [2.0] * 6,
        "u_urad": [0.0] * 6,
        "spot_um": [0.0] * 6,
        "lever_mm": [500.0] * 6,
    }
    return {"runs": [*runs, still]}


def statistics():
    """Return series at standstill, and runs beside a reference instrument."""
    raw = RNG.normal(0, 2, 37) + np.linspace(0, 5, 37)
    at, ref = np.arange(0.0, 700.0, 100.0), np.arange(50.0, 600.0, 60.0)
    both = {
        "position_mm": short(at),
        "measured": short(RNG.normal(0, 3, 7)),
        "reference_mm": short(ref[::-1]),
        "reference": short(RNG.normal(0, 3, 10)),
    }
    return {
        "series": [
            {
                "raw": short(raw),
                "compensated": short(0.3 * raw + RNG.normal(0, 0.1, 37)),
                "interval_s": 0.5,
            },
            {"raw": short(raw[:16]), "compensated": short(2.0 * raw[:16]), "interval_s": 2.0},
            {"raw": [1.0] * 4, "compensated": [1.0, 2.0, 1.0, 0.0], "interval_s": 1.0},
            {"raw": [1.0, 2.0], "compensated": [1.0, 2.0], "interval_s": 1.0},
            {"raw": [1.0, 2.0, 4.0], "compensated": [1.0, 2.0], "interval_s": 1.0},
            {"raw": [1.0, 2.0, 4.0], "compensated": [1.0, 2.0, 2.0], "interval_s": 1.0},
        ],
        "comparisons": [
            both,
            both | {"line": "end-point"},
            both | {"line": "least-squares"},
            both | {"position_mm": short(at + 560.0)},
            both | {"position_mm": short(at - 550.0)},
            both | {"position_mm": short(at + 490.0)},
            both | {"position_mm": short(at - 540.0)},
            both | {"position_mm": short(at + 390.0)},
            both | {"reference_mm": [], "reference": []},
        ],
    }


def intervals():
    """Return figures of every size and form."""
    return {
        "figures": [
            3,
            0.04,
            9.949,
            9.951,
            123.4,
            True,
            None,
            "3",
            [],
            {},
            {"value": None},
            {"value": 2.345},
            {"value": 2, "low": 1.31, "high": 3.29},
            {"value": 8.0, "low": 6.04, "high": 9.96},
            {"value": 80.0, "low": 60.4, "high": 99.2},
            {"value": 5.0, "low": 1.0},
            {"value": 5.0, "high": 7.0},
            {"value": 0.3, "low": 0.2, "high": 0.4},
            {"value": -12.0, "low": -14.0, "high": -10.2},
            {"value": 1.0, "low": "0", "high": 2.0},
        ]
    }


def geometry():
    """Return names of setups and chains, right and wrong, and a volume."""
    setups = [
        "ppp",
        "npp",
        "pnp",
        "ppn",
        "face-xy-pp",
        "face-xz-np",
        "face-yz-np",
        "body-ppp",
        "body-pnp",
        "linear-x",
        "linear-y",
        "linear-z",
        "ppp+1",
        "face-xy-pp+12",
        "linear-z+99999",
        "ppp+",
        "ppp+0",
        "ppp+01",
        "ppp+100000",
        "ppp+-1",
        "ppp+x",
        "ppp+²",
        "PPP",
        "pppp",
        "nnp",
        "linear-a",
        "linear",
        "linx",
        "face-yx-pp",
        "body",
        "xyzzy",
        "",
        "diagonal-1",
        "lineer-y",
        "face-xy-nn",
        "q",
    ]
    chains = [
        "FXYZ",
        "XFYZ",
        "XYFZ",
        "XYZF",
        "YXFZ",
        "ZFXY",
        " FXYZ ",
        "[w X' b Y Z t]",
        "[w b X Y Z t]",
        "[w Y’ X′ b Z t]",
        "[w X Y b Z t]",
        "[w X' Y b Z t]",
        "[w b X' Y Z t]",
        "[w X' b Y Z]",
        "[b X Y Z t]",
        "[]",
        "[w t]",
        "",
        "XYZ",
        "FXYY",
        "FXYZF",
        "fxyz",
        "X'FYZ",
        "FX'YZ",
        "[w X b Y Z F t]",
    ]
    return {
        "setups": setups,
        "chains": chains,
        "origin_mm": [-50.0, 20.0, 5.0],
        "size_mm": [300.0, 210.0, 90.0],
        "increments": 3,
        "sizes": [[9.9, 1.0], [10.0, 1.0], [10.1, 2.0], [0.5, 0.4, 0.3], [300.0, 0.1]],
    }


FIGURES = {
    "air": ("refractive index, wavelength and dead path of every air", "air", air),
    "expansion": ("a warm diagonal brought to 20 C", "expansion", expansion),
    "positioning": (
        "ISO 230-2, ISO 230-6, B5.54, VDI 3441 and their U",
        "positioning",
        positioning,
    ),
    "arranged": ("rows of passes as tables", "arranged", arranged),
    "lines": ("reference lines of straightness", "lines", lines),
    "head": ("a 4-DOF head with every crosstalk", "head", head),
    "mounts": ("a head's run as errors of the axis", "mounts", mounts),
    "commissioning": ("curves of a head's detectors", "commissioning", commissioning),
    "drifts": ("pointing freed of its noise", "drifts", drifts),
    "statistics": ("stability and comparison of a head", "statistics", statistics),
    "intervals": ("figures as they are written", "intervals", intervals),
    "geometry": ("setups, chains and stops", "geometry", geometry),
}
