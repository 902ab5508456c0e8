"""What a survey can tell: the rank tables of theory 5.1 and 5.2, and the advice for what it
cannot."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.names import BODY_DIAGONALS, LINEAR_RUNS
from stepdiag.base.readings.runs import Plan, Run, perfect_readings
from stepdiag.base.result.result import DISPLACEMENTS, ROTATIONS, SQUARENESS
from stepdiag.base.setups import CONTINUOUS_DIAGONALS, FACE_DIAGONALS
from stepdiag.base.volume import Volume
from stepdiag.solver.linear.least_squares import invert
from stepdiag.solver.methods.estimate import estimate
from stepdiag.solver.model.design import Model, build_design
from stepdiag.solver.model.layout import lay_out
from stepdiag.solver.model.reported import SCALE_SUM
from stepdiag.solver.planning.identifiability import _Candidate, identified_with_angles

SIZES = [(1000.0, 1000.0, 1000.0), (500.0, 400.0, 250.0), (1000.0, 400.0, 150.0)]


def plan(setups, size=SIZES[1], increments=6, order="xyz", offsets=None):
    volume = Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=size, increments=increments)
    runs = tuple(
        Run(
            setup=name,
            return_pass=False,
            beam_offset_mm=(offsets or {}).get(name, (0.0, 0.0, 0.0)),
        )
        for name in setups
    )
    return Plan(volume=volume, runs=runs, axis_order=order)


def rank_and_hidden(layout, chain="FXYZ", *, angles=False):
    """Return the rank without the pass offsets, which the theory's increments do not have, and the
    dimension of the null space."""
    design = build_design(layout, chain, Model(angles=angles))
    inverse = invert(design.rows, np.ones(len(layout)), design.blocks)
    return inverse.rank - len(layout.passes), inverse.null.shape[1]


SEPARABLE = {
    "4 step diagonals": (BODY_DIAGONALS, 3, 5),
    "+ 1 linear run": ((*BODY_DIAGONALS, "linear-y"), 4, 4),
    "+ 2 linear runs": ((*BODY_DIAGONALS, "linear-x", "linear-z"), 5, 3),
    "+ 3 linear runs": ((*BODY_DIAGONALS, *LINEAR_RUNS), 5, 3),
    "3 step diagonals + 3 linear runs": ((*BODY_DIAGONALS[:3], *LINEAR_RUNS), 3, 3),
    "6 face step diagonals": (FACE_DIAGONALS, 3, 3),
    "4 body + 4 face step diagonals": ((*BODY_DIAGONALS, *FACE_DIAGONALS[:4]), 9, 3),
}
"""Setups, rank above 9n, and null space (theory 5.1)."""


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("increments", [1, 2, 3, 6, 20])
@pytest.mark.parametrize("design", SEPARABLE)
def test_ranks_of_the_separable_model(design, increments, size):
    """Theory 5.1: the same for cubes and for long boxes, n = 1 .. 20."""
    setups, above, hidden = SEPARABLE[design]
    layout = lay_out(perfect_readings(plan(setups, size, increments), 0.3))
    assert rank_and_hidden(layout) == (9 * increments + above, hidden)


def test_continuous_diagonals_tell_little():
    """Theory 5.1: ISO 230-6 diagonals, n = 6: rank 21 of 54, so 33 combinations stay unknown."""
    assert rank_and_hidden(lay_out(perfect_readings(plan(CONTINUOUS_DIAGONALS), 0.3))) == (
        21,
        33,
    )


@given(
    rows=st.integers(1, 6),
    hidden=st.integers(1, 5),
    own=st.integers(0, 4),
    seed=st.integers(0, 2**32 - 1),
)
def test_what_one_more_run_leaves_hidden(rows, hidden, own, seed):
    """Of a null space that stays hidden which the run's own unknowns imitate, also where it has
    fewer readings than unknowns."""
    rng = np.random.default_rng(seed)
    null = np.linalg.qr(rng.normal(size=(9, hidden))).Q
    run = _Candidate(
        minutes=1.0, machine=rng.normal(size=(rows, 9)), nuisance=rng.normal(size=(rows, own))
    )
    left = run.narrow(null)
    told = max(rows - own, 0)
    assert left.shape == (9, max(hidden - told, 0))
    assert null @ (null.T @ left) == pytest.approx(left, abs=1e-9)
    assert left.T @ left == pytest.approx(np.eye(left.shape[1]), abs=1e-9)
    seen = run.machine @ left
    assert seen == pytest.approx(
        run.nuisance @ np.linalg.lstsq(run.nuisance, seen)[0], abs=1e-6
    )


CHAINS = ["FXYZ", "XFYZ", "XYFZ", "XYZF"]


@pytest.mark.parametrize("chain", CHAINS)
def test_ranks_of_the_full_rigid_body_model(chain):
    """Theory 5.2: 108 unknowns of the machine for n = 6; four diagonals, and with three linear
    runs."""
    assert rank_and_hidden(
        lay_out(perfect_readings(plan(BODY_DIAGONALS), 0.3)), chain, angles=True
    ) == (72, 44)
    both = lay_out(perfect_readings(plan((*BODY_DIAGONALS, *LINEAR_RUNS)), 0.3))
    assert rank_and_hidden(both, chain, angles=True) == (85, 31)


@pytest.mark.parametrize(
    ("orders", "rank"),
    [(("xyz", "yzx", "zxy"), 100), (("xyz", "yzx", "zxy", "xzy", "yxz", "zyx"), 124)],
)
@pytest.mark.parametrize("chain", CHAINS)
def test_axis_orders_alone_do_not_resolve_the_angles(chain, orders, rank):
    """Theory 5.2: three orders leave 32 combinations unknown, all six no fewer."""
    parts = [
        perfect_readings(
            plan([f"{name}+{k}" if k else name for name in BODY_DIAGONALS], order=order), 0.3
        )
        for k, order in enumerate(orders)
    ]
    readings = parts[0].select([])
    joined = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("pass_number", "stop", "position_mm", "reading_mm")
    }
    columns = ("u_um", "temperature_c", "time_s", "beam_mm", "zero", "at_20_c", "turned")
    joined |= {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in columns
    }
    readings = type(readings)(
        setup=tuple(name for part in parts for name in part.setup), **joined
    )
    assert rank_and_hidden(lay_out(readings), chain, angles=True) == (rank, 32)


@pytest.mark.parametrize("chain", CHAINS)
def test_a_second_beam_line_leaves_eight_combinations(chain):
    """Theory 5.2: four diagonals at two lateral beam offsets (here in general directions)."""
    rng = np.random.default_rng(0)
    offsets = {f"{name}+1": tuple(rng.normal(scale=50.0, size=3)) for name in BODY_DIAGONALS}
    layout = lay_out(
        perfect_readings(plan((*BODY_DIAGONALS, *offsets), offsets=offsets), 0.3)
    )
    assert rank_and_hidden(layout, chain, angles=True) == (116, 8)


def known(setups):
    return estimate(lay_out(perfect_readings(plan(setups, SIZES[1], 5), 0.3)), "FXYZ")


def known_with_angles(setups, offsets=None):
    return identified_with_angles(
        lay_out(perfect_readings(plan(setups, SIZES[1], 5, offsets=offsets), 0.3)), "FXYZ"
    ).known


def test_four_diagonals_tell_shapes_squareness_and_the_weighted_scale_sum_only():
    found = known(BODY_DIAGONALS).known
    assert all(found[name] for name in (*DISPLACEMENTS, *SQUARENESS, SCALE_SUM))
    assert not any(
        found[name] for name in ("X", "Y", "Z", "sloped EXX", "sloped EYY", "sloped EZZ")
    )


def test_two_linear_runs_tell_all_three_scales():
    found = known((*BODY_DIAGONALS, "linear-x", "linear-z")).known
    assert all(found.values())


def test_one_linear_run_tells_the_scale_of_its_axis():
    found = known((*BODY_DIAGONALS, "linear-y")).known
    assert [found[axis] for axis in "XYZ"] == [False, True, False]


def test_with_free_angles_four_diagonals_tell_the_shape_of_z_only():
    """Theory 5.2: only delta_z(z) is resolved."""
    found = known_with_angles(BODY_DIAGONALS)
    assert [name for name in DISPLACEMENTS if found[name]] == ["EZZ"]


def test_three_beam_lines_resolve_all_eighteen_functions():
    """Theory 5.2: offsets of 50 mm in two directions."""
    offsets = {
        f"{name}+{k}": tuple(np.roll([50.0, 0.0, 0.0], k))
        for name in BODY_DIAGONALS
        for k in (1, 2)
    }
    found = known_with_angles((*BODY_DIAGONALS, *offsets), offsets)
    assert all(found[name] for name in (*DISPLACEMENTS, *ROTATIONS))


@pytest.mark.parametrize(
    ("setups", "code", "words"),
    [
        (BODY_DIAGONALS, "unidentified.scale", "the scale of X, Y, Z,"),
        ((*BODY_DIAGONALS, "linear-x"), "unidentified.scale", "the scale of Y, Z,"),
        (BODY_DIAGONALS[:3], "unidentified.squareness", "squareness C0Y, B0Z, A0Z"),
    ],
)
def test_the_advice_names_runs_that_really_cure_it(setups, code, words):
    from stepdiag.solver.methods.estimate import solve_estimate

    layout = lay_out(perfect_readings(plan(setups, increments=5), 0.3))
    finding = next(
        finding for finding in solve_estimate(layout, "FXYZ").findings if finding.key == code
    )
    assert words in finding.text
    advised = finding.text.split("; add ")[1].split(" (about")[0].split(" and ")
    assert 1 <= len(advised) <= 3
    cured = solve_estimate(
        lay_out(perfect_readings(plan((*setups, *advised), increments=5), 0.3)), "FXYZ"
    )
    assert code not in {finding.key for finding in cured.findings}
