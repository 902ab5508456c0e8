"""The straightness file: written and read back, weighed by its uncertainty in `solve`, and refused
by line and column."""

from dataclasses import replace

import numpy as np
import pytest

from stepdiag.base.errors import DataError
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.model.straightness_file import parse_straightness, render_straightness
from testkit.exact.straightness import straightness
from testkit.exact.surveys import Bench


def test_what_is_written_is_read_back_and_weighs_the_same():
    bench = Bench(seed=3, increments=4, angle_urad=10.0)
    measured = [
        replace(one, position_mm=np.round(one.position_mm, 6))
        for one in straightness(bench, 3)
    ]
    text = render_straightness(measured)
    again = parse_straightness(text, "straightness.csv")
    assert render_straightness(again) == text
    assert {(one.name, one.approach) for one in again} == {
        (one.name, one.approach) for one in measured
    }
    readings = bench.survey(passes=(1, 2))
    direct, through = (
        solve(readings, straightness=measured),
        solve(readings, straightness=again),
    )
    for name, function in direct.errors.items():
        assert through.errors[name].value == pytest.approx(function.value, abs=1e-4), name
        assert through.errors[name].u == pytest.approx(function.u, abs=1e-4), name


def test_an_uncertain_straightness_hardly_counts():
    """The bench's head lies by 20 µm here, and says that it may."""
    bench = Bench(seed=3, increments=4)
    readings = bench.survey(passes=(1, 2))
    bent = "".join(
        f"{x:g},{20 * np.sin(np.pi * x / 500):g},30\n" for x in np.linspace(0, 500, 5)
    )
    told = parse_straightness("position_mm,EYX_um,u_EYX_um\n" + bent)
    alone, beside = solve(readings), solve(readings, straightness=told)
    assert beside.errors["EYX"].value == pytest.approx(alone.errors["EYX"].value, abs=0.2)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "position_mm,EYX_um\n0,0\n1,0\n2,0\n",
            (
                r"s\.csv: header: expected a column u_EYX_um, found none; state the standard "
                r"uncertainty"
            ),
        ),
        (
            "position_mm,EXX_um,u_EXX_um\n0,0,1\n",
            r"s\.csv: header: expected columns such as EYX_um .* found EXX",
        ),
        ("position_mm\n0\n", r"s\.csv: header: expected columns such as EYX_um"),
        (
            "position_mm,EYX_um,u_EYX_um\n0,0,1\n1,2,\n",
            r"s\.csv: line 3: u_EYX_um: expected a finite number",
        ),
        (
            "position_mm,EYX_um,u_EYX_um\n0,0,1\n1,2,0\n",
            r"s\.csv: line 3: u_EYX_um: expected a standard uncertainty above 0",
        ),
        (
            "position_mm,EYX_um,u_EYX_um\n0,0,1\n1,2,1\n",
            r"s\.csv: EYX: expected values at 3 positions at least, found 2",
        ),
        (
            "position_mm,EYX_um,u_EYX_um\n0,0,1\n1,2,1\n1,2,1\n",
            r"s\.csv: EYX: expected every position once in each direction, found 1 mm twice",
        ),
        (
            "position_mm,approach,EYX_um,u_EYX_um\n0,2,0,1\n",
            r"s\.csv: line 2: approach: expected 1, -1 or 0, found 2",
        ),
        (
            "position_mm,EYX_um,u_EYX_um\n0,,\n",
            r"s\.csv: expected a value of a straightness function",
        ),
    ],
)
def test_what_is_wrong_is_named(text, words):
    with pytest.raises(DataError, match=words):
        parse_straightness(text, "s.csv")
