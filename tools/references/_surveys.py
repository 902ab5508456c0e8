"""Surveys of the virtual machine, each with something of its own: instruments, directions,
temperatures, faults."""

from dataclasses import asdict, replace

import numpy as np

from stepdiag.base.readings.readings import (
    Readings,
    make_readings,
    parse_readings,
    render_readings,
)
from stepdiag.base.readings.runs import Plan, Run, perfect_readings
from stepdiag.base.setups import setup_of
from stepdiag.base.volume import Volume
from stepdiag.solver.model.angles import render_angles
from testkit.exact.straightness import STRAIGHT, straightness
from testkit.exact.surveys import DATA, DIAGONALS, LINEAR, Bench

SMALL = Bench(seed=3, size_mm=(300.0, 200.0, 100.0), increments=4, angle_urad=6.0)
THREE = replace(SMALL, increments=3, origin_mm=(-100.0, 50.0, 20.0), seed=11)
TABLE = replace(THREE, chain="XYFZ", seed=21)
"""Its carriages of X and Y move under the tool, so that their angles have arms along their own
travel."""
PLAY = {
    "EXX": lambda at: 3.0 + 0.004 * at,
    "EYX": lambda at: 1.0 - 0.003 * at,
    "EZZ": lambda at: -2.0 + 0.0 * at,
}
RUNS = tuple(Readings.__dataclass_fields__)


def survey(readings: Readings, **further):
    """Return the JSON of a survey: the lines of its table, to a nanometre, and what else the solver
    is told.

    A beam line that runs through the first stop is left out, as it usually is.
    """
    shifted = any("+" in name for name in readings.setup)
    beam_mm = readings.beam_mm if shifted else np.full(readings.beam_mm.shape, np.nan)
    short = replace(
        readings,
        reading_mm=np.round(readings.reading_mm, 6),
        time_s=np.round(readings.time_s),
        beam_mm=beam_mm,
    )
    return {"readings": render_readings(short).splitlines(), **further}


def angles(bench: Bench, *names: str, u_urad: float = 1.0, stated: bool = True):
    """Return the lines of an angles file with these functions, all where none is named."""
    known = bench.angles(u_urad, stated=stated)
    return render_angles({name: known[name] for name in names or known}).splitlines()


def of(readings: Readings, setup: str, *numbers: int):
    """Return which rows belong to a setup, and to some of its passes where these are given."""
    mine = np.array([name == setup for name in readings.setup])
    return mine & np.isin(readings.pass_number, numbers) if numbers else mine


def moved(readings: Readings, setup: str, numbers, by_um) -> Readings:
    """Return readings of which those of some passes are changed by ``by_um``, a function of the
    stop."""
    added = np.where(
        of(readings, setup, *np.atleast_1d(numbers)),
        1e-3 * by_um(readings.stop.astype(float)),
        0.0,
    )
    return replace(readings, reading_mm=readings.reading_mm + added)


def scaled(readings: Readings, setup: str, um_m: float) -> Readings:
    """Return readings of which those of a setup are longer."""
    return replace(
        readings,
        reading_mm=readings.reading_mm
        * np.where(of(readings, setup), 1.0 + 1e-6 * um_m, 1.0),
    )


def without(readings: Readings, *places) -> Readings:
    """Return readings without some stops (setup, pass, stop)."""
    kept = [
        row
        for row in range(len(readings))
        if (readings.setup[row], readings.pass_number[row], readings.stop[row]) not in places
    ]
    return readings.select(kept)


def warm(readings: Readings, temperature_c, **changes) -> Readings:
    """Return readings with temperatures, a function of the row's share of the survey."""
    return replace(
        readings, temperature_c=temperature_c(np.linspace(0.0, 1.0, len(readings))), **changes
    )


def walked(
    readings: Readings, setup: str, numbers, size_um: float, seed: int = 5
) -> Readings:
    """Return readings of which a pass wanders."""
    walk = np.cumsum(np.random.default_rng(seed).normal(0.0, size_um, 60))
    return moved(readings, setup, numbers, lambda stop: walk[stop.astype(int)] - walk[0])


def joined(*parts: Readings) -> Readings:
    """Return readings one after the other."""
    names = [name for name in RUNS if name != "setup"]
    columns = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in names
    }
    return make_readings(setup=[name for part in parts for name in part.setup], **columns)


def planned(bench: Bench, runs, axis_order="xyz", noise_um=0.2, seed=17) -> Readings:
    """Return what a machine with a bench's errors shows on any setups: perfect readings with the
    errors along the setup."""
    volume = Volume(
        origin_mm=bench.origin_mm, size_mm=bench.size_mm, increments=bench.increments
    )
    readings = perfect_readings(
        Plan(volume=volume, runs=tuple(runs), axis_order=axis_order), noise_um
    )
    error = np.sum(
        bench.machine.error_at(readings.position_mm) * _directions(readings, bench), axis=1
    )
    error = error + np.random.default_rng(seed).normal(0.0, noise_um, len(readings))
    first = np.array(
        [row for row in range(len(readings)) for _ in [0] if readings.stop[row] == 0]
    )
    start = {(readings.setup[row], readings.pass_number[row]): error[row] for row in first}
    since = error - [
        start[readings.setup[row], readings.pass_number[row]] for row in range(len(readings))
    ]
    return replace(readings, reading_mm=readings.reading_mm + 1e-3 * since)


def runs(*names: str, **how):
    """Return runs of some setups."""
    return tuple(Run(setup=name, **how) for name in names)


def golden(name: str):
    """Return the readings of a golden file to a tenth of a micrometre: chi-square of none at all
    would be rounding."""
    readings = parse_readings(
        (DATA / f"golden_stepdiag_{name}.csv").read_text(encoding="utf-8")
    )
    return render_readings(
        replace(readings, reading_mm=np.round(readings.reading_mm, 4))
    ).splitlines()


def head(
    bench: Bench, names=("EYX", "EZX", "EXY", "EYZ"), by_um=None, approaches=(1, -1), u_um=0.5
):
    """Return what a head says of some functions as JSON, one of them off by ``by_um`` of the share
    of its travel."""
    found = []
    for one in straightness(bench, 4, u_um, approaches):
        if one.name in names:
            share = np.linspace(0.0, 1.0, len(one.position_mm))
            off = by_um(share) if by_um and one.name == "EYX" else 0.0
            found.append(
                {
                    name: np.round(value, 6).tolist()
                    if isinstance(value, np.ndarray)
                    else value
                    for name, value in asdict(one).items()
                }
                | {"value_um": np.round(one.value_um + off, 6).tolist()}
            )
    return found


def _back(bench=SMALL, **how):
    return bench.survey(passes=(1, 2), **how)


def _cut(readings: Readings, setup: str, number: int, at: int) -> Readings:
    """Return readings in which the count was lost within a pass: two stretches, the second of which
    begins at zero."""
    zero, mine = np.array(readings.zero), of(readings, setup, number)
    late = mine & (readings.stop >= at)
    zero[mine], zero[late] = 1, 2
    first = readings.reading_mm[late & (readings.stop == at)][0]
    return replace(
        readings, zero=zero, reading_mm=readings.reading_mm - np.where(late, first, 0.0)
    )


def _untimed(readings: Readings) -> Readings:
    return replace(readings, time_s=np.full(len(readings), np.nan))


def _finer(increments=8, wave_um=2.0):
    """Return diagonals of four increments and runs of more, on a machine whose axes have waves."""
    bench = replace(SMALL, waves=5, wave_um=wave_um)
    return joined(
        bench.survey(DIAGONALS),
        replace(bench, increments=increments).survey(("linear-x", "linear-y")),
        bench.survey(("linear-z",)),
    )


def _grown(bench: Bench, um_m: float, bent: float = 0.0, **how):
    """Return a survey of a machine that grows while it is measured: by ``um_m`` in all, ``bent`` as
    much by the square of the time."""
    taken = _back(replace(bench, angle_urad=0.0), **how)
    late = taken.time_s / np.max(taken.time_s) - 0.5
    along = np.sum((taken.position_mm - bench.origin_mm) * _directions(taken, bench), axis=1)
    grown = 1e-6 * along * (um_m * late + bent * late**2)
    first = np.flatnonzero(taken.stop == 0)
    since = (
        grown - grown[first[np.searchsorted(first, np.arange(len(taken)), side="right") - 1]]
    )
    return survey(
        replace(taken, reading_mm=taken.reading_mm + since),
        angles=angles(replace(bench, angle_urad=0.0)),
    )


def _directions(readings: Readings, bench: Bench):
    signs = np.array([setup_of(name).signs for name in readings.setup]) * np.array(
        bench.size_mm
    )
    return signs / np.linalg.norm(signs, axis=1, keepdims=True)


def _outliers(readings: Readings, *places):
    """Return readings of which stops (setup, pass, stop, um) are wrong."""
    for setup, number, at, um in places:
        readings = moved(
            readings, setup, number, lambda stop, at=at, um=um: um * (stop == at)
        )
    return readings


def _play():
    bench = replace(SMALL, reversal=PLAY, angle_urad=0.0)
    taken = bench.survey(passes=(1, 2), linear_passes=range(1, 11), joined=True)
    assumed = {
        "index": 3e-6,
        "alignment_mrad": 3.0,
        "drift_um": 0.4,
        "wander_um": 0.3,
        "u_material_c": 0.5,
        "expansion_um_m_c": [11.7, 10.0, 9.0],
    }
    return survey(
        warm(taken, lambda share: 21.5 + 0.3 * share, at_20_c=np.ones(len(taken), bool)),
        angles=angles(QUIET),
        assumed=assumed,
    )


def _faces():
    names = [f"face-{plane}-{way}" for plane in ("xy", "xz", "yz") for way in ("pp", "np")]
    return survey(planned(THREE, runs(*names, *LINEAR, return_pass=False)))


def _bodies():
    continuous = runs("body-ppp", "body-npp", "body-pnp", "body-ppn", repeats=2)
    return survey(
        planned(THREE, (*continuous, *runs(*DIAGONALS, return_pass=False))),
        angles=angles(THREE),
    )


def _shifted():
    offsets = {
        "ppp+1": (0.0, 50.0, 0.0),
        "npp+1": (0.0, 0.0, 50.0),
        "pnp+1": (50.0, 0.0, 0.0),
        "ppn+1": (0.0, 50.0, 0.0),
        "ppp+2": (0.0, 0.0, 50.0),
        "npp+2": (0.0, 50.0, 0.0),
        "pnp+2": (0.0, 0.0, 50.0),
        "ppn+2": (50.0, 0.0, 0.0),
    }
    return replace(THREE, beam_offset_mm=offsets), (*DIAGONALS, *offsets, *LINEAR)


def _turned(readings: Readings) -> Readings:
    return replace(readings, turned=(readings.stop == 0) & (readings.pass_number == 2))


WARM = {"expansion_um_m_c": [11.7, 10.0, 9.0], "u_expansion_um_m_c": 1.5, "u_material_c": 0.4}
NOTHING = {
    "angles_urad": 0.0,
    "drift_um": 0.0,
    "wander_um": 0.0,
    "setup_c": 0.0,
    "repeatability_um": 0.0,
    "index": 0.0,
    "index_setup": 0.0,
    "alignment_mrad": 0.0,
    "between_um": 0.0,
}
QUIET = replace(SMALL, angle_urad=0.0)

SURVEYS = {
    "golden-separable": (
        "the golden survey without angular errors",
        "solve",
        lambda: {"readings": golden("separable"), "assumed": NOTHING},
    ),
    "closed-unstated": (
        "the corrected closed form where nobody states the noise",
        "solve",
        lambda: survey(
            replace(THREE, states_u=False).survey(DIAGONALS), method="least-squares"
        ),
    ),
    "closed-once": (
        "the same of a single increment, where no noise shows",
        "solve",
        lambda: survey(
            replace(THREE, states_u=False, increments=1).survey(DIAGONALS),
            method="least-squares",
        ),
    ),
    "head-lines": (
        "four functions by a head beside diagonals and runs, out and back",
        "solve",
        lambda: survey(
            _back(THREE), straightness=head(THREE), angles=angles(THREE, "EAX", "ECX", "EBZ")
        ),
    ),
    "head-contradicts": (
        "a head that is wrong in one function",
        "solve",
        lambda: survey(
            _back(),
            straightness=head(
                SMALL, ("EYX", "EZY"), lambda share: 25.0 * np.sin(np.pi * share)
            ),
        ),
    ),
    "wanders": (
        "one pass of a diagonal wanders, another was driven",
        "solve",
        lambda: survey(
            walked(SMALL.survey(passes=(1, 3)), "pnp", 3, 8.0), angles=angles(SMALL)
        ),
    ),
    "wanders-alone": (
        "the only pass of a diagonal wanders",
        "solve",
        lambda: survey(walked(_back(QUIET), "npp", 2, 6.0), angles=angles(QUIET)),
    ),
    "diagonal-scale": (
        "a diagonal is too long, with runs out and back",
        "solve",
        lambda: survey(scaled(_back(), "ppn", -45.0), angles=angles(SMALL)),
    ),
    "scale-little": (
        "scales that differ a little",
        "solve",
        lambda: survey(scaled(QUIET.survey(), "ppp", 9.0), angles=angles(QUIET)),
    ),
    "grows-bent": (
        "the machine grows faster and faster",
        "solve",
        lambda: _grown(replace(SMALL, increments=3), 20.0, 160.0),
    ),
    "grows-short": (
        "the machine grows, and two counts are too short to show a slip",
        "solve",
        lambda: _grown(
            replace(SMALL, increments=2),
            400.0,
            setups=("linear-x", *DIAGONALS, "linear-y"),
            linear_passes=(1,),
        ),
    ),
    "ambiguous": (
        "a stop is wrong that two diagonals could have wrong",
        "solve",
        lambda: survey(
            _outliers(QUIET.survey(DIAGONALS), ("npp", 1, 5, 7.0)), angles=angles(QUIET)
        ),
    ),
    "too-many": (
        "more stops are wrong than a survey may have",
        "solve",
        lambda: survey(
            _outliers(
                replace(THREE, angle_urad=0.0).survey(
                    (*DIAGONALS, *LINEAR), linear_passes=(1,)
                ),
                *(
                    ("ppp", 1, 2, 40.0),
                    ("npp", 1, 4, -90.0),
                    ("pnp", 1, 6, 60.0),
                    ("ppn", 1, 3, -200.0),
                ),
            ),
            angles=angles(replace(THREE, angle_urad=0.0)),
        ),
    ),
    "warm": (
        "the machine became warmer and somebody measured that",
        "solve",
        lambda: survey(
            warm(_back(THREE), lambda share: 21.0 + 1.3 * share),
            assumed=WARM,
            angles=angles(THREE),
        ),
    ),
    "warm-little": (
        "temperatures that hardly differ, of which some are missing",
        "solve",
        lambda: survey(
            warm(
                THREE.survey(),
                lambda share: np.where(share > 0.9, np.nan, 22.0 + 0.01 * share),
            ),
            assumed=WARM,
        ),
    ),
    "at-20-blind": (
        "readings brought to 20 C from a temperature that nobody measured",
        "solve",
        lambda: survey(
            replace(THREE.survey(), at_20_c=np.ones(len(THREE.survey()), bool)),
            angles=angles(THREE),
        ),
    ),
    "missing": (
        "stops are missing within passes",
        "solve",
        lambda: survey(
            without(
                _back(),
                ("ppp", 1, 5),
                ("ppp", 2, 7),
                ("pnp", 1, 1),
                ("linear-x", 1, 2),
                ("ppn", 2, 11),
            ),
            angles=angles(SMALL),
        ),
    ),
    "three-diagonals-alone": (
        "three diagonals alone, nothing known",
        "solve",
        lambda: survey(THREE.survey(DIAGONALS[:3])),
    ),
    "two-diagonals": (
        "two diagonals and one run, out and back",
        "solve",
        lambda: survey(_back(THREE, setups=("npp", "ppn", "linear-z"))),
    ),
    "waves": (
        (
            "four waves over every axis, out and back, so many unknowns that they are eliminated "
            "block by block"
        ),
        "solve",
        lambda: survey(
            _back(replace(QUIET, increments=7, waves=4, wave_um=3.0)),
            angles=angles(replace(QUIET, increments=7)),
        ),
    ),
    "one-increment": (
        "a single increment",
        "solve",
        lambda: survey(
            _back(replace(THREE, increments=1)), angles=angles(replace(THREE, increments=1))
        ),
    ),
    "two-increments": (
        "two increments, order zyx, another chain",
        "solve",
        lambda: survey(
            replace(THREE, increments=2, chain="XFYZ").survey(axis_order="zyx"), chain="XFYZ"
        ),
    ),
    "iso-chain": (
        "the chain as ISO writes it, order yxz",
        "solve",
        lambda: survey(
            replace(THREE, chain="XYFZ").survey(axis_order="yxz"),
            chain="[w Y' X' b Z t]",
            angles=angles(THREE, "EAX", "ECY"),
        ),
    ),
    "play": ("backlash on one count, five runs each way, at 20 C", "solve", _play),
    "play-turned": (
        "backlash on one count, the turn counted at the end of the pass before",
        "solve",
        lambda: survey(
            _turned(replace(THREE, reversal=PLAY).survey(passes=(1, 2, 3), joined=True)),
            angles=angles(THREE),
        ),
    ),
    "unstated": (
        "nobody states the noise",
        "solve",
        lambda: survey(
            replace(SMALL, states_u=False).survey(passes=(1, 2, 3, 4)), angles=angles(SMALL)
        ),
    ),
    "unstated-half": (
        "the noise of the runs is not stated, angles without u",
        "solve",
        lambda: survey(
            joined(
                SMALL.survey(DIAGONALS),
                replace(SMALL, states_u=False).survey(LINEAR, passes=(1, 2)),
            ),
            angles=angles(SMALL, stated=False),
        ),
    ),
    "noisy": (
        "readings that are far noisier than they say",
        "solve",
        lambda: survey(
            replace(
                (
                    noisy := replace(
                        THREE, diagonal_noise_um=6.0, linear_noise_um=2.0
                    ).survey(passes=(1, 2, 3))
                ),
                u_um=np.full(len(noisy), 0.2),
            ),
            angles=angles(THREE),
        ),
    ),
    "outliers": (
        "many stops are wrong",
        "solve",
        lambda: survey(
            moved(
                moved(
                    moved(_back(QUIET), "ppp", 1, lambda stop: 25.0 * (stop % 3 == 1)),
                    "npp",
                    2,
                    lambda stop: -19.0 * (stop % 4 == 2),
                ),
                "pnp",
                1,
                lambda stop: 14.0 * (stop % 5 == 3),
            ),
            angles=angles(QUIET),
        ),
    ),
    "slip-run": (
        "the count of a run slips",
        "solve",
        lambda: survey(
            moved(
                SMALL.survey(linear_passes=(1, 2, 3)),
                "linear-x",
                2,
                lambda stop: 5.0 * (stop <= 2),
            ),
            angles=angles(SMALL),
        ),
    ),
    "slips": (
        "two counts slip, half a degree warmer at the end",
        "solve",
        lambda: survey(
            moved(
                moved(
                    warm(SMALL.survey(passes=(1, 3)), lambda share: 20.5 + 0.5 * share),
                    "ppp",
                    3,
                    lambda stop: 6.0 * (stop >= 4),
                ),
                "ppn",
                1,
                lambda stop: -7.0 * (stop >= 9),
            ),
            angles=angles(SMALL),
        ),
    ),
    "cut": (
        "the count was lost within two passes, without times",
        "solve",
        lambda: survey(
            _untimed(_cut(_cut(_back(), "npp", 1, 6), "linear-y", 1, 3)), angles=angles(SMALL)
        ),
    ),
    "leans": (
        "mirrors that lean by 4 mrad, drawn surveys",
        "solve",
        lambda: survey(
            replace(THREE, tilt_mrad=4.0).survey(), angles=angles(THREE), monte_carlo=300
        ),
    ),
    "assumed": (
        "other assumptions than usual",
        "solve",
        lambda: survey(
            replace(THREE, states_u=False).survey((*DIAGONALS, "linear-z")),
            assumed={
                "angles_urad": 14.0,
                "angle_urad": {"EAX": 5.0, "ECZ": 40.0},
                "drift_um": 0.4,
                "wander_um": 0.3,
                "repeatability_um": 0.3,
                "setup_c": 0.4,
                "index": 5e-7,
                "index_setup": 3e-7,
                "alignment_mrad": 2.0,
                "between_um": 0.8,
                "reading_um": 0.6,
                "shape_um": 9.0,
                "squareness_urad": 50.0,
                "scale_um_m": 35.0,
            },
        ),
    ),
    "finer": (
        "runs that are finer than the diagonals",
        "solve",
        lambda: survey(_finer(), angles=angles(SMALL)),
    ),
    "shifted": (
        "beams shifted to resolve the angles",
        "solve",
        lambda: survey((pair := _shifted())[0].survey(pair[1])),
    ),
    "faces": ("face diagonals and runs", "solve", _faces),
    "bodies": ("continuous and step diagonals beside each other, repeated", "solve", _bodies),
    "head-on-table": (
        "a head on a table that moves: what its angles do to it is along its own travel",
        "solve",
        lambda: survey(
            _back(TABLE),
            straightness=head(TABLE, STRAIGHT),
            angles=angles(TABLE, "EAX", "ECX", "EBZ", u_urad=3.0),
            chain="XYFZ",
        ),
    ),
    "head-off-nodes": (
        "a head at more stops than the diagonals have, one way, nothing known of the angles",
        "solve",
        lambda: survey(
            replace(TABLE, increments=4, states_u=False).survey(),
            straightness=head(
                replace(TABLE, increments=6), STRAIGHT, approaches=(1,), u_um=0.8
            ),
            chain="XYFZ",
        ),
    ),
    "finer-on-table": (
        "runs finer than the diagonals, each otherwise, in a hall that becomes warmer",
        "solve",
        lambda: survey(
            warm(
                joined(
                    _back(TABLE, setups=(*DIAGONALS, "linear-z")),
                    replace(TABLE, increments=7).survey(("linear-x",)),
                    replace(TABLE, increments=5).survey(("linear-y",), linear_passes=(1, 2)),
                ),
                lambda share: 19.0 + 0.9 * share,
            ),
            chain="XYFZ",
            assumed=WARM,
        ),
    ),
    "play-on-bed": (
        "backlash on one count on a machine whose tool stands still, the noise not stated",
        "solve",
        lambda: survey(
            replace(THREE, chain="XYZF", reversal=PLAY, states_u=False, seed=5).survey(
                passes=(1, 2, 3, 4), joined=True
            ),
            chain="XYZF",
        ),
    ),
    "slips-on-table": (
        "a slip, a wrong stop and missing ones beside each other, angles unknown",
        "solve",
        lambda: survey(
            _outliers(
                moved(
                    without(_back(TABLE, axis_order="zxy"), ("ppp", 2, 4), ("pnp", 1, 2)),
                    "npp",
                    2,
                    lambda stop: -11.0 * (stop <= 5),
                ),
                ("ppn", 1, 4, 26.0),
            ),
            chain="XYFZ",
        ),
    ),
    "shifted-on-table": (
        "shifted beams on another chain, two angles known",
        "solve",
        lambda: survey(
            replace((pair := _shifted())[0], chain="XYFZ", increments=2).survey(pair[1]),
            chain="XYFZ",
            angles=angles(TABLE, "EBX", "ECZ"),
        ),
    ),
    "wanders-unstated": (
        "a pass that wanders beside two that do not, one wrong stop, the noise not stated",
        "solve",
        lambda: survey(
            _outliers(
                walked(
                    replace(TABLE, states_u=False).survey(passes=(1, 2, 3)), "ppn", 2, 5.0
                ),
                ("ppp", 1, 3, 30.0),
            ),
            chain="XYFZ",
            angles=angles(TABLE),
        ),
    ),
    "drawn-without-a-stop": (
        "drawn surveys where a wrong stop was left out",
        "solve",
        lambda: survey(
            _outliers(TABLE.survey(), ("npp", 1, 4, 60.0)),
            angles=angles(TABLE),
            chain="XYFZ",
            monte_carlo=200,
        ),
    ),
    "coarse": (
        "readings to four micrometres, of which one is wrong and a pass wanders",
        "solve",
        lambda: survey(
            _outliers(
                walked(
                    replace(TABLE, diagonal_noise_um=4.0, linear_noise_um=3.0).survey(
                        passes=(1, 2, 3)
                    ),
                    "pnp",
                    3,
                    25.0,
                ),
                ("npp", 1, 4, 140.0),
            ),
            chain="XYFZ",
        ),
    ),
    "coarse-with-head": (
        "readings to four micrometres beside a head",
        "solve",
        lambda: survey(
            moved(
                _back(replace(TABLE, diagonal_noise_um=4.0, linear_noise_um=3.0)),
                "ppp",
                2,
                lambda stop: 60.0 * (stop <= 4),
            ),
            straightness=head(TABLE, STRAIGHT, u_um=2.0),
            angles=angles(TABLE, u_urad=8.0),
            chain="XYFZ",
        ),
    ),
    "short-waves": (
        "angles that bend often along an axis of many targets, nobody measured them",
        "solve",
        lambda: survey(
            _back(replace(TABLE, increments=6, angle_urad=25.0, waves=5, wave_um=2.0)),
            chain="XYFZ",
        ),
    ),
    "cut-on-table": (
        "the count was lost within two passes, out and back on one count",
        "solve",
        lambda: survey(
            _cut(
                _cut(replace(TABLE, states_u=False).survey(passes=(1, 2)), "npp", 2, 4),
                "linear-z",
                1,
                2,
            ),
            chain="XYFZ",
        ),
    ),
    "outside": (
        "a run that leaves the volume",
        "solve",
        lambda: survey(
            joined(
                THREE.survey((*DIAGONALS, "linear-x", "linear-y")),
                replace(THREE, size_mm=(300.0, 200.0, 130.0)).survey(("linear-z",)),
            ),
            angles=angles(THREE),
        ),
    ),
}

WHOLE = (
    "head-lines",
    "play",
    "warm",
    "two-diagonals",
    "unstated",
    "noisy",
    "assumed",
    "finer",
    "shifted",
    "bodies",
    "outside",
)
"""Those of which the whole budget and the standards' figures are recorded."""


def _brief(made):
    return lambda: made() | {"brief": True}


SURVEYS = {
    name: (about, call, made if name in WHOLE or name.startswith("golden") else _brief(made))
    for name, (about, call, made) in SURVEYS.items()
}
