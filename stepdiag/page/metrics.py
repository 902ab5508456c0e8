"""The counters and measures of the daemon for Prometheus, computed on request."""

from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping

from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from stepdiag.base.errors import DeviceError
from stepdiag.daq.service.metrics import Figures
from stepdiag.terminal.exits import EXIT_CODES
from stepdiag.texts.explained import explanations

LINK_STATES = ("connecting", "connected", "silent", "lost")


def create_metrics(figures: Callable[[], Awaitable[Figures]]) -> Starlette:
    """Return the application that answers only ``GET /metrics``."""

    async def metrics(_: Request) -> Response:
        try:
            registry = CollectorRegistry(auto_describe=False)
            registry.register(_Daemon(await figures()))
        except DeviceError as why:
            return PlainTextResponse(str(why), status_code=503)
        return Response(
            generate_latest(registry), headers={"Content-Type": CONTENT_TYPE_LATEST}
        )

    return Starlette(routes=[Route("/metrics", metrics)])


class _Daemon(Collector):
    def __init__(self, figures: Figures) -> None:
        self._figures = figures

    def collect(self) -> Iterator[Metric]:
        now = self._figures
        yield from _counted(now)
        yield from _links(now)
        yield from _health(now)


def _counted(now: Figures) -> Iterator[Metric]:
    yield CounterMetricFamily(
        "stepdiag_samples", "Laser samples recorded.", value=now.samples
    )
    yield CounterMetricFamily("stepdiag_stops", "Stops captured.", value=now.tally.stops)
    yield CounterMetricFamily(
        "stepdiag_lost_events", "Events that could not be recorded.", value=now.lost_events
    )
    yield _labelled(
        "findings",
        "Findings while recording, by code.",
        "code",
        explanations(),
        now.tally.findings,
    )
    known = map(str, (0, *EXIT_CODES.values()))
    ended = {str(exit_code): count for exit_code, count in now.tally.surveys.items()}
    yield _labelled(
        "surveys",
        "Surveys handed to the solver, by its exit code.",
        "exit_code",
        known,
        ended,
    )


def _labelled(
    name: str, text: str, label: str, known: Iterable[str], counted: Mapping[str, int]
) -> Metric:
    """Return a counter with every known label, initially 0: a series that begins at 1 has no
    increase in Prometheus."""
    family = CounterMetricFamily(f"stepdiag_{name}", text, labels=[label])
    for value, count in sorted((dict.fromkeys(known, 0) | dict(counted)).items()):
        family.add_metric([value], count)
    return family


def _links(now: Figures) -> Iterator[Metric]:
    states = GaugeMetricFamily(
        "stepdiag_link_state", "1 for the state that a link is in.", labels=["link", "state"]
    )
    ages = GaugeMetricFamily(
        "stepdiag_link_age_seconds", "Time since a link last gave anything.", labels=["link"]
    )
    for name, link in now.links.items():
        for state in LINK_STATES:
            states.add_metric([name, state], float(link.state == state))
        if link.age_s is not None:
            ages.add_metric([name], link.age_s)
    yield states
    yield ages


def _health(now: Figures) -> Iterator[Metric]:
    gauges = {
        "recording": ("1 while a log is open.", float(now.recording)),
        "recorder_blocked": ("1 while the disk refuses.", float(now.recorder_blocked)),
        "backlog_bytes": ("What waits for the disk.", float(now.backlog_bytes)),
        "disk_free_bytes": ("Space left where the logs go.", float(now.disk_free_bytes)),
        "watchdog_age_seconds": (
            "Time since every worker was last seen alive.",
            now.watchdog_age_s,
        ),
    }
    if now.tally.solve_s is not None:
        gauges["solve_seconds"] = (
            "How long the last finished survey took to solve and export.",
            now.tally.solve_s,
        )
    for name, (text, value) in gauges.items():
        yield GaugeMetricFamily(f"stepdiag_{name}", text, value=value)
