"""Sparse rows, elimination in blocks and the computed null space, against dense decompositions."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stepdiag.base.readings.runs import Plan, Run, perfect_readings
from stepdiag.base.volume import Volume
from stepdiag.solver.linear.elimination import Normal, eliminate, order_blocks
from stepdiag.solver.linear.fit import fit
from stepdiag.solver.linear.least_squares import invert
from stepdiag.solver.linear.packed import pack
from stepdiag.solver.linear.rows import Rows
from stepdiag.solver.model.design import Model, build_design
from stepdiag.solver.model.layout import lay_out
from stepdiag.solver.model.reported import reported, variance
from testkit.exact.surveys import DIAGONALS, Bench


def random_rows(rng, count, width, columns, *, used):
    return Rows(
        rng.integers(0, used, (count, width)), rng.normal(size=(count, width)), columns
    )


def in_blocks(matrix, blocks):
    """Return the parts of a matrix in block order that elimination uses."""
    at = [blocks.block(index) for index in range(blocks.count)]
    own = [matrix[here, here] for here in at]
    lower = [matrix[here, before] for before, here in pairwise(at)]
    return Normal(
        blocks,
        own,
        lower,
        matrix[: blocks.border.start, blocks.border],
        matrix[blocks.border, blocks.border],
    )


@given(st.integers(0, 10_000), st.integers(0, 4), st.integers(4, 30))
@settings(max_examples=40)
def test_null_space_and_solution_agree_with_a_dense_decomposition(seed, unused, used):
    rng = np.random.default_rng(seed)
    columns = used + unused
    rows = random_rows(rng, 2 * used, 4, columns, used=used)
    weight = rng.uniform(0.5, 2.0, len(rows))
    target = rng.normal(size=len(rows))
    found = fit(rows, order_blocks(np.full(columns, -1)), target, weight)
    dense = rows.dense()
    assert found.inverse.rank == np.linalg.matrix_rank(dense)
    assert np.max(np.abs(dense @ found.inverse.null), initial=0.0) < 1e-9
    best = np.linalg.lstsq(
        np.sqrt(weight)[:, None] * dense, np.sqrt(weight) * target, rcond=None
    )[0]
    assert np.allclose(dense @ found.unknowns, dense @ best, atol=1e-9)


def test_a_combination_is_seen_exactly_if_it_is_orthogonal_to_the_null_space():
    """Three unknowns, only x0 + x1 and x2 measured."""
    rows = Rows(np.array([[0, 1], [2, 2]]), np.array([[1.0, 1.0], [1.0, 0.0]]), 3)
    inverse = invert(rows, np.ones(2), order_blocks(np.full(3, -1)))
    asked = Rows(
        np.array([[0, 1], [0, 1], [2, 0]]), np.array([[2.0, 2.0], [1.0, 0.0], [1.0, 0.0]]), 3
    )
    assert inverse.sees(asked).tolist() == [True, False, True]
    spread = inverse.solve(asked.dense().T)
    assert float(asked.dense()[0] @ spread[:, 0]) == pytest.approx(4.0)


@pytest.mark.parametrize("carried", [False, True])
def test_of_a_deficient_system_the_inverse_is_the_dense_one_with_the_same_unknowns_held(
    carried,
):
    """Six columns of rank four, under other weights than those the null space was found with: C is
    zero where an unknown is held."""
    rng = np.random.default_rng(12)
    free = rng.normal(size=(20, 4))
    dense = np.column_stack([free, free[:, 0] - 2 * free[:, 1], 3 * free[:, 2]])
    rows = Rows(np.tile(np.arange(6), (20, 1)), dense, 6)
    blocks, weight = order_blocks(np.full(6, -1)), rng.uniform(0.5, 2.0, 20)
    inverse = invert(
        rows, weight, blocks, invert(rows, np.ones(20), blocks) if carried else None
    )
    assert inverse.rank == 4
    free_columns = np.setdiff1d(np.arange(6), inverse.fixed)
    exact = np.zeros((6, 6))
    exact[np.ix_(free_columns, free_columns)] = np.linalg.inv(
        dense[:, free_columns].T @ (weight[:, None] * dense[:, free_columns])
    )
    assert inverse.solve(np.eye(6)) == pytest.approx(exact, abs=1e-9)
    assert inverse.solve(dense[3]) == pytest.approx(exact @ dense[3], abs=1e-9)
    assert inverse.variance() == pytest.approx(np.diag(exact), abs=1e-9)
    assert np.max(np.abs(dense @ inverse.null)) < 1e-9


def test_elimination_in_blocks_is_the_dense_inverse():
    rng = np.random.default_rng(4)
    group = np.array([2, 0, 1, -1, 0, 3, 1, 2, -1, 3, 0])
    blocks = order_blocks(group)
    count = len(group)
    full = rng.normal(size=(count, count))
    full = full @ full.T + count * np.eye(count)
    coupled = (np.abs(group[:, None] - group) <= 1) | (group[:, None] < 0) | (group < 0)
    matrix = np.where(coupled, full, 0.0) + 5 * count * np.eye(count)
    ordered = np.empty_like(matrix)
    ordered[np.ix_(blocks.place, blocks.place)] = matrix
    found = eliminate(in_blocks(ordered, blocks))
    assert found.solve(np.eye(count)) == pytest.approx(np.linalg.inv(ordered), abs=1e-12)
    assert found.diagonal() == pytest.approx(np.diag(np.linalg.inv(ordered)), abs=1e-12)
    for block, inverse in found.around():
        near = [
            *range(int(blocks.edges[max(block - 1, 0)]), int(blocks.edges[block + 1])),
            *range(*blocks.border.indices(count)),
        ]
        if block < 0:
            near = [*range(*blocks.border.indices(count))]
        assert inverse == pytest.approx(np.linalg.inv(ordered)[np.ix_(near, near)], abs=1e-12)


def test_rows_in_pieces_are_the_same_matrix():
    design = build_design(
        lay_out(Bench(seed=3, increments=7).survey(passes=(1, 2), joined=True)),
        "FXYZ",
        Model(reversal=True, play=True),
    )
    packed, dense, rng = (
        pack(design.rows, design.blocks),
        design.rows.dense(),
        np.random.default_rng(1),
    )
    unknowns, readings, weight = (
        rng.normal(size=(len(dense.T), 5)),
        rng.normal(size=(len(dense), 4)),
        rng.uniform(0.5, 2.0, len(dense)),
    )
    assert packed.times(unknowns) == pytest.approx(dense @ unknowns)
    assert packed.transposed_times(readings) == pytest.approx(dense.T @ readings)
    order = np.argsort(design.blocks.place)
    expected = in_blocks(
        (dense.T @ (weight[:, None] * dense))[np.ix_(order, order)], design.blocks
    )
    found = packed.normal(weight)
    assert found.diagonal == pytest.approx(expected.diagonal)
    for one, other in zip(
        [*found.own, *found.lower, found.coupling],
        [*expected.own, *expected.lower, expected.coupling],
        strict=True,
    ):
        assert one == pytest.approx(other, abs=1e-9)


def test_rows_that_reach_further_than_the_next_block_are_refused():
    rows = Rows(np.array([[0, 1], [1, 2], [0, 2]]), np.ones((3, 2)), 3)
    with pytest.raises(ValueError, match="neighbours"):
        pack(rows, order_blocks(np.arange(3)))


def test_redundancy_is_what_a_change_of_one_reading_leaves_in_its_residual():
    rng = np.random.default_rng(8)
    rows, target = random_rows(rng, 30, 3, 10, used=10), rng.normal(size=30)
    blocks = order_blocks(np.full(10, -1))
    before = fit(rows, blocks, target, np.ones(30))
    for row in (0, 13):
        after = fit(rows, blocks, target + np.eye(30)[row], np.ones(30))
        assert after.residual[row] - before.residual[row] == pytest.approx(
            before.redundancy[row], abs=1e-10
        )
    assert np.sum(before.redundancy) == pytest.approx(before.freedom)


def test_a_whole_survey_in_blocks_is_a_dense_least_squares_fit():
    """All 18 functions of n = 12 from three beam lines: residuals of numpy's lstsq, and its
    variance of every reported quantity."""
    volume = Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=(600.0, 500.0, 400.0), increments=12)
    runs = [
        Run(
            setup=f"{name}+{k}",
            return_pass=k == 1,
            beam_offset_mm=(50.0 * (k == 2), 50.0 * (k == 3), 0.0),
        )
        for name in DIAGONALS
        for k in (1, 2, 3)
    ]
    layout = lay_out(
        perfect_readings(Plan(volume=volume, runs=(*runs, Run(setup="linear-x"))), 0.3)
    )
    design = build_design(layout, "XFYZ", Model(angles=True))
    assert design.blocks.count == 6
    target = np.random.default_rng(5).normal(size=len(layout))
    found = fit(design.rows, design.blocks, target, np.ones(len(target)))
    dense = design.rows.dense()
    best = np.linalg.lstsq(dense, target, rcond=1e-10)[0]
    assert found.residual == pytest.approx(target - dense @ best, abs=1e-8)
    asked = reported(design)
    seen = found.inverse.sees(asked.combination)
    wanted = asked.combination.dense()[seen]
    exact = np.sum((wanted @ np.linalg.pinv(dense, rcond=1e-10)) ** 2, axis=1)
    assert variance(asked, found.inverse)[seen] == pytest.approx(exact, rel=1e-5, abs=1e-12)


def test_covariances_of_many_rows_are_those_of_a_dense_inverse():
    """More rows than are worked out at a time, unknowns in two blocks and a border."""
    rng = np.random.default_rng(1)
    rows = random_rows(rng, 1100, 3, 12, used=12)
    group = np.repeat([0, 1, -1], 4)
    inverse = invert(rows, np.ones(len(rows)), order_blocks(group))
    dense = rows.dense()
    np.testing.assert_allclose(
        inverse.among(rows), dense @ np.linalg.inv(dense.T @ dense) @ dense.T, atol=1e-12
    )
