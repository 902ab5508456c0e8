"""A store of many results: how long the trend takes, how large it is, how much two workers gain,
what scheduler and client keep in memory.

The surveys are those of `benchmarks.fleet`, driven by the virtual machine and solved; as solving
8,000 takes the better part of an hour, some machines are solved and stand in the store under ten
names each, which costs the query the same.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import parquet

from benchmarks.fleet import generate
from benchmarks.stand import peak_mb
from benchmarks.table import Row
from stepdiag.base.result.result import DISPLACEMENTS
from stepdiag.daq.records.survey_folder import RESULT
from stepdiag.fleet.archive import add, refresh_index
from stepdiag.fleet.history import history_in
from stepdiag.fleet.resolve import open_surveys, resolve
from stepdiag.fleet.store import INDEX, Place, Store, manifest_of, sha256, unsealed
from stepdiag.fleet.tables import read_table, to_parquet
from stepdiag.fleet.trend import trends_of

RESULTS, SURVEYS, NAMES = 8000, 40, 10
TASKS = 24
QUERY, FUNCTION_BYTES, GAIN, MEMORY_MB = 8.0, 1024, 1.7, 400


def rows(results: int = RESULTS) -> list[Row]:
    """Return the rows of a store with so many results."""
    with tempfile.TemporaryDirectory() as name:
        store = Store(f"{name}/store", create=True)
        sum(generate(store.root, max(results // SURVEYS // NAMES, 1), SURVEYS, 2))
        for place in store.tables():
            table = read_table(store, place)
            for number in range(1, NAMES):
                _written(
                    store, Place(f"{place.machine}-{number}", place.year, place.survey), table
                )
        refresh_index(store, most_loose=0)
        found = [_query(store), _size(store)]
    return [*found, *_workers()]


def _written(store: Store, place: Place, table: pa.Table) -> None:
    """Write the table of a result under the name of another machine, without waiting for the
    disk."""
    column = table.schema.get_field_index("machine")
    name = pa.DictionaryArray.from_arrays(
        pa.array([0] * table.num_rows, pa.int32()), pa.array([place.machine])
    )
    path = Path(store.path(place.table))
    path.parent.mkdir(parents=True, exist_ok=True)
    data = to_parquet(table.set_column(column, table.schema.field(column), name))
    path.write_bytes(data)
    listed = Path(store.path(place.listed))
    listed.parent.mkdir(exist_ok=True)
    listed.write_bytes(manifest_of(place, {RESULT: "0" * 64}, sha256(data)))


def _query(store: Store) -> Row:
    """Return the row of the trend of every quantity of every machine beside its floor: the best of
    three, since other programs only add to it."""
    times, floors = [], []
    series = history_in(store, datetime.now(UTC)).series
    lines = [
        (np.arange(float(len(each.values))), np.nan_to_num(each.values)) for each in series
    ]
    for _ in range(3):
        computed = time.process_time()
        points = sum(
            len(each.series.surveys)
            for each in trends_of(
                history_in(store, datetime.now(UTC)).series, lambda *_: None
            )
        )
        times.append(time.process_time() - computed)
        computed = time.process_time()
        _read_bare(store, lines)
        floors.append(time.process_time() - computed)
    ratio = min(times) / min(floors)
    return Row(
        f"fleet: trend of {len(store.tables())} results, {points} points",
        f"{min(times):.2f} s of a processor",
        f"read and a straight line each: {min(floors):.2f} s",
        f"{ratio:.1f}",
        f"ratio {QUERY:g}",
        ratio <= QUERY,
    )


def _read_bare(
    store: Store, lines: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]]
) -> None:
    """Do the least that a trend does: read the index, and fit a straight line to each quantity."""
    parquet.read_table(pa.BufferReader(unsealed(store.read(INDEX), INDEX)))
    for times, values in lines:
        np.linalg.lstsq(np.stack([np.ones_like(times), times], axis=1), values)


def _size(store: Store) -> Row:
    sizes = [Path(store.path(place.table)).stat().st_size for place in store.tables()]
    each = sum(sizes) / len(sizes) / len(DISPLACEMENTS)
    return Row(
        "fleet: a function in the store",
        f"{each:.0f} bytes",
        f"{sum(sizes) / 1e6:.1f} MB in all",
        goal="1 KB",
        met=each <= FUNCTION_BYTES,
    )


def _workers() -> list[Row]:
    """Return the rows of solving anew with one worker and with two."""
    with tempfile.TemporaryDirectory() as name:
        _store_of_logs(Path(name))
        one, _ = _resolved(name, 1)
        two, memory = _resolved(name, 2)
    load = os.getloadavg()[0]
    return [
        Row(
            f"fleet: {TASKS} surveys solved anew by two workers",
            f"{TASKS / two:.2f} a second",
            f"one worker: {TASKS / one:.2f} a second, load {load:.1f}",
            f"{one / two:.2f}",
            f"{GAIN:g} times",
            one / two >= GAIN,
        ),
        Row(
            "the same: resident memory of scheduler and client",
            f"{memory:.0f} MB",
            goal=f"{MEMORY_MB} MB",
            met=memory <= MEMORY_MB,
        ),
    ]


def _store_of_logs(folder: Path) -> None:
    """Make a store with one recorded survey under many names."""
    from testkit.fleets import finished_survey

    store = Store(f"{folder}/store", create=True)
    place = add(finished_survey(folder / "survey", machine="0"), store).place
    for number in range(1, TASKS):
        other = place._replace(machine=str(number))
        shutil.copytree(store.path(place.folder), store.path(other.folder))
        shutil.copy(store.path(place.table), store.path(other.table))


def _resolved(folder: str, workers: int) -> tuple[float, float]:
    """Return (seconds a program solves, its peak memory in MB): from the first survey that is done,
    so that its start does not count."""
    command = [
        sys.executable,
        "-m",
        "benchmarks.bench_fleet",
        f"{folder}/store",
        str(workers),
    ]
    said = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
    return float(said[0]), float(said[1])


def main() -> None:
    """Solve all surveys of a store anew and print the seconds between the first and the last that
    is done, and the peak memory."""
    store, workers = Store(sys.argv[1]), int(sys.argv[2])
    done = [time.perf_counter() for _ in resolve(store, open_surveys(store), workers)]
    sys.stdout.write(
        f"{(done[-1] - done[workers - 1]) * len(done) / (len(done) - workers)} {peak_mb()}\n"
    )


if __name__ == "__main__":
    main()
