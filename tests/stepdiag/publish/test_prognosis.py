"""A day of leaving from the rounds of a survey: a machine that drifts by 1 µm a year, held against
the truth."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

from stepdiag.publish.prognosis import leavings
from testkit.fleets import FIRST, QUARTER, write_rounds

YEAR = timedelta(days=365.25)
NOW = datetime(2027, 6, 1, tzinfo=UTC)


def test_a_drift_has_its_day(tmp_path: Path) -> None:
    """From 5 µrad by 1 a year: 10 after five years."""
    write_rounds(
        tmp_path, [5.0 + number * (QUARTER / YEAR) for number in range(12)], tolerance=10.0
    )
    (found,) = leavings(tmp_path, NOW)
    assert found.series.quantity == "C0Y"
    assert found.leaving is not None
    assert found.leaving.likely is not None
    assert abs(found.leaving.likely - (FIRST + 5 * YEAR)) < timedelta(days=30)


def test_no_drift_and_no_tolerance_have_none(tmp_path: Path) -> None:
    write_rounds(tmp_path / "still", [5.0, 5.1, 4.9, 5.0, 5.1, 4.9, 5.0], tolerance=10.0)
    assert leavings(tmp_path / "still", NOW) == []
    write_rounds(tmp_path / "free", [5.0 + number for number in range(7)], tolerance=None)
    assert leavings(tmp_path / "free", NOW) == []
    assert leavings(tmp_path / "nowhere", NOW) == []
