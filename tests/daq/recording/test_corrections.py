"""What a corrected survey file costs: nothing, a reading of the logs, or a new round."""

import msgspec
import pytest

from stepdiag.daq.recording.corrections import changes, corrections_in
from stepdiag.daq.recording.rounds import latest_round
from stepdiag.daq.survey.file import parse_survey
from testkit.exact.shops import CAUSES, corrected, draw, survey_of, surveyed

FREE = {
    "ports": ('port = "/dev/null"', 'port = "/dev/ttyUSB1"'),
    "pace": ("poll_hz = 40", "poll_hz = 30"),
    "page": ("[stop]", "[page]\nport = 8099\n[stop]"),
    "uncertainty": ("[stop]", "[uncertainty]\nrepeatability_um = 0.7\n[stop]"),
}
READING = {
    "sign": ("compensated = true", "compensated = true\nsign = -1"),
    "latency": ("poll_hz = 40", "poll_hz = 40\nlatency_s = 0.1"),
    "order": ("increments = 2", 'increments = 2\naxis_order = "zxy"'),
    "settling": ("settle_s = 0.15", "settle_s = 0.2"),
}
DRIVEN = {
    "increments": ("increments = 2", "increments = 3"),
    "targets": ('"linear-z"', '"linear-y"'),
    "return": ("return_pass = false", "return_pass = true"),
}
SHOP = draw(list(CAUSES).index("laser sign"))
TEXT = survey_of(SHOP).replace("return_pass = true", "return_pass = false")


@pytest.mark.parametrize("what", [*FREE, *READING, *DRIVEN])
def test_a_change_costs_what_it_must(what):
    before, after = {**FREE, **READING, **DRIVEN}[what]
    assert before in TEXT
    text = TEXT.replace(before, after, 1)
    found = changes(
        parse_survey(TEXT, "a"),
        parse_survey(text, "b") if what != "targets" else _without(TEXT),
    )
    assert found
    assert any(each.begins_round for each in found) is (what in DRIVEN)
    assert any(each.reads_otherwise for each in found) is (what in READING)


def _without(text):
    survey = parse_survey(text, "a")
    return msgspec.structs.replace(
        survey, plan=msgspec.structs.replace(survey.plan, setups=survey.plan.setups[:-1])
    )


def test_the_recorder_goes_on_with_the_round_and_the_passes_of_the_corrected_file(tmp_path):
    """A laser that counts the other way round: no pass was whole, and with the corrected file none
    is left to drive."""
    found = surveyed(SHOP, tmp_path / "first", files=False)
    assert found.passes == 0
    folder = tmp_path / "bench"
    folder.mkdir()
    (tmp_path / "first" / "logs").rename(folder / "0001")
    right = corrected(SHOP, survey_of(SHOP))
    begun = latest_round(folder, right, {})
    assert begun.folder.name == "0001"
    assert not any(stop.refused for stop in begun.stops)
    assert len({(stop.setup, stop.outward, stop.stop) for stop in begun.stops}) >= 7 * 3
    (noted,) = corrections_in(folder / "0001")
    assert noted.changes == ("laser.sign: 1 -> -1",)
    assert latest_round(folder, right, {}).stops == begun.stops
    assert len(corrections_in(folder / "0001")) == 1
    assert (
        latest_round(
            folder, right.replace("increments = 2", "increments = 3"), {}
        ).folder.name
        == "0002"
    )
