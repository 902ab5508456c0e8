"""The figures for Prometheus, asked for while a real daemon records."""

import urllib.error
import urllib.request

import pytest
from prometheus_client.parser import text_string_to_metric_families

from stepdiag.virtual.base.reserved import reserved_port
from testkit.running.hall import daemon, hall, until

pytestmark = pytest.mark.system


def scrape(port):
    """Return every sample: (name, labels as text) -> value."""
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=60) as answer:
        families = list(text_string_to_metric_families(answer.read().decode()))
    return {
        (sample.name, *sample.labels.values()): sample.value
        for family in families
        for sample in family.samples
    }


@pytest.mark.impatient
def test_the_figures_follow_the_survey(tmp_path):
    """The end of a pass is said after its last stop, so what is asked for then counts all of
    them."""
    port = reserved_port()
    with hall(tmp_path, setups=("linear-x", "ppp")) as place:
        place.survey.write_text(
            f"{place.survey.read_text()}\n[metrics]\nenabled = true\nport = {port}\n"
        )
        with daemon(place.survey) as process:
            before = scrape(port)
            assert before["stepdiag_stops_total",] == 0
            assert before["stepdiag_link_state", "machine", "connected"] == 1
            place.start_setups(stop_after=1)
            until(process, "pass-ended", kind="complete")
            after = scrape(port)
            with pytest.raises(urllib.error.HTTPError):
                urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=60)
    assert after["stepdiag_stops_total",] == 3
    assert after["stepdiag_samples_total",] > 100
    assert after["stepdiag_lost_events_total",] == 0
    assert after["stepdiag_link_age_seconds", "laser"] < 10
    assert after["stepdiag_watchdog_age_seconds",] < 10
    assert after["stepdiag_disk_free_bytes",] > 0
