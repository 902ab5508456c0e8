"""Conclusion and report of a complete survey, written beside the logs."""

from pathlib import Path

from stepdiag.base.files import write_once
from stepdiag.base.readings.readings import parse_readings
from stepdiag.completion.completion import Completed
from stepdiag.conclusion import Conclusion, Export, conclude, conclusion_json, export_of
from stepdiag.daq.records.survey_folder import CONCLUSION, READINGS, RESULT
from stepdiag.report.document import build_report
from stepdiag.report.drawings.figures import field_of
from stepdiag.report.exported import exported_of
from stepdiag.report.output import write_report


def write_completed_report(done: Completed) -> Path:
    """Write conclusion and report of a completed survey, with its readings and all exports; return
    the path of the report."""
    readings = parse_readings((done.folder / READINGS).read_text(encoding="utf-8"), READINGS)
    exported = [exported_of(each) for each in done.exports]
    conclusion = concluded(done)
    correction = next(
        (one.correction for one in exported if one.correction is not None), None
    )
    write_once(
        done.folder / CONCLUSION,
        conclusion_json(conclusion, field_of(done.result, correction)),
    )
    report = build_report(
        done.result,
        source=RESULT,
        exported=exported,
        readings=readings,
        conclusion=conclusion,
        language=done.language,
    )
    return write_report(report, done.folder / "report.html")[0]


def concluded(done: Completed) -> Conclusion:
    """Return the conclusion of a completed survey; written exports come before refused exports."""
    exports = [export_of(each) for each in done.exports]
    exports += [Export(controller=name, refused=why) for name, why in done.refusals.items()]
    return conclude(done.result, exports)
