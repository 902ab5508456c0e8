"""The report of a certificate, rendered again from its sources and compared byte by byte."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from stepdiag.base.errors import StepdiagError
from stepdiag.base.files import as_text, read_bytes
from stepdiag.report.from_files import ReportFiles, report_from
from stepdiag.texts.texts import LANGUAGES, Language

_LANGUAGE = re.compile(r'\A<!doctype html>\s*<html lang="(\w+)">')


ROLES = {
    "profile": "profile",
    "left": "result_as_left",
    "letterhead": "letterhead",
    "laboratory": "laboratory",
}
"""Names of a report's sources, each with its role in the certificate."""


def is_rendered(name: str) -> bool:
    """Return whether a report must be rendered again for the verification. A PDF is verified by its
    hash alone."""
    return Path(name).suffix.lower() != ".pdf"


def follows(
    report: Path, of: Mapping[str, Path], files: Sequence[Path], readings: Path | None
) -> bool:
    """Return whether a report follows from its sources, with or without the exports and readings.

    ``of`` contains files by their roles: the result, the result after loading, the laboratory's
    file, the letterhead and the profile.
    """
    text = as_text(read_bytes(report), report.name)
    language = language_of(text)
    named = {name: of.get(role) for name, role in ROLES.items()}
    for exported in dict.fromkeys((tuple(files), ())):
        for shown in dict.fromkeys((readings, None)):
            sources = ReportFiles(
                result=of["result"],
                files=exported,
                readings=shown,
                language=language,
                **named,
            )
            try:
                if report_from(sources).html == text:
                    return True
            except StepdiagError:
                continue
    return False


def language_of(text: str) -> Language:
    found = _LANGUAGE.match(text)
    return next((one for one in LANGUAGES if found is not None and one == found[1]), "en")
