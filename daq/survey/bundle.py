"""The files that a survey file uses, stored with its logs: profiles, tables of profiles, angles,
and the head's calibration.

A replay must not depend on files that were changed after the recording, so the log contains these
files.
"""

import base64
from collections.abc import Mapping
from pathlib import Path

from stepdiag.base.compensation import Statement, stated
from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.files import LARGEST_TABLE_BYTES, as_text, read_bytes
from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import message
from stepdiag.base.settings import read_toml
from stepdiag.daq.survey.models import Survey

PREFIX = "file:"
"""Prefix of the entries for files in ``stepdiag.run`` of a log."""
MAX_BUNDLE_BYTES = 32_000_000
"""Largest size in bytes of all files together: in base64 the files must fit into one record of a
log (`daq.log.reader`).
"""


def read_bundle(survey_file: Path, survey: Survey) -> dict[str, bytes]:
    """Return the files that a survey uses, by name; a table of a profile has the name
    ``profile//table``.

    Raises UsageError for a file that is unreadable or too large.
    """
    here = survey_file.parent
    profiles = [export.profile for export in survey.exports]
    names = [survey.solver.angles]
    if survey.proof is not None:
        profiles += [survey.proof.profile] if survey.proof.profile else []
        names += [survey.proof.result, survey.proof.readings]
    names += profiles
    names += [
        survey.head.calibration if survey.head is not None else "",
        *survey.machine.active,
    ]
    bundle = {
        name: _read_bounded(here / name, survey_file.name)
        for name in dict.fromkeys(names)
        if name
    }
    _refuse_too_much(bundle, survey_file.name)
    for profile in profiles:
        for table in _tables_of(bundle[profile]):
            bundle[f"{profile}//{table}"] = _read_bounded(
                (here / profile).parent / table, profile
            )
            _refuse_too_much(bundle, survey_file.name)
    return bundle


def tables_for(bundle: Mapping[str, bytes], profile: str) -> dict[str, bytes]:
    prefix = f"{profile}//"
    return {
        name.removeprefix(prefix): data
        for name, data in bundle.items()
        if name.startswith(prefix)
    }


def compensation_of(survey: Survey, bundle: Mapping[str, bytes]) -> Statement:
    """Return the survey's statement about the compensation during the measurement, with the hashes
    of the active files in ``bundle``.

    Raises DataError for a bundle without a file of the survey.
    """
    machine = survey.machine
    return stated(
        machine.compensation,
        active_in(survey, bundle),
        machine.active_date,
        machine.active_source,
    )


def active_in(survey: Survey, bundle: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the files that were active during the measurement, by name. Raises DataError for a
    bundle without a file of the survey.
    """
    missing = [name for name in survey.machine.active if name not in bundle]
    if missing:
        raise DataError(
            missing[0], expected=message("named-in-log"), found=message("nothing")
        )
    return {name: bundle[name] for name in survey.machine.active}


def compensation_findings(survey: Survey) -> tuple[Finding, ...]:
    """Return the finding ``compensation-unanswered`` if the survey file contains no statement about
    the active compensation of the control.
    """
    if survey.machine.compensation in ("off", "on"):
        return ()
    text = message("compensation-unanswered")
    return (finding("warning", text),)


def bundle_to_run(bundle: Mapping[str, bytes]) -> dict[str, str]:
    return {
        f"{PREFIX}{name}": base64.b64encode(data).decode("ascii")
        for name, data in bundle.items()
    }


def bundle_from_run(run: Mapping[str, str], source: str) -> dict[str, bytes]:
    """Return the bundle from a log's metadata. Raises DataError for a damaged entry."""
    try:
        found = {
            key.removeprefix(PREFIX): base64.b64decode(text, validate=True)
            for key, text in run.items()
            if key.startswith(PREFIX)
        }
    except ValueError as error:  # binascii.Error, or characters outside base64
        raise DataError(
            source, expected=message("survey-s-files-base64"), found=str(error)
        ) from error
    large = [name for name, data in found.items() if len(data) > LARGEST_TABLE_BYTES]
    if large:
        raise DataError(
            f"{source}: {large[0]}",
            expected=message("at-most-bytes", largest_table_bytes=LARGEST_TABLE_BYTES),
            found=message("found-more"),
        )
    return found


def _tables_of(profile: bytes) -> list[str]:
    """Return the names of the tables in a profile; empty for a profile that is not TOML, which a
    later check refuses with the wrong line.
    """
    try:
        machine = read_toml(as_text(profile, "profile", UsageError), "profile").get(
            "machine", {}
        )
    except UsageError:
        return []
    named = machine.get("existing", []) if isinstance(machine, dict) else []
    return (
        [name for name in named if isinstance(name, str)] if isinstance(named, list) else []
    )


def _refuse_too_much(bundle: Mapping[str, bytes], source: str) -> None:
    size = sum(map(len, bundle.values()))
    if size > MAX_BUNDLE_BYTES:
        raise UsageError(
            source,
            expected=message("at-most-bytes-all", max_bundle_bytes=MAX_BUNDLE_BYTES),
            found=str(size),
        )


def _read_bounded(path: Path, source: str) -> bytes:
    return read_bytes(
        path,
        source,
        largest=LARGEST_TABLE_BYTES,
        expected=message("readable-file-of", name=path.name),
        blame=UsageError,
    )


def run_record(survey: Survey, survey_file: Path) -> dict[str, str]:
    """Return the entries of ``stepdiag.run`` that are equal in every log of a survey: whether a
    compensation is active, and the survey's files.
    """
    bundle = read_bundle(survey_file, survey)
    return {"compensation": compensation_of(survey, bundle).words(), **bundle_to_run(bundle)}
