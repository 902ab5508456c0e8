"""A counter that is set back shows the number of a stop in the NC programs."""

import pytest

from stepdiag.daemon.driving import sequence_of
from stepdiag.daq.capture.naming.route import route_of
from stepdiag.daq.survey.file import parse_survey
from stepdiag.exporters.programs import passes_of
from testkit.timeline import survey_text

PLANS = {
    "diagonals": 'setups = ["ppp", "npp"]',
    "orders": 'setups = ["ppp", "linear-x"]\nrepeats = 3\naxis_orders = ["xyz", "yzx", "zxy"]',
    "targets": 'setups = ["ppn", "linear-z", "ppp"]\nrepeats = 2\ntargets = 7',
    "faces": 'setups = ["face-xz-np", "pnp"]\nrepeats = 2',
}


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("plan", PLANS.values(), ids=PLANS)
def test_every_pass_begins_with_the_count_of_its_nc_program(plan, back):
    text = survey_text(back=back).replace('setups = ["ppp"]', plan)
    survey = parse_survey(text, "survey.toml")
    sequence = sequence_of(survey)
    counts = []
    for setup in sequence.setups:
        for each in passes_of(sequence, setup):
            counts += [stop.count for stop in each.stops]
            begun = route_of(survey.planned, setup, each.number).counts
            assert each.stops[0].count in begun
    assert counts == [*range(1, len(counts) + 1)]
