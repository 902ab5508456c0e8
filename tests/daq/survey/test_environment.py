"""Conditions that a person states after a survey."""

import pytest

from stepdiag.base.errors import UsageError
from stepdiag.daq.survey.environment import parse_environment


def test_a_table_or_a_whole_survey_file_will_do():
    assert parse_environment("air_pressure_hpa = 950.0\n", "e.toml") == {
        "air_pressure_hpa": 950.0
    }
    text = (
        '[survey]\nname = "x"\n[environment]\nsource = "fixed"\nair_temperature_c = '
        "21.5\nmaterial_temperature_c = 22\n"
    )
    assert parse_environment(text, "s.toml") == {
        "air_temperature_c": 21.5,
        "material_temperature_c": 22.0,
    }


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[environment]\n",
        "air_pressure_kpa = 101.3\n",
        "air_pressure_hpa = 101.3\n",
        "x = [",
    ],
)
def test_what_states_nothing_or_the_impossible_is_refused(text):
    with pytest.raises(UsageError, match=r"e\.toml"):
        parse_environment(text, "e.toml")
