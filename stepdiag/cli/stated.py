"""Options with which a person states, after a survey, whether a compensation was active during the
measurement."""

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message

if TYPE_CHECKING:
    from stepdiag.base.result.result import Result

ActiveDate = Annotated[datetime | None, typer.Option(formats=["%Y-%m-%d"])]


def active_files(active: list[Path] | None) -> dict[str, bytes]:
    """Return the files that a person entered as active, by name."""
    from stepdiag.base.files import LARGEST_TABLE_BYTES, read_bytes

    return {path.name: read_bytes(path, largest=LARGEST_TABLE_BYTES) for path in active or []}


def with_compensation(
    result: "Result",
    state: str | None,
    files: dict[str, bytes],
    day: datetime | None,
    source: str,
) -> "Result":
    """Return the result with the operator's statement of active files, and the hashes of these
    files.

    Raises UsageError for an incomplete statement, or if the survey already contains a statement.
    """
    from dataclasses import replace

    from stepdiag.base.compensation import stated, stated_in

    if state is None:
        given = {
            "--active": ", ".join(files),
            "--active-date": "" if day is None else f"{day:%Y-%m-%d}",
            "--active-source": source,
        }
        for option, found in given.items():
            if found:
                raise UsageError(
                    option,
                    expected=message("with-option", option="--compensation on"),
                    found=found,
                )
        return result
    if state not in ("off", "on"):
        raise UsageError(
            "--compensation", expected=message("one-of", names=["off", "on"]), found=state
        )
    state_there = stated_in(result).state
    if state_there in ("off", "on"):
        raise UsageError(
            "--compensation",
            expected=message("stated-already", name=result.source, state=state_there),
            found=state,
        )
    if (state == "on") != bool(files):
        raise UsageError(
            "--active",
            expected=message("active-with-on"),
            found=message("number-of-files", count=len(files)),
        )
    if state == "off" and (day is not None or source):
        raise UsageError(
            "--active-date, --active-source",
            expected=message("without-option", option="--compensation off"),
            found=message("one-of-both"),
        )
    if state == "on" and (day is None or not source.strip()):
        raise UsageError(
            "--active-date, --active-source",
            expected=message("when-and-how"),
            found=message("nothing"),
        )
    statement = stated(state, files, None if day is None else day.date(), source)  # type: ignore[arg-type]  # checked above
    return replace(result, survey=statement.facts(result.survey))
