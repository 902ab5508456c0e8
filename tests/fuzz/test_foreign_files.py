"""Whatever somebody else hands over, the worst that happens is a refusal: good files changed, cut,
doubled, or nothing but noise."""

import os

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from testkit.hostile.changes import CHANGES, changed
from testkit.hostile.foreign import targets

TARGETS = targets()
EXAMPLES = int(os.environ.get("STEPDIAG_FUZZ_EXAMPLES", "20"))
"""For each target; docs/security.md says how an hour is spent."""


@pytest.mark.parametrize("name", TARGETS)
def test_a_changed_file_is_read_or_refused(name):
    seed, target, weight = TARGETS[name]
    target(seed)

    @settings(
        max_examples=max(10, int(EXAMPLES * weight)), suppress_health_check=list(HealthCheck)
    )
    @given(CHANGES)
    def run(changes):
        target(changed(seed, changes))

    run()


@pytest.mark.parametrize("name", TARGETS)
def test_noise_is_read_or_refused(name):
    target = TARGETS[name].read

    @settings(max_examples=EXAMPLES // 3, suppress_health_check=list(HealthCheck))
    @given(st.binary(max_size=400))
    def run(data):
        target(data)

    run()
