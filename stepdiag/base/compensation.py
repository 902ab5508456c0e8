"""Which compensation was active in the control during the measurement, as stated in a survey or a
result."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import date
from typing import Literal

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.base.result.members import ActiveFile, Facts
from stepdiag.base.result.result import Result
from stepdiag.base.settings import UNANSWERED


@dataclass(frozen=True, slots=True, kw_only=True)
class Statement:
    """Whether a compensation was active during the measurement: ``state`` is None in a result
    without a survey, and ``"?"`` if the survey file leaves this question open."""

    state: Literal["off", "on", "?"] | None = None
    files: tuple[ActiveFile, ...] = ()

    def facts(self, facts: Facts | None = None) -> Facts:
        """Return ``facts`` (by default empty facts) with this statement added."""
        state = None if self.state == UNANSWERED else self.state
        return replace(facts or Facts(), compensation=state, active_files=self.files)

    def words(self) -> str:
        """Return this statement as one line for the journal and the report."""
        if self.state not in ("off", "on"):
            return "not stated"
        named = "; ".join(
            f"{file.name} sha256 {file.sha256} ({file.source}, {file.date})"
            for file in self.files
        )
        return f"{self.state}: {named}" if named else self.state


def stated(
    state: Literal["off", "on", "?"] | None,
    files: Mapping[str, bytes],
    day: date | None,
    source: str,
) -> Statement:
    """Return the statement that ``files`` were active. The files were read out on ``day``, in the
    way that ``source`` describes."""
    rows = tuple(
        ActiveFile(
            name=name,
            sha256=hashlib.sha256(data).hexdigest(),
            date="" if day is None else day.isoformat(),
            source=source,
        )
        for name, data in sorted(files.items())
    )
    return Statement(state=state, files=rows)


def stated_in(result: Result) -> Statement:
    """Return the statement in a result. Raises ``DataError`` for a damaged statement."""
    facts = result.survey
    if facts is None:
        return Statement()
    if facts.compensation is None:
        return Statement(state=UNANSWERED)
    if (facts.compensation == "on") != bool(facts.active_files):
        where, found = (
            f"{result.source}: survey.compensation",
            f"{facts.compensation!r} with {len(facts.active_files)} active_files",
        )
        raise DataError(where, expected=message("off-on-files"), found=found)
    return Statement(state=facts.compensation, files=facts.active_files)
