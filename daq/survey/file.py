"""The survey file (TOML): all settings of a survey, read once and never changed.

The sections are structs of `daq.survey.models`; `daq.survey.template.template` is the commented
file.
"""

from pathlib import Path

from stepdiag.base.errors import UsageError
from stepdiag.base.files import LARGEST_SETTINGS_BYTES, as_text, read_bytes
from stepdiag.base.messages import message
from stepdiag.base.settings import convert, read_toml
from stepdiag.daq.survey.formats import head_decoder, laser_decoder
from stepdiag.daq.survey.head_file import parse_head_file, require_owner
from stepdiag.daq.survey.models import StopRules, Survey
from stepdiag.daq.survey.rules import check

__all__ = [
    "StopRules",
    "Survey",
    "head_decoder",
    "laser_decoder",
    "load_survey",
    "parse_survey",
]


def load_survey(path: Path) -> Survey:
    """Return the survey of a file.

    Raises UsageError if the file is unreadable, is not TOML in UTF-8, breaks a rule, or requires a
    missing file. Raises DataError if the calibration file belongs to another head.
    """
    survey = parse_survey(read_text(path), str(path.name))
    if survey.page.token:
        raise UsageError(
            f"{path.name}: page.token",
            expected=message("no-secret-every-log"),
            found=message("a-token"),
            remedy=message("write-another-one-into"),
        )
    for field, name in _named_files(survey):
        if not (path.parent / name).is_file():
            found = message("no-file-beside", name=name, name_2=path.name)
            raise UsageError(
                f"{path.name}: {field}",
                expected=message("file-exists"),
                found=found,
                remedy=message("paths-are-seen-from"),
            )
    if survey.head is not None and survey.head.calibration:
        name = survey.head.calibration
        data = read_bytes(
            path.parent / name, name, largest=LARGEST_SETTINGS_BYTES, blame=UsageError
        )
        require_owner(parse_head_file(data, name), survey.head, name)
    return survey


def parse_survey(text: str, source: str) -> Survey:
    """Return the survey of ``text``; messages of UsageError contain ``source``."""
    survey = convert(read_toml(text, source), Survey, source)
    check(survey, source)
    return survey


def read_text(path: Path) -> str:
    """Return the unchanged text of a survey file."""
    remedy = message("init-writes-one")
    data = read_bytes(
        path,
        largest=LARGEST_SETTINGS_BYTES,
        expected=message("a-survey-file"),
        remedy=remedy,
        blame=UsageError,
    )
    return as_text(data, str(path), UsageError)


def _named_files(survey: Survey) -> list[tuple[str, str]]:
    named = [
        (f"export[{index}].profile", export.profile)
        for index, export in enumerate(survey.exports)
    ]
    named.append(("solver.angles", survey.solver.angles))
    if survey.proof is not None:
        named += [
            (f"proof.{field}", getattr(survey.proof, field))
            for field in ("result", "readings", "profile")
        ]
    named += [
        (f"machine.active[{index}]", name) for index, name in enumerate(survey.machine.active)
    ]
    if survey.head is not None:
        named.append(("head.calibration", survey.head.calibration))
    return [(field, name) for field, name in named if name]
