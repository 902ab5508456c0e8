"""What a survey takes for granted: certificates of the air's sensors reach the index as one error of the whole survey."""

import pytest

from stepdiag.daq.survey.assumed import parse_uncertainty


def test_without_certificates_the_assumed_index_stands():
    assert parse_uncertainty("[uncertainty]\nindex_ppm = 0.4\n", "u.toml").index == pytest.approx(4e-7)


def test_sensors_take_the_place_of_the_assumed_index():
    """1 C makes 0.95 ppm, 3.7 hPa 1 ppm (Edlen's equation at 20 C): both together, and the laser's own 0.1 ppm."""
    text = "[uncertainty]\nindex_ppm = 9.0\nu_air_temperature_c = 0.2\nu_air_pressure_hpa = 0.74\nu_laser_ppm = 0.1\n"
    expected = (0.19**2 + 0.2**2 + 0.1**2) ** 0.5 * 1e-6
    assert parse_uncertainty(text, "u.toml").index == pytest.approx(expected, rel=0.03)
