"""The published messages, made from the files in the survey's folder. Each message is a JSON object
with its own schema."""

import hashlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote

import msgspec

from stepdiag.base.errors import StepdiagError
from stepdiag.base.files import read_text
from stepdiag.base.result.members import Facts
from stepdiag.base.result.result import Result, parse_result
from stepdiag.daq.recording.rounds import round_folders
from stepdiag.daq.records.survey_folder import RESULT
from stepdiag.daq.service.live import LiveStatus, live_in
from stepdiag.daq.survey.models import Survey
from stepdiag.fleet.rows import rows_of

VERSION = 1
SCHEMA = "schema"


class _About(msgspec.Struct, frozen=True, kw_only=True):
    """The first members of every message after the name of its schema."""

    version: int = VERSION
    machine: str
    survey: str


class Online(_About, frozen=True, kw_only=True, tag_field=SCHEMA, tag="stepdiag-online"):
    """The message that shows whether the publishing program runs. The broker publishes "False" as
    the last will."""

    online: bool


class State(_About, frozen=True, kw_only=True, tag_field=SCHEMA, tag="stepdiag-state"):
    """The progress of the survey. The links have the states of the daemon's journal, and are empty
    without a daemon. ``damage`` is the reason why the last result is unreadable, otherwise empty.
    """

    round: str
    recording: bool
    complete: bool
    waits_for: str
    message: str
    laser: str
    plc: str
    damage: str = ""


class Finding(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A finding, with the members of a finding in a result (docs/findings.md)."""

    code: str
    severity: Literal["info", "warning", "error"]
    text: str
    setup: str = ""
    pass_number: int | None = None
    stop: int | None = None
    size_um: float | None = None


class Findings(_About, frozen=True, kw_only=True, tag_field=SCHEMA, tag="stepdiag-findings"):
    """The findings about the data of the last result."""

    round: str
    findings: tuple[Finding, ...]


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """A number of a result, with the columns of the archive (docs/fleet.md)."""

    quantity: str
    axis: str
    position_mm: float | None
    value: float
    u: float | None
    unit: str
    k: int


class Judged(msgspec.Struct, frozen=True, kw_only=True):
    """A figure and its tolerance, with the members of the result (docs/uncertainty.md)."""

    quantity: str
    unit: str
    tolerance: float
    value: float | None
    low: float | None
    high: float | None
    probability: float | None
    verdict: Literal["conform", "not_conform", "not_decidable"]


class ResultMessage(
    _About, frozen=True, kw_only=True, tag_field=SCHEMA, tag="stepdiag-result"
):
    """The numbers of the last result; ``sha256`` is the hash of the result's file."""

    round: str
    begun: str
    ended: str
    method: str
    software: str
    sha256: str
    rows: tuple[Row, ...]
    conformity: tuple[Judged, ...] = ()
    """The verdicts about every value with a tolerance, as found; empty without a tolerance."""


Message = Online | State | Findings | ResultMessage
MESSAGES: tuple[type[Message], ...] = (Online, State, Findings, ResultMessage)


def schemas() -> dict[str, Any]:
    return {_name_of(kind): msgspec.json.schema(kind) for kind in MESSAGES}


def topic_of(message: Message | type[Message], survey: Survey, prefix: str) -> str:
    """Return the topic of a message: PREFIX/MACHINE/SURVEY/WHAT. Names are percent-encoded, because
    ``/``, ``+`` and ``#`` separate topics."""
    what = _name_of(message if isinstance(message, type) else type(message)).removeprefix(
        "stepdiag-"
    )
    return "/".join(
        (
            prefix,
            quote(survey.identity.machine, safe=" "),
            quote(survey.identity.name, safe=" "),
            what,
        )
    )


class Watched:
    """The folder of a survey and its present messages. A result is read again only after its file
    has changed."""

    def __init__(self, survey: Survey, folder: Path) -> None:
        self._survey, self.folder = survey, folder
        self._machine, self._name = survey.identity.machine, survey.identity.name
        self._read: dict[Path, tuple[tuple[int, int], tuple[Findings, ResultMessage]]] = {}

    @property
    def name(self) -> str:
        return self._name

    def online(self, *, online: bool) -> Online:
        return Online(online=online, machine=self._machine, survey=self._name)

    def now(self) -> tuple[Message, ...]:
        """Return the messages with the state, the findings and the result. If the result is
        unreadable, return only the state, which contains the reason."""
        last, published, damage, complete, live = None, None, "", False, None
        try:
            live = live_in(
                self.folder
                # A test of the lock could take the lock from a daemon that starts at this moment.
            )
            rounds = round_folders(self.folder)
            last = rounds[-1] if rounds else None
            complete = (
                last is not None and (last / RESULT).is_file()
            )  # a result that arrives during this function is published the next time
            published = self._published_of(last) if last is not None and complete else None
        except (
            StepdiagError,
            OSError,
        ) as error:  # an incompletely copied file, or a share that is not available
            damage = str(error)
        return (self._state(last, live, damage, complete=complete), *(published or ()))

    def history(self) -> Iterator[tuple[Findings, ResultMessage]]:
        """Yield findings and result of every round, oldest first; a round with an unreadable result
        is left out."""
        rounds: list[Path] = []
        with suppress(OSError):
            rounds = round_folders(self.folder)
        for each in rounds:
            with suppress(StepdiagError, OSError):
                if (published := self._published_of(each)) is not None:
                    yield published

    def _state(
        self, last: Path | None, live: LiveStatus | None, damage: str, *, complete: bool
    ) -> State:
        return State(
            machine=self._machine,
            survey=self._name,
            round=last.name if last is not None else "",
            recording=live is not None,
            complete=complete,
            waits_for=str(live.waits_for) if live is not None else "",
            message=str(live.message) if live is not None else "",
            laser=live.laser.state if live is not None else "",
            plc=live.plc.state if live is not None else "",
            damage=damage,
        )

    def _published_of(self, round_: Path) -> tuple[Findings, ResultMessage] | None:
        path = round_ / RESULT
        if not path.is_file():
            return None
        stat = path.stat()
        seen = (stat.st_mtime_ns, stat.st_size)
        known = self._read.get(path)
        if known is None or known[0] != seen:
            name = f"{round_.name}/{RESULT}"
            text = read_text(path)
            known = (
                seen,
                self._messages(
                    parse_result(text, name),
                    hashlib.sha256(text.encode("utf-8")).hexdigest(),
                    round_.name,
                ),
            )
            self._read[path] = known
        return known[1]

    def _messages(
        self, result: Result, digest: str, round_: str
    ) -> tuple[Findings, ResultMessage]:
        facts = result.survey or Facts()
        findings = tuple(msgspec.convert(asdict(each), Finding) for each in result.findings)
        rows = tuple(msgspec.convert(asdict(row), Row) for row in rows_of(result))
        judged = () if result.conformity is None else result.conformity.as_found
        published = ResultMessage(
            machine=self._machine,
            survey=self._name,
            round=round_,
            begun=facts.begun,
            ended=facts.ended,
            method=result.method,
            software=result.software.version,
            sha256=digest,
            rows=rows,
            conformity=tuple(msgspec.convert(asdict(one), Judged) for one in judged),
        )
        return Findings(
            machine=self._machine, survey=self._name, round=round_, findings=findings
        ), published


def _name_of(kind: type[Message]) -> str:
    return str(kind.__struct_config__.tag)
