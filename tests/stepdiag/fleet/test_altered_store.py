"""A store that another hand altered: every file of it is read within its limit, and refused by its
name."""

import json
import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.errors import DataError, StepdiagError
from stepdiag.fleet import tables
from stepdiag.fleet.archive import add, refresh_index
from stepdiag.fleet.resolve import solve_anew
from stepdiag.fleet.store import INDEX, LISTED, MARK, Store, sealed
from stepdiag.fleet.tables import from_parquet, to_parquet
from stepdiag.fleet.tolerances import FILE, tolerances_in
from testkit.cli import stepdiag
from testkit.examples import few
from testkit.fleets import finished_survey, series_of, write_history
from testkit.forgeries import flipped, listed_anew

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["files", "format", "result.json", "x.mcap"]), inner
        )
    ),
    max_leaves=8,
)


@pytest.fixture(scope="module")
def survey(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished_survey(tmp_path_factory.mktemp("survey"))


@pytest.fixture(scope="module")
def filled(survey: Path, tmp_path_factory: pytest.TempPathFactory) -> Store:
    store = Store(str(tmp_path_factory.mktemp("works") / "store"), create=True)
    add(survey, store)
    return store


@pytest.fixture
def store(tmp_path: Path) -> Store:
    found = Store(str(tmp_path / "store"), create=True)
    write_history(found, "a", [1.0, 2.0])
    return found


def rows(count: int, **columns: pa.Array) -> pa.Table:
    """Return a table of ``count`` equal rows that is small as a file; ``columns`` stand in place of
    its own."""
    plain = {
        field.name: pa.DictionaryArray.from_arrays(
            pa.array(np.zeros(count, dtype=np.int32)), pa.array(["um"])
        )
        if isinstance(field.type, pa.DictionaryType)
        else pa.array(np.zeros(count, dtype=np.int64)).cast(field.type)
        for field in tables.SCHEMA
    }
    return pa.table(plain | columns)


def read_everything(address: str) -> None:
    """Read what `stepdiag trend` reads."""
    store = Store(address)
    tolerances_in(store)
    series_of(store)


def replace_table(store: Store, data: bytes) -> Path:
    """Put other bytes in place of the first survey's numbers, and their hash into the list of its
    files."""
    place = store.tables()[0]
    path = Path(store.path(place.table))
    path.write_bytes(data)
    listed_anew(store, place)
    return path


class TestManifest:
    @pytest.mark.parametrize(
        "altered",
        [
            "[]",
            "{}",
            '{"files": []}',
            '{"files": {"result.json": 7}}',
            '{"files": "x"}',
            "[" * 100_000,
            "7",
        ],
    )
    def test_an_altered_list_of_files_is_named(
        self, survey: Path, filled: Store, altered: str
    ) -> None:
        place = filled.tables()[0]
        path = Path(filled.path(f"{place.folder}/{LISTED}"))
        whole = path.read_bytes()
        path.write_text(altered, encoding="utf-8")
        try:
            told = stepdiag("archive", "add", survey, "--to", filled.root)
            solved = solve_anew(filled.address, tuple(place))
        finally:
            path.write_bytes(whole)
        assert (told.code, LISTED in told.refusal) == (3, True)
        assert (solved.outcome, LISTED in str(solved.reason)) == ("failed", True)

    @few(40)
    @given(JSON)
    def test_whatever_stands_in_it_is_no_traceback(
        self, survey: Path, filled: Store, altered: object
    ) -> None:
        place = filled.tables()[0]
        path = Path(filled.path(f"{place.folder}/{LISTED}"))
        whole = path.read_bytes()
        path.write_text(json.dumps(altered), encoding="utf-8")
        try:
            with pytest.raises(DataError, match=LISTED):
                add(survey, filled)
            assert solve_anew(filled.address, tuple(place)).outcome == "failed"
        finally:
            path.write_bytes(whole)

    def test_an_archived_result_that_is_no_text_is_named(self, filled: Store) -> None:
        place = filled.tables()[0]
        path = Path(filled.path(f"{place.folder}/result.json"))
        whole = path.read_bytes()
        path.write_bytes(b"\xff\xfe")
        try:
            solved = solve_anew(filled.address, tuple(place))
        finally:
            path.write_bytes(whole)
        assert (solved.outcome, "result.json" in str(solved.reason)) == ("failed", True)


def test_tolerances_are_held_against_the_hash_beside_them(store: Store) -> None:
    """As ``sha256sum`` writes it; without one they count as they stand."""
    file = Path(store.path(FILE))
    file.write_text("[all]\nvolumetric-rms = 15.0\n", encoding="utf-8")
    hashed = subprocess.run(
        ["sha256sum", FILE], cwd=file.parent, capture_output=True, check=True
    ).stdout
    file.with_name(f"{FILE}.sha256").write_bytes(hashed)
    assert tolerances_in(store).of("a", "volumetric-rms") == 15.0
    rng = np.random.default_rng(4)
    for _ in range(100):
        with flipped(file, rng), pytest.raises(DataError, match=FILE):
            tolerances_in(store)
    assert stepdiag("trend", store.root).code == 0


class TestLimits:
    @pytest.mark.parametrize("name", [MARK, FILE, INDEX, "table"])
    def test_no_file_is_read_beyond_its_limit(self, store: Store, name: str) -> None:
        """A file with a hole of 10 GB takes no room on the disk, and would take all of the
        memory."""
        refresh_index(store, most_loose=0)
        if name == "table":
            Path(store.path(INDEX)).unlink()
        path = Path(store.path(store.tables()[0].table if name == "table" else name))
        with path.open("ab") as file:
            file.truncate(10_000_000_000)
        tracemalloc.start()
        try:
            with pytest.raises(DataError, match="at most"):
                read_everything(store.address)
            assert tracemalloc.get_traced_memory()[1] < 50_000_000
        finally:
            tracemalloc.stop()

    def test_a_small_file_of_millions_of_rows_is_refused_before_it_is_unpacked(
        self, store: Store
    ) -> None:
        path = replace_table(store, to_parquet(rows(3_000_000)))
        assert path.stat().st_size < 2_000_000
        code = f"""
import resource
from stepdiag.fleet.store import Store
from stepdiag.fleet.history import history_in
from datetime import UTC, datetime
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
(left,) = history_in(Store({store.address!r}), datetime(2030, 1, 1, tzinfo=UTC)).left_out
assert "3000000 rows" in str(left.why)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        assert int(done.stdout) < 100_000, "kilobytes beside the libraries"

    def test_no_thread_of_the_library_is_left_when_a_store_was_read(
        self, store: Store
    ) -> None:
        """A thread that still runs when the interpreter ends aborts the process: under load, one
        of six finished commands exited with -6."""
        code = f"""
import os
from stepdiag.fleet.store import Store
from stepdiag.fleet.history import history_in
from datetime import UTC, datetime
before = os.listdir("/proc/self/task")
history_in(Store({store.address!r}), datetime(2030, 1, 1, tzinfo=UTC))
print(len(os.listdir("/proc/self/task")) - len(before))
"""
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        assert int(done.stdout) == 0

    def test_a_small_file_of_one_long_text_is_refused_before_it_is_unpacked(
        self, store: Store
    ) -> None:
        long = pa.array(["x" * 100_000_000])
        path = replace_table(store, to_parquet(rows(1, conditions=long)))
        assert path.stat().st_size < 1_000_000
        with pytest.raises(DataError, match="at most"):
            series_of(store)

    def test_an_index_holds_as_much_as_its_surveys_have(
        self, store: Store, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(tables, "MOST_ROWS", 1)
        monkeypatch.setattr(tables, "MOST_POINTS_A_SURVEY", 1)
        assert refresh_index(store, most_loose=0) == 2
        assert len(series_of(store)[0].points) == 2
        Path(store.path(store.tables()[0].table)).unlink()
        with pytest.raises(DataError, match=INDEX):
            series_of(store)


class TestColumns:
    @pytest.mark.parametrize(
        "columns",
        [
            {"value": pa.array(["much"])},
            {"value": pa.array([None], pa.float64())},
            {"value": pa.array([float("nan")])},
            {"u": pa.array([-1.0])},
            {"time": pa.array([None], pa.timestamp("us", tz="UTC"))},
            {"time": pa.array([2**62], pa.timestamp("us", tz="UTC"))},
            {"time": pa.array([-(2**62)], pa.timestamp("us", tz="UTC"))},
            {"time": pa.array([0], pa.timestamp("us"))},
            {"machine": pa.array([None], pa.string())},
            {"quantity": pa.array([None], pa.string())},
            {"conditions": pa.array([None], pa.string())},
            {"event": pa.array([None], pa.string())},
            {"unit": pa.array([3])},
        ],
    )
    @pytest.mark.parametrize("indexed", [False, True])
    def test_a_value_that_no_survey_has_is_named_with_its_file(
        self, store: Store, columns: dict[str, pa.Array], *, indexed: bool
    ) -> None:
        table = rows(1, **columns)
        if indexed:
            refresh_index(store, most_loose=0)
            name, column = next(iter(columns.items()))
            table = tables.index_of([(rows(1).cast(tables.SCHEMA), store.tables()[0].folder)])
            table = table.set_column(table.schema.get_field_index(name), name, column)
            Path(store.path(INDEX)).write_bytes(sealed(to_parquet(table)))
            with pytest.raises(DataError, match=INDEX):
                series_of(store)
            assert refresh_index(store, most_loose=0) == 2, (
                "an index that is damaged is made anew"
            )
        else:
            replace_table(store, to_parquet(table))
            with pytest.raises(DataError, match=store.tables()[0].folder):
                series_of(store)

    @pytest.mark.parametrize("name", ["machine=x", "machine=a/year=2020"])
    def test_a_file_in_place_of_a_folder_is_named(self, store: Store, name: str) -> None:
        path = Path(store.path(name))
        if path.is_dir():
            path.rename(path.with_name("year=2099"))
        path.write_text("a note", encoding="utf-8")
        with pytest.raises(StepdiagError):
            series_of(store)

    def test_a_table_reads_as_it_was_written(self) -> None:
        table = rows(3).cast(tables.SCHEMA)
        assert from_parquet(to_parquet(table), "x", tables.SCHEMA, 3, 1000).equals(table)
