"""What Prometheus sees of a count: every label from the start, so that what happens once is an
increase."""

import time

from hypothesis import given
from hypothesis import strategies as st
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.parser import text_string_to_metric_families

from stepdiag.daq.service.metrics import Figures, Tally
from stepdiag.page.metrics import _Daemon
from stepdiag.texts.explained import explanations
from testkit.examples import few

CODES = sorted(explanations())


def scraped(tally: Tally) -> dict[tuple[str, ...], float]:
    """Return every sample: (name, labels) -> value."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(
        _Daemon(
            Figures(
                tally=tally,
                samples=0,
                links={},
                recording=False,
                recorder_blocked=False,
                backlog_bytes=0,
                lost_events=0,
                disk_free_bytes=1,
                watchdog_age_s=0.0,
            )
        )
    )
    families = text_string_to_metric_families(generate_latest(registry).decode())
    return {
        (sample.name, *sample.labels.values()): sample.value
        for family in families
        for sample in family.samples
    }


@few(20)
@given(
    st.lists(st.sampled_from(CODES), max_size=6),
    st.lists(st.sampled_from([0, 2, 3, 4, 5]), max_size=4),
)
def test_what_happens_once_is_an_increase_of_a_series_that_was_there(
    found: list[str], ended: list[int]
) -> None:
    tally = Tally(fed_s=time.monotonic())
    before = scraped(tally)
    for code in found:
        tally.findings[code] += 1
    for exit_code in ended:
        tally.surveys[exit_code] += 1
    after = scraped(tally)
    assert after.keys() == before.keys(), "no series begins at 1"
    assert {key for key in before if key[0] == "stepdiag_findings_total"} == {
        ("stepdiag_findings_total", code) for code in CODES
    }
    increase = {key: after[key] - before[key] for key in after if after[key] != before[key]}
    assert sum(increase.values()) == len(found) + len(ended)
    assert {key[1] for key in increase} == {*found, *map(str, ended)}
