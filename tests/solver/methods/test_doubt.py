"""What may be wrong with a survey is named with what it makes of the volume, and with the one setup
that separates it from the others."""

from dataclasses import replace

import numpy as np
import pytest

from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.base.volume import anywhere_mm
from stepdiag.solver.adjustment.diagnostics import scale_findings
from stepdiag.solver.methods import doubt
from stepdiag.solver.methods.doubt import (
    Volumes,
    candidates,
    doubt_findings,
    minutes_of,
    rms_um,
)
from stepdiag.solver.methods.estimate import estimate
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.model.layout import lay_out
from testkit.exact.surveys import Bench
from testkit.examples import spread

SEEDS = spread((201, 202), 2)


def longer(readings, setup, um_m):
    return replace(
        readings,
        reading_mm=readings.reading_mm
        * np.where(np.array(readings.setup) == setup, 1 + 1e-6 * um_m, 1.0),
    )


@pytest.mark.parametrize(
    ("setup", "um_m"), [("npp", 93.0), ("npp", -150.0), ("linear-y", 150.0)]
)
def test_what_a_scale_makes_of_the_volume_is_how_far_the_result_is_off(setup, um_m):
    for seed in SEEDS:
        readings = Bench(seed=seed).survey()
        wrong = longer(readings, setup, um_m)
        found = estimate(lay_out(wrong), "FXYZ").adjustment
        every = [
            one
            for one in candidates(found)
            if one.words.key == "suspect-scale" and one.words.arguments["setup"] == setup
        ]
        assert [one.words.arguments["scale_um_m"] for one in every] == [
            pytest.approx(um_m, abs=20.0)
        ]
        good, bad = solve(readings), solve(wrong)
        points = anywhere_mm(good.volume)
        off_um = without_rigid_motion(
            good.volume, points, error_field_um(bad, points) - error_field_um(good, points)
        )
        assert [rms_um(Volumes.of(found).apart_um(one)) for one in every] == [
            pytest.approx(float(np.sqrt(np.mean(np.sum(off_um**2, axis=1)))), rel=0.25)
        ]


def test_a_survey_of_another_scale_names_all_that_may_be_and_a_short_setup_that_separates_it(
    monkeypatch,
):
    """Where growth explains the length as well, the lengths alone contradict nothing."""
    monkeypatch.setattr(doubt, "scale_findings", lambda _found: [])
    for seed in SEEDS:
        (finding,) = doubt_findings(
            estimate(
                lay_out(longer(Bench(seed=seed).survey(), "npp", 40.0)), "FXYZ"
            ).adjustment
        )
        assert (finding.severity, finding.key) == ("warning", "contradiction-ambiguous.open")
        assert all(
            name in finding.text
            for name in ("ppp", "npp", "pnp", "ppn", "linear-x", "linear-y", "linear-z")
        )
        layout = lay_out(Bench(seed=seed).survey())
        minutes = {setup.name: minutes_of(layout, setup) for setup in layout.setups}
        # every explanation is about as probable: a run takes half the minutes of a diagonal
        assert str(finding.message.arguments["setup"]).startswith("linear-")
        assert (
            finding.message.arguments["minutes"]
            == minutes[finding.message.arguments["setup"]]
        )
        assert 20.0 < min(minutes.values()) < 30.0 < max(minutes.values()) < 60.0


def slowly(readings):
    """Return the readings with ten minutes more between two setups: then growth explains a length,
    too."""
    setups = list(dict.fromkeys(readings.setup))
    later_s = 600.0 * np.array([setups.index(name) for name in readings.setup])
    return replace(readings, time_s=readings.time_s + later_s)


def test_a_scale_that_compensation_would_put_into_the_machine_is_never_without_a_warning():
    """93 µm/m on one diagonal, the machine better than that: 0 of 8 silent, 0 of 8 good surveys in
    doubt; 0 of 2 in a usual run."""
    for seed in spread(range(300, 308), 4):
        readings = slowly(Bench(seed=seed, errors_times=0.7).survey())
        findings = [one.key for one in solve(longer(readings, "npp", 93.0)).findings]
        assert any(key.startswith("contradiction-ambiguous") for key in findings)
        assert doubt_findings(estimate(lay_out(readings), "FXYZ").adjustment) == []


def test_a_good_survey_is_in_no_doubt():
    assert (
        doubt_findings(estimate(lay_out(Bench(seed=201).survey()), "FXYZ").adjustment) == []
    )


def test_a_contradiction_of_lengths_beyond_chance_is_refused_once():
    found = estimate(
        lay_out(longer(Bench(seed=201).survey(), "npp", 150.0)), "FXYZ"
    ).adjustment
    assert doubt_findings(found) == []
    assert [each.key for each in scale_findings(found)] == [
        "contradiction-ambiguous.length-far"
    ]
