"""The report that stands beside the logs of a survey once it is complete."""

from pathlib import Path

from stepdiag.daq.recording.rounds import READINGS, RESULT
from stepdiag.daq.service.completion import Completed
from stepdiag.report.document import build_report
from stepdiag.report.exported import exported_of
from stepdiag.report.output import write_report
from stepdiag.solver.readings.readings import parse_readings


def write_completed_report(done: Completed) -> Path:
    """Write ``report.html`` of a completed survey with its readings and all that was exported, and return its path."""
    readings = parse_readings((done.folder / READINGS).read_text(encoding="utf-8"), READINGS)
    exported = [exported_of(each) for each in done.exports]
    report = build_report(done.result, source=RESULT, exported=exported, readings=readings)
    return write_report(report, done.folder / "report.html")[0]
