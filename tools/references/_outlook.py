"""Surveys of which more is told than the result, and surveys that were not driven yet."""

from dataclasses import replace

import numpy as np
from _surveys import SMALL, THREE, angles, survey, without

from testkit.exact.surveys import DIAGONALS, LINEAR

SIZE = {"size_mm": [300.0, 200.0, 100.0], "increments": 3}


def _runs(*names: str, **how):
    return [{"setup": name, **how} for name in names]


def plans():
    """Return plans of every kind of run, and what is asked of them."""
    bare, lines = _runs(*DIAGONALS, return_pass=False), _runs(*LINEAR, return_pass=False)
    shifted = [
        run | {"setup": run["setup"] + "+1", "beam_offset_mm": [0.0, 40.0, 0.0]}
        for run in bare
    ]
    return {
        "plans": [
            SIZE | {"runs": bare, "asked": {}},
            SIZE
            | {
                "runs": _runs(*DIAGONALS, *LINEAR, repeats=2),
                "increments": 1,
                "chain": "XFYZ",
            },
            SIZE | {"runs": [*bare, *lines], "increments": 1},
            SIZE
            | {
                "runs": [*_runs("ppp", "npp", repeats=3, return_pass=False), *lines],
                "increments": 12,
                "axis_order": "zxy",
            },
            SIZE | {"runs": [*bare, *shifted, *lines], "chain": "XYFZ"},
            SIZE
            | {
                "runs": [*bare, *_runs("fourdof-x", "fourdof-z", *LINEAR)],
                "about": {"head_u_urad": 0.8},
                "increments": 5,
            },
            SIZE
            | {
                "runs": _runs("body-ppp", "body-npp", "linear-y"),
                "increments": 6,
                "axis_order": "yxz",
            },
            SIZE
            | {
                "runs": _runs("face-xy-pp", "face-xz-np", "face-yz-pp", "linear-z"),
                "axis_order": "yzx",
            },
            SIZE
            | {
                "runs": _runs("linear-x", "linear-y", "linear-z"),
                "increments": 4,
                "assumed": {"angle_urad": {"EAX": 30.0}, "angles_urad": 4.0},
            },
            SIZE
            | {
                "runs": [*bare, *lines],
                "asked": {"available_min": 10.0},
                "increments": 8,
                "assumed": {"shape_um": 9.0, "between_um": 1.0, "reading_um": 0.5},
            },
            SIZE | {"runs": bare, "increments": 1, "asked": {"available_min": 170.0}},
            *(
                SIZE | {"runs": [*bare, *lines], "increments": count}
                for count in (2, 4, 5, 6, 7)
            ),
            SIZE | {"runs": _runs("fourdof-x")},
            SIZE | {"runs": _runs("ppx")},
            SIZE | {"runs": []},
        ]
    }


def _two(increments):
    """Return a survey of increments so few that their bends say little."""
    bench = replace(
        SMALL,
        increments=increments,
        seed=23,
        angle_urad=0.0,
        errors_times=0.1 if increments == 2 else 1.0,
    )
    return survey(bench.survey(), angles=angles(bench), outlook=increments == 2, brief=True)


OUTLOOK = {
    "plans": ("surveys that were not driven yet", "forecasts", plans),
    "volume": (
        "what is told of the volume where all is known",
        "solve",
        lambda: survey(SMALL.survey(passes=(1, 2)), angles=angles(SMALL), outlook=True),
    ),
    "volume-wide": (
        "what is told of the volume where little is known",
        "solve",
        lambda: survey(
            without(THREE.survey(DIAGONALS), ("ppn", 1, 4)), outlook=True, brief=True
        ),
    ),
    "volume-two": ("the volume of two increments", "solve", lambda: _two(2)),
    "volume-six": ("the volume of six increments", "solve", lambda: _two(6)),
    "volume-warm": (
        "the volume of a warm machine",
        "solve",
        lambda: survey(
            replace(
                (taken := THREE.survey((*DIAGONALS, "linear-x"))),
                temperature_c=np.full(len(taken), 23.5),
            ),
            angles=angles(THREE, "EAX"),
            outlook="words",
        ),
    ),
}
