"""What is beside the model of a survey competes by one number; what stays probable is in the
result, of a good survey nothing."""

import ast
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.names import PRODUCTS
from stepdiag.base.result.result import parse_result
from stepdiag.solver.adjustment import explanations
from stepdiag.solver.adjustment.adjustment import adjust
from stepdiag.solver.adjustment.counts import Counts
from stepdiag.solver.adjustment.evidence import GROWN, ODDS, PRODUCT, SCALE, SURE
from stepdiag.solver.adjustment.explanations import explained, products_um, reaching, shares
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.model.effects import BESIDE, ONE_SCALE
from stepdiag.solver.model.layout import lay_out
from testkit.exact.surveys import DIAGONALS, LINEAR, Bench
from testkit.examples import spread

FAMILY = ("counts", "evidence", "exchanged", "explanations", "faults", "naming", "smoothness")
KINDS = np.array([*[SCALE] * 7, *[PRODUCT] * 10, GROWN])


def test_what_decides_has_at_most_fifteen_figures_each_with_its_reason():
    """A prior that several kinds share is one figure, and one that follows from the odds is
    none."""
    figures = 0
    for name in FAMILY:
        source = (
            Path(explanations.__file__).with_name(f"{name}.py").read_text(encoding="utf-8")
        )
        for one, after in pairwise(ast.parse(source).body):
            every = list(ast.walk(one.value)) if isinstance(one, ast.Assign) else []
            numbers = {
                each.value
                for each in every
                if isinstance(each, ast.Constant) and isinstance(each.value, float | int)
            }
            follows = any(isinstance(each, ast.Name) and each.id == "ODDS" for each in every)
            if numbers and not follows:
                several = isinstance(one.value, ast.Dict | ast.Tuple)
                figures += len(numbers) if several else 1
                assert isinstance(after, ast.Expr), ast.unparse(one)
    assert figures <= 15


@given(st.lists(st.floats(-12.0, 12.0), min_size=len(KINDS), max_size=len(KINDS)))
def test_shares_are_probabilities_and_nothing_less_than_one_in_twenty_is_among_them(odds):
    share = shares(np.array(odds), KINDS)
    assert np.all(share >= 0.0)
    assert np.sum(share) <= 1.0 + 1e-9
    kinds = [
        float(np.sum(share, where=np.equal(KINDS, kind))) for kind in (SCALE, PRODUCT, GROWN)
    ]
    most = max(*kinds, 1.0 - sum(kinds))
    # of a kind, those that have little of its best are left out: at most nine twentieths of it
    assert all(one == 0.0 or 1.45 * one * ODDS >= 0.99 * most for one in kinds)
    reached = reaching(share, KINDS)
    assert np.all(reached >= share)
    assert np.all(reached[share == 0.0] == 0.0)


@given(st.floats(-3.0, 12.0))
def test_two_u_reach_over_every_explanation_of_one_pattern(odds):
    """Seven explanations of one pattern: where one is true the mixture is off by t (1 - p), and 2 u
    is twice the root of the share."""
    share = shares(np.where(KINDS == SCALE, odds, -30.0), KINDS)
    if float(np.sum(share)) > 1.0 - SURE:
        off = 1.0 - share[KINDS == SCALE]
        assert np.all(2.0 * np.sqrt(reaching(share, KINDS)[KINDS == SCALE]) >= off - 1e-9)


@pytest.mark.parametrize("how", [{}, {"passes": (1, 2)}], ids=["one-way", "out-and-back"])
def test_nothing_is_left_open_of_a_good_survey(how):
    """Then its result is that of the plain adjustment, to the last bit."""
    for seed in spread(range(20, 24), 2):
        found = adjust(lay_out(Bench(seed=seed).survey(**how)), "FXYZ")
        assert found.explained.nothing > 0.5
        assert not {ONE_SCALE, BESIDE} & {effect.name for effect in found.effects}


@pytest.mark.parametrize(
    ("product", "size_um"), [("Z(yyz)", -30.0), ("X(xy)", 25.0), ("Y(xz)", 12.0)]
)
def test_a_machine_beside_the_model_is_named_or_in_the_mixture(product, size_um):
    """Each product is read by the diagonals alone; what explains as much as it does stays probable
    beside it."""
    for seed in spread((20, 21), 2):
        readings = Bench(seed=seed).survey()
        column = size_um * products_um(lay_out(readings))[:, list(PRODUCTS).index(product)]
        result = adjust(
            lay_out(replace(readings, reading_mm=readings.reading_mm + 1e-3 * column)), "FXYZ"
        ).explained
        sizes = {
            list(PRODUCTS)[result.named[at]]: result.size[at]
            for at in result.probable(PRODUCT)
        }
        assert product in sizes
        assert sizes[product] == pytest.approx(size_um, abs=0.4 * abs(size_um))


@pytest.mark.parametrize("seed", [20, 23])
def test_the_same_contradiction_in_setups_driven_again_is_the_machine(seed):
    """The survey was refused with a pass that wanders: a walk of one pass explains a part of what
    both drives of each diagonal show."""
    readings = Bench(seed=seed).survey(
        (*DIAGONALS, *LINEAR, *(f"{one}+1" for one in DIAGONALS))
    )
    readings = readings.select(np.concatenate(list(readings.passes().values())))
    column = 40.0 * products_um(lay_out(readings))[:, list(PRODUCTS).index("X(xy)")]
    found = solve(replace(readings, reading_mm=readings.reading_mm + 1e-3 * column))
    (named,) = [each for each in found.findings if each.severity != "info"]
    assert named.key == "machine-beside-model"
    assert "X(xy)" in named.text


def test_a_result_with_an_error_of_two_axes_is_read_back():
    """Each such error is in the posterior: the export refused the result's own file."""
    readings = Bench(seed=20).survey()
    product_um = 25.0 * products_um(lay_out(readings))[:, list(PRODUCTS).index("X(xy)")]
    found = solve(replace(readings, reading_mm=readings.reading_mm + 1e-3 * product_um))
    assert "X(xy)" in found.posterior.offset
    again = parse_result(found.to_json())
    assert again.posterior.offset["X(xy)"] == pytest.approx(
        found.posterior.offset["X(xy)"], abs=1e-4
    )


def test_a_slip_taken_off_and_a_machine_beside_the_model_are_both_in_the_uncertainty():
    """Each cause alone increases U of squareness; both together increase it as much as the larger
    one."""
    readings = Bench(seed=20).survey()
    product_um = 25.0 * products_um(lay_out(readings))[:, list(PRODUCTS).index("X(xy)")]
    late = (np.array(readings.setup) == "pnp") & (np.array(readings.stop) >= 14)
    clean, slipped, beside, both = (
        solve(replace(readings, reading_mm=readings.reading_mm + 1e-3 * off_um))
        for off_um in (0.0 * product_um, 20.0 * late, product_um, product_um + 20.0 * late)
    )
    assert "count-step" in {each.key for each in both.findings}
    for name, without in clean.squareness.items():
        alone = [result.squareness[name].u for result in (slipped, beside)]
        assert min(alone) > 1.01 * without.u
        assert both.squareness[name].u > 0.97 * max(alone)


def test_one_setup_driven_three_times_with_another_scale_is_named_alone():
    """With the diagonals driven again one length is compared more than once, and one explanation is
    left."""
    setups = (*DIAGONALS, *LINEAR, "ppp+1", "npp+1", "pnp+1", "ppn+1")
    readings = Bench(seed=5).survey(setups)
    wrong = np.array([name == "npp+1" for name in readings.setup])
    result = solve(
        replace(readings, reading_mm=readings.reading_mm * np.where(wrong, 1 + 93e-6, 1.0))
    )
    named = [each for each in result.findings if each.key == "setup-scale-off"]
    assert [each.message.arguments["setup"] for each in named] == ["npp+1"]
    assert named[0].message.arguments["scale_um_m"] == pytest.approx(93.0, abs=10.0)


def test_a_survey_without_a_volume_has_no_products():
    layout = lay_out(Bench(seed=1).survey(("linear-x",)))
    assert not np.any(products_um(layout))
    found = adjust(layout, "FXYZ")
    assert not found.explained.probable(PRODUCT)
    none = Counts(fixed=found.fit.fixed, single=[])
    assert explained(found.fit, layout, np.zeros((len(layout), 0)), none).nothing == 1.0
