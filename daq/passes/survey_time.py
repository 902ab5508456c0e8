"""The date and time of a survey, from the computer's clock, or from the operator if the clock was
never set.
"""

from collections.abc import Iterator
from datetime import UTC, datetime

from stepdiag.base.findings import Finding, info, warning
from stepdiag.daq.passes.pass_book import PassBook

CODE = "clock-unset"
BUILT = datetime(2026, 11, 22, tzinfo=UTC)
"""The day of the first release. No log is older, so a clock with an earlier day was never set, or
has lost its time (1970, 2000, the day of the image). Later releases keep this day, so that the date
of older logs does not change.
"""


def span_s(book: PassBook) -> tuple[float, float]:
    """Return the times of capture of the first and the last used stop, in seconds since 1970.
    Raises ValueError for a book without stops.
    """
    times = [stop.time_s for each in book.passes for stop in each.chosen().values()]
    begun_s = min(times) if book.time_stated is None else book.time_stated.begun_s
    return begun_s, begun_s + max(times) - min(times)


def clock_findings(book: PassBook, now_s: float | None = None) -> Iterator[Finding]:
    """Yield the finding of a clock that was never set, as a warning until the operator enters the
    time. ``now_s`` is the time of the clock for a survey without a stop.
    """
    times = [stop.time_s for each in book.passes for stop in each.chosen().values()] or (
        [] if now_s is None else [now_s]
    )
    if not times or min(times) >= BUILT.timestamp():
        return
    stated = book.time_stated
    day = datetime.fromtimestamp(min(times), UTC).date()
    if stated is None:
        yield warning("clock-unset", day=str(day))
        return
    moment = datetime.fromtimestamp(stated.begun_s, UTC).isoformat(timespec="minutes")
    yield info(
        "clock-unset.stated",
        day=str(day),
        time=moment,
        name=stated.name,
        reason=stated.reason,
    )
