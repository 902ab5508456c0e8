"""What the solver alone sees is said by the daemon as its own: over real processes, sockets and
ptys."""

import json

import pytest

from testkit.cli import stepdiag
from testkit.exact.siemens_files import HALL_EXPORT, HALL_PROFILE
from testkit.running.hall import daemon, hall, until

pytestmark = pytest.mark.system

QUICK = {
    "handshake": True,
    "dwell": 0.1,
    "n": 2,
    "setups": ("ppp", "npp", "pnp", "ppn", "linear-x", "linear-y", "linear-z"),
    "laser_bench": "compensated = true\n",
    "laser_survey": "compensated = true\n",
    "exports": HALL_EXPORT,
}


@pytest.mark.impatient
def test_readings_that_contradict_each_other_are_not_exported_and_the_pass_is_named(tmp_path):
    """A slip in a run that nothing repeats: the recording has nothing to say of it. What the solver
    says survives a restart.

    The readings do not tell which pass it is: every one is doubted, this one among them.
    """
    trouble = (
        '[[fault]]\nkind = "laser-jump"\nsetup = "linear-y"\npass_number = 1\nstop = 1\nphase = '
        '"move"\nvalue = 60.0\n'
    )
    (tmp_path / "siemens.toml").write_text(HALL_PROFILE)
    with hall(tmp_path, faults=trouble, **QUICK) as place:
        with daemon(place.survey) as process:
            place.start_setups(stop_after=len(place.setups))
            assert "linear-y" in until(process, "survey-open")[-1]["reason"]
        told = json.loads(stepdiag("status", place.survey, "--json").out)
        named = [
            each
            for each in told["doubts"]
            if each["code"] == "angles-far" and each["setup"] == "linear-y"
        ]
        assert named
        assert f"{named[0]['place']} --reason" in stepdiag(
            "status", place.survey, "--verbose"
        ).out.replace("\n", " ")
        assert not [
            path
            for path in place.round.rglob("*")
            if path.name == "result.json" or path.suffix == ".INI"
        ]
        with daemon(place.survey) as process:
            assert "linear-y" in until(process, "survey-open")[-1]["reason"]
        assert (
            json.loads(stepdiag("status", place.survey, "--json").out)["doubts"]
            == told["doubts"]
        )
