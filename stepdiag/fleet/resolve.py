"""Solving of every archived survey again with the present solver, one task per survey. The new
result is stored beside the old result.

The tasks run in processes of this computer, connected by pipes, or on the workers of a Dask
scheduler, connected by TLS with certificates on both sides: a scheduler runs any code of a client.
If a worker is lost, another worker takes its task. After an interruption, a new run solves only the
missing surveys. The same software gives the same bytes, so a run is also a self-test.
"""

import json
import multiprocessing
import os
import resource
import signal
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures import as_completed as completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Literal

from distributed import Client, KilledWorker, as_completed
from distributed.security import Security

from stepdiag.base.errors import DataError, DeviceError, StepdiagError, UsageError
from stepdiag.base.messages import Words, message
from stepdiag.base.result.members import software
from stepdiag.base.result.result import parse_result
from stepdiag.comparing.compare import compare
from stepdiag.completion.completion import complete
from stepdiag.daq.log.contents import open_log
from stepdiag.daq.recording.verdicts import WORDS
from stepdiag.daq.records.survey_folder import RESULT, logs_in
from stepdiag.daq.survey.file import parse_survey
from stepdiag.fleet.archive import put_table
from stepdiag.fleet.rows import about, rows_of
from stepdiag.fleet.store import Place, Store, sha256
from stepdiag.fleet.tables import table_of, to_parquet
from stepdiag.walls.confine import die_with_parent

IN_FLIGHT = 200
"""Largest number of surveys in the scheduler, which limits its memory for a store of any size."""
RETRIES = 3
"""Number of repetitions for a survey after the loss of its worker or of the store."""
ROUNDING = 0.002
"""Tolerance (um, urad, um/m) between two results of the same readings; it is above the rounding of
the written values."""
WORKER_MEMORY = 2 * 10**9
"""Largest memory in bytes of a worker on this computer."""
PATIENCE_S = 20
"""Longest time in s to reach the scheduler."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Solved:
    """The outcome of solving a survey again. ``changed`` contains the changed values. ``reason`` is
    the reason why there is no new result. If another survey file replaced the survey file in the
    logs, ``reason`` names the other file."""

    place: Place
    outcome: Literal["the same bytes", "solved anew", "failed"]
    changed: tuple[str, ...] = ()
    reason: Words = ""

    def as_json(self) -> dict[str, Any]:
        return {
            "survey": self.place.folder,
            "outcome": self.outcome,
            "changed": list(self.changed),
            "reason": f"{self.reason}",
        }


def open_surveys(store: Store, machine: str = "") -> list[Place]:
    """Return the archived surveys that this version of the software has not solved."""
    known = store.tables()
    done = {
        (each.machine, each.survey) for each in known if each.software == software().version
    }
    archived = (each for each in known if not each.software and machine in ("", each.machine))
    return [each for each in archived if (each.machine, each.survey) not in done]


@dataclass(frozen=True, slots=True, kw_only=True)
class Scheduler:
    """A Dask scheduler, ``tls://HOST:PORT``, and the certificate files (PEM) of both sides."""

    address: str
    ca: Path
    certificate: Path
    key: Path

    def connected(self) -> Client:
        """Return a client of the scheduler. Raises DeviceError if the scheduler cannot be reached
        or has another identity."""
        try:
            security = Security(
                require_encryption=True,
                tls_ca_file=str(self.ca),
                tls_client_cert=str(self.certificate),
                tls_client_key=str(self.key),
            )
            return Client(self.address, timeout=PATIENCE_S, security=security)
        except (OSError, ValueError) as error:
            found = str(error) or type(error).__name__
            raise DeviceError(
                self.address, expected=message("dask-scheduler"), found=found
            ) from error


def resolve(
    store: Store, places: Sequence[Place], by: int | Scheduler, *, survey: str = ""
) -> Iterator[Solved]:
    """Solve surveys again in ``by`` processes of this computer or on the workers of a scheduler;
    yield each finished survey.

    ``survey`` is the text of a survey file that replaces unreadable survey files in the logs.
    Raises DeviceError if the scheduler cannot be reached.
    """
    if isinstance(by, int):
        yield from _solved_here(store, places, by, survey)
        return
    with by.connected() as client:
        waiting = iter(places)

        asked: dict[Any, Place] = {}

        def submitted(count: int) -> list[Any]:
            futures = []
            for each in islice(waiting, count):
                futures.append(
                    client.submit(
                        solve_anew,
                        store.address,
                        tuple(each),
                        survey,
                        retries=RETRIES,
                        pure=False,
                    )
                )
                asked[futures[-1].key] = each
            return futures

        running = as_completed(submitted(IN_FLIGHT))
        for future in running:
            yield _outcome(future, asked.pop(future.key))
            future.release()
            for more in submitted(1):
                running.add(more)


def _solved_here(
    store: Store, places: Sequence[Place], workers: int, survey: str
) -> Iterator[Solved]:
    lanes: SimpleQueue[_Lane] = SimpleQueue()
    for _ in range(workers):
        lanes.put(_Lane())
    with ThreadPoolExecutor(workers) as threads:
        try:
            tasks = [
                threads.submit(_in_a_lane, lanes, store.address, place, survey)
                for place in places
            ]
            yield from (each.result() for each in completed(tasks))
        finally:
            threads.shutdown(cancel_futures=True)
            for _ in range(workers):
                lanes.get().close()


def _in_a_lane(
    lanes: "SimpleQueue[_Lane]", address: str, place: Place, survey: str
) -> Solved:
    lane = lanes.get()
    try:
        return lane.solve(address, place, survey)
    finally:
        lanes.put(lane)


class _Lane:
    def __init__(self) -> None:
        self._process: ProcessPoolExecutor | None = None

    def solve(self, address: str, place: Place, survey: str) -> Solved:
        """Solve a survey. If every process for this survey ends, the outcome is a failure."""
        for _ in range(1 + RETRIES):
            if self._process is None:
                self._process = ProcessPoolExecutor(
                    1, multiprocessing.get_context("spawn"), _begin_worker
                )
            try:
                return self._process.submit(solve_anew, address, place, survey).result()
            except (BrokenProcessPool, MemoryError):
                self.close()
        return _lost(place)

    def close(self) -> None:
        if self._process is not None:
            self._process.shutdown()
            self._process = None


def _begin_worker() -> None:
    die_with_parent()
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # Ctrl-C ends the command after the surveys that are being solved
    resource.setrlimit(resource.RLIMIT_DATA, (WORKER_MEMORY, WORKER_MEMORY))


def _lost(place: Place) -> Solved:
    return Solved(
        place=place,
        outcome="failed",
        reason=message("every-worker-lost", limit_gb=WORKER_MEMORY / 1e9),
    )


def _outcome(future: Any, place: Place) -> Solved:
    try:
        solved: Solved = future.result()
    except KilledWorker:
        return _lost(place)
    return solved


def solve_anew(
    address: str, at: tuple[str, str, str, str] | Place, survey: str = ""
) -> Solved:
    """Solve a survey of a store again and write the new result into the store; a failure is
    returned as an outcome, not raised."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    place, store = Place(*at), Store(address)
    with tempfile.TemporaryDirectory() as scratch:
        try:
            folder = _fetched(store, place, Path(scratch) / "survey")
            logs = logs_in(folder)
            instead = (
                _stand_in(logs[0], survey, place.machine, Path(scratch)) if survey else None
            )
            complete(logs, Path(scratch) / "out", instead)
            text = (Path(scratch) / "out" / RESULT).read_text(encoding="utf-8")
            old = (folder / RESULT).read_text(encoding="utf-8")
            by = message("by-survey-given") if instead else ""
            if text == old:
                return Solved(place=place, outcome="the same bytes", reason=by)
            return Solved(
                place=place,
                outcome="solved anew",
                changed=_kept(store, place, old, text),
                reason=by,
            )
        except StepdiagError as error:
            return Solved(place=place, outcome="failed", reason=error.message)


def _stand_in(log: Path, survey: str, machine: str, scratch: Path) -> Path | None:
    """Return a file with the survey that replaces an unreadable survey file in a log; None if the
    survey file in the log is readable.

    Raises UsageError for an invalid survey, DataError for a survey of another machine.
    """
    try:
        parse_survey(open_log(log).header.survey_text, log.name)
    except UsageError:
        named = parse_survey(survey, "--survey").identity.machine
        if named != machine:
            raise DataError(
                "--survey", expected=message("survey-file-of", machine=machine), found=named
            ) from None
        file = scratch / "survey.toml"
        file.write_text(survey, encoding="utf-8")
        return file
    return None


def _kept(store: Store, place: Place, old: str, new: str) -> tuple[str, ...]:
    after = parse_result(new, RESULT)
    here = place._replace(software=after.software.version)
    store.write_checked(f"{here.folder}/{RESULT}", new.encode("utf-8"))
    digest = sha256(new.encode("utf-8"))
    put_table(
        store,
        here,
        {RESULT: digest},
        to_parquet(table_of(about(after, place.survey), list(rows_of(after))), digest),
    )
    found = compare(parse_result(old, RESULT), after).changes
    return tuple(
        f"{each.name} by {each.difference:+.3f} {each.unit} (U {2 * (each.u or 0.0):.2f})"
        for each in found
        if each.difference is not None and abs(each.difference) > ROUNDING
    )


def _fetched(store: Store, place: Place, folder: Path) -> Path:
    archived = store.listed(place).files
    folder.mkdir()
    for name in (
        name
        for name in archived
        if "/" not in name and (name.endswith(".mcap") or name in (RESULT, *WORDS))
    ):
        found = store.copied(f"{place.folder}/{name}", folder / name)
        if found != archived[name]:
            remedy = message("archive-again")
            raise DataError(
                f"{place.folder}/{name}",
                expected=f"SHA-256 {archived[name]}",
                found=found,
                remedy=remedy,
            )
    return folder


def as_json(solved: Sequence[Solved]) -> str:
    return json.dumps([each.as_json() for each in solved], indent=2)
