"""Made-up numbers for rules that say something of a survey: limits from both sides, scatter, curves
between targets, temperatures."""

from dataclasses import replace

import numpy as np
from _surveys import THREE, angles, moved, survey

RNG = np.random.default_rng(20261125)


def _good():
    return survey(THREE.survey(passes=(1, 2)), angles=angles(THREE))


def _noisy_pass():
    """Return a survey of which one pass is noisier than it says."""
    quiet = replace(THREE, angle_urad=0.0, diagonal_noise_um=0.05, linear_noise_um=0.05)
    noise = np.random.default_rng(3).normal(0.0, 0.8, 20)
    return survey(
        moved(quiet.survey(passes=(1, 3, 5)), "npp", 3, lambda stop: noise[stop.astype(int)]),
        angles=angles(quiet),
    )


def limits():
    """Return surveys, and what their reports and their scatter might be."""
    drift = {"pair": 1, "rate": 1.0, "unit": "um/h", "u_um": 0.1}
    reports = [
        {"tilt_mrad": 2.0},
        {"tilt_mrad": 2.002},
        {"tilt_mrad": None},
        {"noise_um": 1.0},
        {"noise_um": 1.004},
        {"noise_um": None},
        {"noise_um": 10.0},
        {"noise_um": 10.04},
        {"repeatability_um": 1.0},
        {"repeatability_um": 1.01},
        {"repeatability_um": 10.0},
        {"repeatability_um": 12.345},
    ]
    reports += [
        {"drift": [drift | {"total_um": total, "u_um": u}]}
        for total, u in (
            (2.0, 0.1),
            (2.01, 0.1),
            (-2.5, 0.1),
            (2.9, 1.0),
            (3.0, 1.0),
            (3.01, 1.0),
            (-7.0, 2.0),
        )
    ]
    return {
        "surveys": [_good(), _noisy_pass()],
        "reports": reports,
        "scatter": [
            {"misses_um": misses_um, "noise_um": noise_um, "freedom": freedom}
            for misses_um, noise_um in ((0.1, 0.05), (0.5, 0.3), (1.5, 0.6), (0.2, 5.0))
            for freedom in (0.0, 1.3, 1.4, 40.0)
        ],
    }


def noise():
    """Return degrees of freedom, setups without noise, and samples."""
    return {
        "freedom": [0.5, 1.0, 2.0, 3.0, 7.5, 20.0, 1e3, 1e6],
        "coverage": [
            {},
            {
                "EXX": {"degrees_of_freedom": 4.2, "k": 2.9},
                "EYX": {"degrees_of_freedom": 3.4, "k": 3.3},
            },
        ],
        "classes": [[], ["ppp"], ["ppp", "linear-x"]],
        "samples": np.round(RNG.normal(0, 2, (3, 41)) ** 3, 4).tolist(),
        "shares": [0.95, 0.5, 0.1],
        "points": [1, 4, 15],
    }


def _curves(count, waves, noise):
    at = np.linspace(0.0, 1.0, count)
    return [
        np.round(
            size * np.sin(2 * np.pi * wave * at + 0.4)
            + RNG.normal(0, noise, count)
            + 3.0 * at,
            4,
        ).tolist()
        for wave in waves
        for size in (1.0, 6.0)
    ]


def curves():
    """Return functions of few values and of many, smooth and waved, with their noise, and finer
    ones among them."""
    every = [
        one
        for count, waves in (
            (3, (0.5,)),
            (4, (0.5, 1)),
            (5, (1, 2)),
            (6, (1, 2)),
            (7, (1, 2, 3)),
            (8, (1, 3)),
            (9, (1, 2, 3, 3.8)),
            (11, (1, 2, 3, 3.6, 4, 4.6)),
            (16, (2, 6)),
        )
        for one in _curves(count, waves, 0.1)
    ]
    machines = []
    for count, waves in ((3, 1), (4, 1), (6, 2), (7, 2), (9, 2), (9, 3.6), (11, 4.4)):
        at = np.linspace(0.0, 300.0, count)
        machines.append(
            {
                name: {
                    "position_mm": np.round(at, 4).tolist(),
                    "value": _curves(
                        count, (waves * (1 if name[1] == name[2] else 0.4),), 0.1
                    )[1],
                    "u_readings": 0.1,
                }
                for name in ("EXX", "EYX", "EZX", "EXY", "EYY", "EZY", "EXZ", "EYZ", "EZZ")
            }
        )
    fine = np.linspace(0.0, 300.0, 17)
    for machine in (machines[1], machines[4]):
        waved = {name: dict(one) for name, one in machine.items()}
        value = np.interp(
            fine, machine["EYY"]["position_mm"], machine["EYY"]["value"]
        ) + 2.0 * np.sin(fine / 11.0)
        waved["EYY"] = {
            "position_mm": fine.tolist(),
            "value": np.round(value, 4).tolist(),
            "u_readings": 0.05,
        }
        machines.append(waved)
        machines.append(
            waved
            | {
                "EZZ": waved["EYY"]
                | {
                    "value": np.round(0.3 * value + 1.0 * np.cos(fine / 7.0), 4).tolist(),
                    "u_readings": None,
                },
                "EXY": machine["EXY"] | {"value": None},
            }
        )
        machines.append(
            waved
            | {
                "EYY": {
                    "position_mm": [0.0, 37.5, 100.0, 110.0, 190.0, 200.0, 300.0],
                    "value": [0.0, 4.0, 1.0, 3.0, -2.0, 0.5, 0.0],
                    "u_readings": 0.2,
                }
            }
        )
    return {
        "curves": every,
        "noise_um": [0.0, 0.05, 1.0],
        "machines": machines,
        "assumed": [{}, {"shape_um": 20.0, "between_um": 1.0}, {"between_um": 0.0}],
    }


def warmth():
    """Return what is known of the temperature of the machine and its scales."""
    scales = [
        {"value": 12.0, "u": 1.5, "u_readings": 0.4},
        {"value": None, "u": None, "u_readings": None},
        {"value": -3.0, "u": 0.2, "u_readings": None},
    ]
    return {
        "temperature_c": [[], [20.0, 21.0], [20.0, None, 21.0], [None, None], [None]],
        "assumed": [
            {},
            {"reduced_to_20_c": True},
            {"reduced_to_20_c": True, "material_stated": True, "u_material_c": 0.75},
            {
                "expansion_um_m_c": [11.7, 9.0, 11.7],
                "material_c": [22.0, 23.5, 18.0],
                "u_expansion_um_m_c": 2.0,
                "index": 3e-7,
            },
            {
                "reduced_to_20_c": True,
                "material_c": [25.0, 26.0, 15.0],
                "angle_urad": {"EAX": 33.0},
                "index_setup": 2.5e-7,
            },
        ],
        "scales": [
            dict(zip("XYZ", some, strict=True))
            for some in (scales, scales[::-1], [scales[0]] * 3)
        ],
        "found": [
            {},
            {
                "EAX": [[1.0, -4.0], [0.5, 1.0]],
                "ECZ": [[2.0, 2.0], None],
                "EBY": [None, None],
            },
            {
                name: [[1.0, 3.0], [0.1, 0.2]]
                for name in ("EAX", "EBX", "ECX", "EAY", "EBY", "ECY", "EAZ", "EBZ", "ECZ")
            },
        ],
    }


def words():
    """Return numbers, texts and remarks as they are rounded, shortened and written."""
    run = [
        [1, 0, [0.0, 5.0, 5.0], 0.0],
        [1, 1, [10.0, 5.0, 5.0], 10.002],
        [2, 0, [10.0, 5.0, 5.0], 0.0],
        [2, 1, [0.0, 5.0, 5.0], -10.001],
    ]
    low = [[1, 0, [-1.01, 5.0, 5.0], 0.0]]
    edge = [[1, 0, [-1.0, 5.0, 5.0], 0.0], [1, 1, [11.0, 5.0, 5.0], 12.0]]
    out = ["linear-x,1,0,0,5,5,0,", "linear-x,1,1,4,5,5,4.001,", "linear-x,1,2,10,5,5,9.998,"]
    back = [
        "linear-x,2,0,10,5,5,0,",
        "linear-x,2,1,4,5,5,-5.9995,",
        "linear-x,2,2,0,5,5,-10.25,",
    ]
    return {
        "box": [
            "ppp,1,0,0,0,0,0,0.3",
            "ppp,1,1,10,0,0,5,0.3",
            "ppp,1,2,10,10,0,9,",
            "ppp,1,3,10,10,10,15,0.1",
        ],
        "added": [
            [["linear-x", run]],
            [["linear-x", run], ["linear-x", run]],
            [["ppp", run]],
            [["linear-x", low]],
            [["linear-x", edge]],
            [["linear-y", [[1, 0, [0.0, 5.0, 11.01], 0.0]]]],
            [],
        ],
        "written": [
            out,
            out + back,
            back,
            [],
            [*out, *back[:2]],
            [*out, back[0], back[1].replace(",4,", ",4.002,"), back[2]],
            [*out, back[0], back[1].replace(",4,", ",4.0009,"), back[2]],
        ],
        "steady": [
            [0.0000005, 6],
            [1.00000049999999, 6],
            [-0.0000001, 6],
            [2.5, 0],
            [0.00005, 4],
            [1.23456789, 4],
            [-1.5, 0],
            [1e9 + 0.4, 0],
        ],
        "same": [
            [{"a": [1.0, 2]}, {"a": [1.00009, 2]}, 6],
            [{"a": [1.0]}, {"a": [1.00011]}, 6],
            [1.0, 1.014, 2],
            [1.0, 1.016, 2],
            [{"a": 1, "b": 2}, {"b": 2, "a": 1}, 6],
            [[1.0], [1.0, 2.0], 6],
            [1, 1.0, 6],
            [1, 2, 6],
            ["a", "a", 6],
            [None, 0, 6],
            [[1.0], {"a": 1.0}, 6],
        ],
        "results": [
            ['{"a": 1.0}', '{"a": 1.00001}'],
            ['{"a": 1.0}', '{"a": 1.1}'],
            ['{"posterior": {"x": 1.0}}', '{"posterior": {"x": 1.00012}}'],
            ['{"posterior": {"x": 1.0}}', '{"posterior": {"x": 1.0002}}'],
            ['{"posterior": 1}', "{}"],
            ["[]", "{}"],
            ["{", "{"],
            ["[1]", "[1]"],
        ],
        "long": [["x" * 2000], ["y" * 2001], ["z" * 30, 10], ["short", 5]],
        "findings": [
            {"code": "a", "severity": "info", "text": "t"},
            {
                "code": "a",
                "severity": "error",
                "text": "t",
                "setup": "ppp",
                "pass_number": 0,
                "stop": 0,
                "size_um": 0.0,
                "among": ["ppp/1"],
            },
        ],
        "runs": [["ppp", "npp", "ppp", "ppp+1"], ["linear-x"], ["ppp+3", "ppp"]],
        "tables": [["a\n1\n2\n3\n", 3], ["a\n1\n2\n3\n", 2], ["a\n1\n", 1], ["a\n", 5]],
        "head": [
            {},
            {"EYX": {"misclosure": 0.9}, "EZX": {"misclosure": None}},
            {"EYX": {"misclosure": 1.0}},
            {"EYX": {"misclosure": 1.01}},
            {
                "EYX": {"misclosure": 1.5},
                "EZX": {"misclosure": 3.25, "difference_um": {"value": [1.0, -4.56]}},
                "EYZ": {"misclosure": 0.2},
            },
        ],
    }


RULES = {
    "limits": ("what is said of a survey at each limit", "limits", limits),
    "noise": ("noise, coverage and drawn intervals", "noise", noise),
    "curves": ("what functions do between their targets", "curves", curves),
    "warmth": ("temperatures, lengths and the tool", "warmth", warmth),
    "words": ("what is rounded, shortened and written", "words", words),
}
