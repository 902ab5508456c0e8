"""Each source of uncertainty against a figure worked out elsewhere."""

import numpy as np
import pytest

from stepdiag.solver.geometry.volume import BODY_DIAGONALS, Volume, diagonal_direction, diagonal_stops_mm, linear_stops_mm
from stepdiag.solver.model.layout import lay_out
from stepdiag.solver.readings.readings import make_readings
from stepdiag.solver.standards.expansion import expansion_um
from stepdiag.solver.uncertainty.sources import Assumptions, sources

CUBE = Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=(1000.0, 1000.0, 1000.0), increments=5)


def survey(setups, volume=CUBE, **columns):
    """Return the layout of outward passes with perfect readings."""
    stops = {name: linear_stops_mm(volume, name) if "linear" in name else diagonal_stops_mm(volume, name) for name in setups}
    along = {name: np.eye(3)["xyz".index(name[-1])] if "linear" in name else diagonal_direction(volume, name) for name in setups}
    return lay_out(
        make_readings(
            setup=[name for name in setups for _ in stops[name]],
            pass_number=np.ones(sum(map(len, stops.values()))),
            stop=np.concatenate([np.arange(len(points)) for points in stops.values()]),
            position_mm=np.vstack(list(stops.values())),
            reading_mm=np.concatenate([(points - points[0]) @ along[name] for name, points in stops.items()]),
            **columns,
        )
    )


DIAGONALS = survey(BODY_DIAGONALS)
X_RUN = survey(["ppp", "linear-x"])


def pattern(layout, name, chain="FXYZ", **assumed):
    return next(source for source in sources(layout, chain, Assumptions(**assumed)) if source.name == name).pattern_um


def last_stop(layout, setup):
    index = [found.name for found in layout.setups].index(setup)
    return np.flatnonzero(layout.setup_index == index)[-1]


def test_every_source_names_its_assumption():
    found = sources(DIAGONALS, "FXYZ", Assumptions())
    expected = ["reading", "repeatability", "drift", "air", "material temperature", "alignment", "unmodelled angles"]
    assert [source.name for source in found] == expected
    assert all(any(letter.isdigit() for letter in source.text) for source in found)
    assert {len(source.pattern_um) for source in found} == {len(DIAGONALS)}


def test_stop_with_its_own_uncertainty_keeps_it():
    count = len(DIAGONALS)
    own = np.where(np.arange(count) == 4, 0.7, np.nan)
    layout = survey(BODY_DIAGONALS, u_um=own)
    assert sorted(set(pattern(layout, "reading", reading_um=0.25).tolist())) == [0.25, 0.7]


def test_wander_reaches_its_size_at_the_end_of_each_pass():
    walk = pattern(DIAGONALS, "drift", wander_um=0.4, drift_um=0.0)
    size = np.linalg.norm(walk, axis=1)
    for setup in BODY_DIAGONALS:
        end = last_stop(DIAGONALS, setup)
        assert size[end] == pytest.approx(0.4)
        assert size[end - 15] == 0.0
    assert np.linalg.norm(walk[last_stop(DIAGONALS, "ppp")] * walk[last_stop(DIAGONALS, "npp")]) == 0.0


def test_ramp_grows_with_the_stops_of_a_pass():
    ramp = pattern(DIAGONALS, "drift", drift_um=0.6, wander_um=0.0)
    assert ramp[: last_stop(DIAGONALS, "ppp") + 1, 0] == pytest.approx(0.6 * np.arange(16) / 15)
    assert not ramp[: last_stop(DIAGONALS, "ppp") + 1, 1:].any()


def test_index_of_air_is_a_common_scale():
    """0.2 ppm on 1.732 m and 1 m: 0.346 and 0.2 um."""
    air = pattern(X_RUN, "air", index=2e-7)[:, 0]
    assert air[last_stop(X_RUN, "ppp")] == pytest.approx(0.2 * np.sqrt(3))
    assert air[last_stop(X_RUN, "linear-x")] == pytest.approx(0.2)


def test_material_is_the_expansion_of_each_axis():
    """The pattern of one axis's temperature is the expansion by that much (stepdiag.solver.standards.expansion)."""
    columns = pattern(DIAGONALS, "material temperature", u_material_c=0.5, material_c=(23.0, 20.0, 20.0), u_expansion_um_m_c=1.0)
    for axis in range(3):
        warm = 20.0 + 0.5 * np.eye(3)[axis]
        travel = DIAGONALS.position_mm - DIAGONALS.position_mm[DIAGONALS.stop == 0][DIAGONALS.pass_index]
        for row in (3, 20, last_stop(DIAGONALS, "npp")):
            expected = expansion_um(travel[row : row + 1], DIAGONALS.direction[row], [11.7] * 3, warm)[0]
            assert columns[row, axis] == pytest.approx(expected)
    assert columns[last_stop(DIAGONALS, "ppp"), 3:] == pytest.approx([3.0 / np.sqrt(3), 0.0, 0.0])


def test_misaligned_beam_reads_short():
    """theory.md 8.7: L theta^2 / 2 over root 3; 1 mrad on 1 m is 0.5 um / 1.732."""
    column = pattern(X_RUN, "alignment", alignment_mrad=1.0)
    assert column[last_stop(X_RUN, "linear-x")] == pytest.approx([0.0, -0.5 / np.sqrt(3)], abs=1e-9)
    assert column[last_stop(X_RUN, "ppp")] == pytest.approx([-0.5, 0.0], abs=1e-9)


def four_terms(ends_um, size_mm=1000.0):
    """Return false squareness (xy, yz, zx) in urad and S in um from end-to-end deviations (theory.md 3, E5)."""
    ppp, npp, pnp, ppn = ends_um
    unit = np.sqrt(3) / (4 * 1e-3 * size_mm)
    return (ppp - npp - pnp + ppn) * unit, (ppp + npp - pnp - ppn) * unit, (ppp - npp + pnp - ppn) * unit, (ppp + npp + pnp + ppn) / 4


@pytest.mark.parametrize(
    ("name", "squareness_urad", "sum_um"),
    [
        ("EAX", (-5.0, 0.0, 5.0), 0.0),
        ("EBX", (0.0, 0.0, 5.0), 2.9),
        ("ECX", (-5.0, 0.0, 0.0), -2.9),
        ("EAY", (0.0, -5.0, 0.0), -2.9),
        ("EBY", (5.0, 0.0, 5.0), 0.0),
    ],
)
def test_linear_angle_gives_the_false_squareness_of_the_reference(name, squareness_urad, sum_um):
    """theory.md 5.3, measured with an exact simulator: 10 urad over a 1 m cube, chain FXYZ."""
    straight_part = pattern(DIAGONALS, "unmodelled angles", angle_urad={name: 10.0})[:, 0]
    found = four_terms([straight_part[last_stop(DIAGONALS, setup)] for setup in BODY_DIAGONALS])
    assert found == pytest.approx((*squareness_urad, sum_um), abs=0.05)


def test_angles_that_are_known_bring_nothing():
    assert pattern(DIAGONALS, "unmodelled angles", angle_urad={}).shape == (len(DIAGONALS), 0)


def test_waves_of_the_prior_are_half_the_straight_part():
    """A sine over the travel peaks at half of the stated size: at mid-travel of X on its own run, 100 mm off the axis."""
    offset = np.tile([0.0, 100.0, 0.0], (len(X_RUN), 1))
    layout = survey(["ppp", "linear-x"], beam_mm=offset)
    columns = pattern(layout, "unmodelled angles", angle_urad={"ECX": 10.0})
    rows = np.flatnonzero(layout.setup_index == [found.name for found in layout.setups].index("linear-x"))
    # yaw moves a point 100 mm aside in +y by -1 um along x at the far end
    assert columns[rows, 0] == pytest.approx(-1.0 * np.linspace(0, 1, 6), abs=1e-9)
    assert columns[rows, 1] == pytest.approx(-0.5 * np.sin(np.pi * np.linspace(0, 1, 6)), abs=1e-9)
