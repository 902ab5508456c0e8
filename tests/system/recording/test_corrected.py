"""A survey file that is corrected while the daemon runs: the page shows what changes, and a person
with the token applies it."""

import json

import pytest

from stepdiag.daq.recording.corrections import corrections_in
from stepdiag.virtual.base.reserved import reserved_port
from testkit.cli import stepdiag
from testkit.running.hall import daemon, hall, ordered, until

pytestmark = pytest.mark.system


@pytest.mark.parametrize("early", [False, True], ids=["after stops", "before the first stop"])
def test_a_corrected_file_is_applied_on_the_page_and_the_survey_goes_on(early, tmp_path):
    """The laser counts the other way round: no pass of ppp is whole until the sign is corrected,
    and none is driven twice."""
    port, token = reserved_port(), "a token of the tests"
    with hall(
        tmp_path, setups=("ppp", "npp"), page=True, page_port=port, laser_survey="sign = -1"
    ) as place:
        file = tmp_path / "survey.token"
        file.write_text(token)
        file.chmod(0o600)
        text = place.survey.read_text().replace(
            "enabled = true\nport", 'enabled = true\ntoken_file = "survey.token"\nport'
        )
        place.survey.write_text(text)
        with daemon(place.survey) as process:
            if early:
                place.survey.write_text(text.replace("sign = -1", "sign = 1"))
                until(process, "survey-changed", changes=[])
            place.start_setups(stop_after=1)
            place.survey.write_text(text.replace("sign = -1", "sign = 1"))
            until(process, "survey-changed", changes=["laser.sign: -1 -> 1"])
            ordered(port, token, "correct", name="somebody")
            until(process, "survey-corrected", given_name="somebody")
            place.bench.say("start")
            until(process, "survey-complete")
        code, out, refusal = stepdiag("status", place.survey, "--json")
        assert code == 0, refusal
        standing = json.loads(out)
        assert standing["round"] == "0001"
        assert standing["result"]
        assert [(each.name, each.changes) for each in corrections_in(place.round)] == [
            ("somebody", ("laser.sign: -1 -> 1",))
        ]
