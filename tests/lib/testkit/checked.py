"""Surveys for ``stepdiag check``, and an observation of one without any link."""

from stepdiag.checking.check import Observation
from stepdiag.daq.survey.file import parse_survey

LINE_SURVEY = """\
[survey]
name = "checked"
machine = "test"
[volume]
size_mm = [300.0, 200.0, 100.0]
increments = 2
[machine]
compensation = "off"
[laser]
format = "line"
port = "laser"
[laser.line]
pattern = '(?P<position>[-+.0-9]+) (?P<counter>[0-9]+) (?P<beam>[.0-9]+)'
"""


def seen_of(text: str) -> Observation:
    """Return an observation of the survey that has seen nothing yet."""
    return Observation(parse_survey(text, "survey.toml"))
