"""The index of air against published values, and the rule that nothing is corrected twice."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.conditions.air import (
    Air,
    AirUncertainty,
    Done,
    ciddor_index,
    correction_factor,
    displacement_mm,
    edlen_index,
    index_u,
    refractive_index,
    saturation_pressure_pa,
)
from stepdiag.base.errors import DataError

STANDARD = {"temperature_c": 20.0, "pressure_hpa": 1013.25, "humidity_percent": 50.0}


def air(**changes):
    return Air(**{**STANDARD, **changes})


NIST_CIDDOR = [
    (321.456, {}, 1.000283543),
    (500.0, {}, 1.000273781),
    (600.1234, {}, 1.000271818),
    (633.0, {}, 1.000271373),
    (700.0, {}, 1.000270657),
    (1000.987, {}, 1.000269038),
    (1500.8, {}, 1.00026819),
    (1700.0, {}, 1.000268041),
    (633.0, {"temperature_c": -20.0}, 1.00031489),
    (633.0, {"temperature_c": 0.0}, 1.000291647),
    (633.0, {"temperature_c": 26.7982}, 1.000264994),
    (633.0, {"temperature_c": 40.123}, 1.000253031),
    (633.0, {"temperature_c": 60.45}, 1.000235516),
    (633.0, {"pressure_hpa": 100.0}, 1.000026385),
    (633.0, {"pressure_hpa": 501.23}, 1.000133999),
    (633.0, {"pressure_hpa": 1001.234}, 1.000268148),
    (633.0, {"pressure_hpa": 1400.0}, 1.000375169),
    (633.0, {"humidity_percent": 0.0}, 1.0002718),
    (633.0, {"humidity_percent": 20.123}, 1.000271627),
    (633.0, {"humidity_percent": 40.0}, 1.000271458),
    (633.0, {"humidity_percent": 50.9876}, 1.000271364),
    (633.0, {"humidity_percent": 70.0}, 1.000271203),
    (633.0, {"humidity_percent": 90.7432}, 1.000271027),
    (633.0, {"humidity_percent": 100.0}, 1.000270949),
]


@pytest.mark.parametrize(("wavelength_nm", "changes", "published"), NIST_CIDDOR)
def test_ciddor_gives_the_values_of_the_nist_page(wavelength_nm, changes, published):
    """NIST Engineering Metrology Toolbox, Ciddor calculator, CO2 450 ppm, nine decimals."""
    assert ciddor_index(air(**changes), wavelength_nm) == pytest.approx(published, abs=1e-8)


@pytest.mark.parametrize(
    ("changes", "published"),
    [
        ({"humidity_percent": 20.0}, 1.0002716291691649),
        ({"humidity_percent": 80.0}, 1.0002711197635226),
        ({"humidity_percent": 80.0, "temperature_c": 60.0}, 1.0002339748542823),
    ],
)
def test_edlen_gives_the_worked_examples_to_the_last_digit(changes, published):
    """Worked examples of the NIST Appendix A implementation (ref_index 1.0), 633 nm."""
    assert edlen_index(air(**changes), 633.0) == pytest.approx(published, abs=1e-14)


def test_edlen_gives_the_first_row_of_the_nist_table():
    """NIST Table 1, row 1: 20 C, dry, 633 nm, modified Edlen: 1.000271799."""
    assert edlen_index(air(humidity_percent=0.0), 633.0) == pytest.approx(
        1.000271799, abs=5e-10
    )


@pytest.mark.parametrize(
    ("humidity_percent", "published_nm"), [(0.0, 632.827997), (50.0, 632.828268)]
)
def test_the_wavelength_in_air_has_the_nist_values(humidity_percent, published_nm):
    """NIST page, 633 nm at 20 C and 101.325 kPa, six decimals of a nanometre."""
    state = air(humidity_percent=humidity_percent)
    assert 633.0 / refractive_index(state, 633.0, "ciddor") == pytest.approx(
        published_nm, abs=1e-6
    )


@pytest.mark.parametrize(
    ("temperature_c", "pressure_pa"), [(20.0, 2339.2148), (0.01, 611.6570)]
)
def test_saturation_pressure_at_room_temperature_and_triple_point(temperature_c, pressure_pa):
    """IAPWS: 611.657 Pa at the triple point."""
    assert saturation_pressure_pa(temperature_c) == pytest.approx(pressure_pa, abs=1e-3)


def hp_5528a_index(state):
    """HP 5528A manual p. 302: n = 1 + N/1e6, with P in mmHg, stated to 0.1 ppm."""
    p, t, h = state.pressure_hpa / 1.33322387415, state.temperature_c, state.humidity_percent
    refractivity = 0.3836391 * p * (1 + 1e-6 * p * (0.817 - 0.0133 * t)) / (1 + 0.0036610 * t)
    return 1 + 1e-6 * (refractivity - 3.033e-3 * h * np.exp(0.057627 * t))


@given(st.floats(0, 40), st.floats(900, 1100), st.floats(0, 100))
def test_two_equations_agree_in_a_machine_hall(temperature_c, pressure_hpa, humidity_percent):
    """Measured over 0-40 C, 90-110 kPa: Edlen and Ciddor within 2.3e-8."""
    state = Air(
        temperature_c=temperature_c,
        pressure_hpa=pressure_hpa,
        humidity_percent=humidity_percent,
    )
    assert (
        abs(
            refractive_index(state, 633.0, "edlen") - refractive_index(state, 633.0, "ciddor")
        )
        < 2.5e-8
    )


@given(st.floats(15, 25), st.floats(950, 1050), st.floats(0, 60))
def test_edlen_agrees_with_the_formula_built_into_an_hp_5528a(
    temperature_c, pressure_hpa, humidity_percent
):
    """Stated to 0.1 ppm; its term for water vapour is the older one, so the two part in hot and
    damp air."""
    state = Air(
        temperature_c=temperature_c,
        pressure_hpa=pressure_hpa,
        humidity_percent=humidity_percent,
    )
    assert abs(edlen_index(state, 632.991) - hp_5528a_index(state)) < 1.1e-7


@given(st.floats(-500, 3000), st.floats(15, 30), st.floats(0, 2000))
def test_displacement_is_recovered_whatever_the_air_and_the_dead_path(
    truth_mm, temperature_c, dead_path_mm
):
    """Forward model: a counter that knows nothing of air reads n (D + L) - n0 D."""
    n0 = float(edlen_index(air(), 632.991))
    n = float(edlen_index(air(temperature_c=temperature_c), 632.991))
    vacuum_mm = n * (dead_path_mm + truth_mm) - n0 * dead_path_mm
    plain = {"zero_index": n0, "dead_path_mm": dead_path_mm}
    assert displacement_mm([vacuum_mm], [n], done=Done.NOTHING, **plain)[0] == pytest.approx(
        truth_mm, abs=1e-9
    )
    assert displacement_mm([vacuum_mm / n], [n], done=Done.WAVELENGTH, **plain)[
        0
    ] == pytest.approx(truth_mm, abs=1e-9)
    everything = Done.WAVELENGTH | Done.DEAD_PATH
    assert displacement_mm([truth_mm], [n], done=everything, **plain)[0] == truth_mm


def test_factor_is_one_when_the_instrument_has_done_it():
    index = edlen_index(air(temperature_c=[20.0, 25.0]), 632.991)
    assert correction_factor(index, Done.WAVELENGTH).tolist() == [1.0, 1.0]
    assert correction_factor(index, Done.NOTHING) == pytest.approx(1 / index)


def test_every_stop_gets_the_air_of_its_time():
    """A degree over the pass is 0.955 ppm: the stop half-way gets half of it, 0.48 µm on a metre of
    dead path."""
    index = edlen_index(air(temperature_c=[20.0, 20.5, 21.0]), 633.0)
    assert np.diff(index) * 1e6 == pytest.approx([-0.4775, -0.4775], abs=3e-3)
    standing = displacement_mm(
        [0.0, 0.0, 0.0],
        index,
        zero_index=float(index[0]),
        dead_path_mm=1000.0,
        done=Done.NOTHING,
    )
    assert standing * 1e3 == pytest.approx([0.0, 0.4775, 0.955], abs=6e-3)


def test_index_uncertainty_combines_the_sensitivities():
    """At 633 nm: -0.955 ppm/C, +0.268 ppm/hPa, -0.0085 ppm/% (measured on the published
    equation)."""
    u = index_u(
        air(),
        633.0,
        AirUncertainty(temperature_c=0.1, pressure_hpa=0.2, humidity_percent=5.0),
    )
    parts = np.array([0.1 * 0.955, 0.2 * 0.268, 5.0 * 0.0085, 0.01])
    assert u * 1e6 == pytest.approx(np.sqrt(np.sum(parts**2)), rel=5e-3)


def test_index_uncertainty_at_the_end_of_the_humidity_scale_is_finite():
    u = index_u(
        air(humidity_percent=100.0),
        633.0,
        AirUncertainty(temperature_c=0.0, pressure_hpa=0.0, humidity_percent=10.0),
    )
    assert u * 1e6 == pytest.approx(0.086, abs=0.002)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"pressure_hpa": 101325.0}, "air_pressure_hpa"),
        ({"pressure_hpa": 0.0}, "air_pressure_hpa"),
        ({"humidity_percent": 101.0}, "relative_humidity_percent"),
        ({"temperature_c": [20.0, float("nan")]}, "air_temperature_c"),
    ],
)
def test_air_that_cannot_be_is_refused_by_name(changes, field):
    with pytest.raises(DataError, match=field):
        air(**changes)
