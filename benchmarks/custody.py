"""Is every flipped bit found? ``python -m benchmarks.custody --flips 10000``.

One bit at a time, drawn over every file that a certificate rests on: a folder of readings, a signed
certificate, a store with logs. The result is solved once for all flips of one place; everything
else is read, hashed, written again and compared as always.
"""

import argparse
import hashlib
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from stepdiag.base.errors import StepdiagError
from stepdiag.base.files import HASH_SUFFIX, read_text
from stepdiag.base.readings.readings import render_readings
from stepdiag.certificate import custody
from stepdiag.certificate.custody import verify_certificate
from stepdiag.certificate.signature import require_signature
from stepdiag.fleet.archive import add, refresh_index
from stepdiag.fleet.custody import check, verify_in_store
from stepdiag.fleet.store import INDEX, LISTED, Store
from testkit.cli import stepdiag
from testkit.exact.surveys import Bench
from testkit.fleets import finished_survey, series_of
from testkit.forgeries import flipped, signing_key

LABORATORY = (
    '[certificate]\nbegun = 2026-05-30\nended = 2026-05-31\n[laboratory]\nname = "Lab"\n'
)
Holds = Callable[[], bool]


def folder_of_readings(folder: Path) -> tuple[list[Path], Holds]:
    """Make a folder with a certificate; return its files and whether the certificate holds."""
    folder.mkdir()
    readings = Bench(seed=3, increments=2).survey(passes=(1, 2), joined=True)
    (folder / "readings.csv").write_text(render_readings(readings), encoding="utf-8")
    (folder / "laboratory.toml").write_text(LABORATORY, encoding="utf-8")
    _done("solve", folder / "readings.csv", "--out", folder / "result.json")
    _done(
        "export",
        folder / "result.json",
        "--controller",
        "linuxcnc",
        "--step-mm",
        "50",
        "--out",
        folder / "exports",
    )
    settings = ("--laboratory", folder / "laboratory.toml")
    _done(
        "report",
        folder / "result.json",
        folder / "exports",
        *settings,
        "--out",
        folder / "report.html",
    )
    _certify(
        folder / "result.json",
        folder / "exports",
        *settings,
        "--report",
        folder / "report.html",
        "--out",
        folder / "c.xml",
    )
    rests_on = [
        path for path in _files(folder) if path.suffix != HASH_SUFFIX
    ]  # the result's own hash stands in the certificate
    return rests_on, lambda: verify_certificate(folder / "c.xml", folder).broken is None


def signed_certificate(folder: Path) -> tuple[list[Path], Holds]:
    """The same, signed: the flips are in the certificate alone."""
    folder_of_readings(folder)
    key, certificate = signing_key(folder)
    _certify(
        folder / "result.json",
        "--laboratory",
        folder / "laboratory.toml",
        "--key",
        key,
        "--key-certificate",
        certificate,
        "--out",
        folder / "signed.xml",
    )

    def holds() -> bool:
        require_signature(folder / "signed.xml", certificate)
        return verify_certificate(folder / "signed.xml", folder).broken is None

    return [folder / "signed.xml"], holds


def survey_of_logs(folder: Path) -> tuple[list[Path], Holds]:
    """A recorded survey with its certificate, the logs as they were recorded."""
    survey = finished_survey(folder)
    _certify(survey, "--out", folder / "c.xml")
    return [
        folder / "c.xml",
        survey / "result.json",
        *survey.glob("*.mcap"),
    ], lambda: verify_certificate(folder / "c.xml", folder).broken is None


def survey_in_a_store(folder: Path) -> tuple[list[Path], Holds]:
    """The same in a store: table, index, list, and all files of the survey."""
    survey, store = (
        finished_survey(folder / "survey"),
        Store(str(folder / "store"), create=True),
    )
    add(survey, store)
    refresh_index(store, most_loose=0)
    _certify(survey, "--out", folder / "c.xml")
    files = [
        path
        for path in _files(folder / "store")
        if path.suffix != ".json" or path.name != "stepdiag-store.json"
    ]
    assert folder / "store" / INDEX in files
    return files, lambda: verify_in_store(folder / "c.xml", store.address).broken is None


def store_that_is_checked(folder: Path) -> tuple[list[Path], Holds]:
    """The same store without a certificate, read whole by `archive check`."""
    files, _ = survey_in_a_store(folder)
    store = Store(str(folder / "store"))
    return files, lambda: not list(check(store))


def store_that_is_shown(folder: Path) -> tuple[list[Path], Holds]:
    """Table, index and list of the same store: what `trend` shows is the same, or what is left out
    is named. The same is no miss."""
    files, _ = survey_in_a_store(folder)
    store = Store(str(folder / "store"))
    (folder / "store" / INDEX).unlink()

    def shown() -> str:
        return "".join(
            f"{one.quantity} {one.values.tolist()} {one.u.tolist()} {one.shown.tolist()}"
            for one in series_of(store)
        )

    before = shown()
    return [
        path for path in files if path.suffix == ".parquet" or path.name == LISTED
    ], lambda: shown() != before


def result_beside_its_hash(folder: Path) -> tuple[list[Path], Holds]:
    """The result of a survey's folder, which report, export and page read."""
    result = finished_survey(folder) / "result.json"
    return [result], lambda: bool(read_text(result))


PLACES = (
    folder_of_readings,
    signed_certificate,
    survey_of_logs,
    survey_in_a_store,
    store_that_is_checked,
    store_that_is_shown,
    result_beside_its_hash,
)


def _files(folder: Path) -> list[Path]:
    return sorted(
        path for path in folder.rglob("*") if path.is_file() and path.stat().st_size
    )


def _done(*arguments: Any) -> None:
    told = stepdiag(*arguments)
    if told.code != 0:
        raise RuntimeError(told.refusal)


def _certify(*arguments: Any) -> None:
    _done("certificate", *arguments)


def solve_once() -> None:
    """Keep what a result is solved to for the same result, links and files."""
    again, known = custody._again, {}  # noqa: SLF001

    def once(path: Path, links: Sequence[Any], held: Any, suffix: str) -> Any:
        key = (hashlib.sha256(path.read_bytes()).hexdigest(), tuple(links), suffix)
        if key not in known:
            known[key] = again(path, links, held, suffix)
        return known[key]

    custody._again = once  # noqa: SLF001


def missed(
    files: Sequence[Path], holds: Holds, flips: int, rng: np.random.Generator
) -> list[str]:
    """Return the files in which a flip was not found, one of ``flips`` drawn evenly over the
    files."""
    found = []
    for turn in range(flips):
        path = files[turn % len(files)]
        with flipped(path, rng), suppress(StepdiagError):
            if holds():
                found.append(path.name)
    return found


def main() -> None:
    """Count and print. Ends with 1 where a flip is not found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flips", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=46)
    given = parser.parse_args()
    solve_once()
    rng, lost = np.random.default_rng(given.seed), 0
    with tempfile.TemporaryDirectory() as scratch:
        for make in PLACES:
            files, holds = make(Path(scratch) / make.__name__)
            if make is not store_that_is_shown and not holds():
                raise RuntimeError(make.__name__)
            unseen = missed(files, holds, given.flips // len(PLACES), rng)
            lost += len(unseen)
            print(
                f"{make.__name__}: {given.flips // len(PLACES)} bits in {len(files)} files, "
                f"{len(unseen)} not found {sorted(set(unseen))}",
                flush=True,
            )
    raise SystemExit(bool(lost))


if __name__ == "__main__":
    main()
