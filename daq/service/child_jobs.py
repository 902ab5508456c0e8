"""Child processes of the daemon, which solve and export a survey or pack finished surveys."""

import asyncio
import time
from collections.abc import Callable, Coroutine, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import msgspec
import structlog

from stepdiag.base.findings import PROOF, Severity
from stepdiag.base.messages import Words, of_log
from stepdiag.daq.records.status import AheadStatus, Phase
from stepdiag.daq.records.survey_folder import RESULT
from stepdiag.daq.service.ahead import ahead_in
from stepdiag.daq.service.metrics import Tally

READINGS_ONLY, CERTIFICATE_ONLY, TAKE = "--readings", "--certificate", "--take"
_log = structlog.get_logger("daemon")


@dataclass(frozen=True, slots=True, kw_only=True)
class Commands:
    """The commands of the child processes. ``completion`` gets the folder of a finished survey;
    ``archiving`` gets the folder with all rounds of the survey, and the folder's limit in GB (0:
    none).

    ``ahead`` computes the next passes after each setup; ``ahead`` with `TAKE` adds the further
    setup that the operator selected. With `READINGS_ONLY` before the folder, ``completion`` writes
    only the readings of an open survey; with `CERTIFICATE_ONLY`, only the certificate of a finished
    survey.
    """

    completion: Sequence[str]
    archiving: Sequence[str] = ()
    ahead: Sequence[str] = ()
    max_gb: float = 0.0


class Finisher:
    """Runs the child processes and stores the outcome of the last one.

    ``on_done`` is called after each attempt to solve a survey, with the survey's folder and whether
    there is a result.
    """

    def __init__(
        self, commands: Commands, tally: Tally, on_done: Callable[[Path, bool], None]
    ) -> None:
        self._commands = commands
        self._tally = tally
        self._on_done = on_done
        self._children: set[asyncio.Task[None]] = set()
        self._one = asyncio.Lock()
        self._recorder_idle = asyncio.Event()
        self._recorder_idle.set()
        self.phase: Phase = "starting"
        self.message: Words = ""
        self.result: Path | None = None
        self.proof: Severity | None = None
        self.ahead = AheadStatus()
        self._looking: asyncio.Task[None] | None = None

    def recorder_is(self, *, idle: bool) -> None:
        """Record whether the recorder is idle. While the recorder is idle, the last log is closed
        and can be read.
        """
        if idle:
            self._recorder_idle.set()
        else:
            self._recorder_idle.clear()

    def finish(self, folder: Path) -> None:
        self._begin(self._finish(folder), f"completion {folder.name}")
        if self._looking is not None:
            # The new result contains the next passes, too, and must not wait for this computation.
            self._looking.cancel()
        self.phase, self.message = "solving", ""

    def tabulate(self, folder: Path, then: Callable[[], None]) -> None:
        """Begin to write the readings of an open survey; ``then`` is called at the end, also after
        a failure.
        """
        self._begin(self._tabulate(folder, then), f"readings {folder.name}")

    def certify(self, folder: Path, then: Callable[[], None]) -> None:
        """Begin to write the certificate of a finished survey; ``then`` is called at the end, also
        after a failure.
        """
        self._begin(self._certify(folder, then), f"certificate {folder.name}")

    def look_ahead(self, folder: Path, then: Callable[[], None]) -> None:
        """Begin to compute the next passes of a survey; ``then`` is called at the end, also after a
        failure.
        """
        if self._commands.ahead:
            self._looking = self._begin(
                self._look_ahead(folder, then), f"ahead {folder.name}"
            )

    def take(self, then: Callable[[], None]) -> None:
        """Begin to add the further setup to the survey file; ``then`` is called at the end, also
        after a failure.
        """
        self._begin(self._take(then), "take")

    def forget(self) -> None:
        """Stop showing the result, because the survey continues or another survey is being
        recorded.
        """
        self.result = self.proof = None
        self.message = ""

    async def close(self) -> None:
        for child in self._children:
            child.cancel()
        await asyncio.gather(*self._children, return_exceptions=True)

    def _begin(self, work: Coroutine[None, None, None], name: str) -> asyncio.Task[None]:
        task = asyncio.create_task(work, name=name)
        self._children.add(task)
        task.add_done_callback(self._children.discard)
        return task

    async def _run(self, *command: str) -> tuple[int, Words]:
        """Run a child process; return its exit code and its last message. Only one child runs at a
        time, because two would write the same readings.
        """
        async with self._one:
            child = await asyncio.create_subprocess_exec(
                *command, stdin=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.PIPE
            )
            written = (await _last_words(child)).decode("utf-8", "replace").strip()
        return child.returncode or 0, _of_line(written.splitlines()[-1] if written else "")

    async def _tabulate(self, folder: Path, then: Callable[[], None]) -> None:
        await self._recorder_idle.wait()
        code, reason = await self._run(*self._commands.completion, READINGS_ONLY, str(folder))
        if code:
            _log.error(
                "readings-unwritten", folder=str(folder), exit_code=code, reason=str(reason)
            )
        then()

    async def _certify(self, folder: Path, then: Callable[[], None]) -> None:
        code, self.message = await self._run(
            *self._commands.completion, CERTIFICATE_ONLY, str(folder)
        )
        if code:
            _log.error(
                "certificate-unwritten",
                folder=str(folder),
                exit_code=code,
                reason=str(self.message),
            )
        then()

    async def _look_ahead(self, folder: Path, then: Callable[[], None]) -> None:
        await self._recorder_idle.wait()
        code, reason = await self._run(*self._commands.ahead)
        if code:
            _log.warning(
                "ahead-unknown", folder=str(folder), exit_code=code, reason=str(reason)
            )
        self.ahead = AheadStatus() if code else ahead_in(folder)
        if self.ahead.words:
            _log.info(
                "ahead",
                what=str(self.ahead.words),
                setup=self.ahead.setup,
                further=self.ahead.further,
            )
        then()

    async def _take(self, then: Callable[[], None]) -> None:
        code, self.message = await self._run(*self._commands.ahead, TAKE)
        self.ahead = self.ahead if code else AheadStatus()
        _log.info("taken", exit_code=code, reason=str(self.message))
        then()

    async def _finish(self, folder: Path) -> None:
        await self._recorder_idle.wait()
        began_s = time.monotonic()
        code, self.message = await self._run(*self._commands.completion, str(folder))
        self.phase = "complete" if code == 0 else "failed"
        self.result = folder / RESULT if (folder / RESULT).exists() else None
        self.proof = None if self.result is None else proof_in(self.result)
        self._tally.solve_s = time.monotonic() - began_s
        self._tally.surveys[code] += 1
        if code == 0:
            _log.info(
                "survey-complete", folder=str(folder), exit_code=0, message=str(self.message)
            )
        else:
            _log.error(
                "survey-open", folder=str(folder), exit_code=code, reason=str(self.message)
            )
        self._on_done(folder, code == 0)
        await self._keep_budget(folder.parent)

    async def _keep_budget(self, folder: Path) -> None:
        if self._commands.archiving and self._commands.max_gb:
            child = await asyncio.create_subprocess_exec(
                *self._commands.archiving,
                str(folder),
                f"{self._commands.max_gb:g}",
                stdin=asyncio.subprocess.DEVNULL,
            )
            await _last_words(child)


class _Finding(msgspec.Struct):
    code: str
    severity: Severity


class _Found(msgspec.Struct):
    findings: list[_Finding] = []


def proof_in(result: Path) -> Severity | None:
    """Return the severity of the verdict in the result of a proof run; None for any other
    result.
    """
    found = msgspec.json.decode(result.read_bytes(), type=_Found).findings
    return next((each.severity for each in found if each.code == PROOF), None)


def _of_line(line: str) -> Words:
    try:
        return of_log(line, line)
    except ValueError:
        return line


async def _last_words(child: asyncio.subprocess.Process) -> bytes:
    try:
        _, written = await child.communicate()
    except asyncio.CancelledError:
        with suppress(ProcessLookupError):
            child.terminate()
        await child.wait()
        raise
    return written or b""
