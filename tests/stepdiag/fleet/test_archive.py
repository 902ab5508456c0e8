"""The archive: what is in it is whole, once, and readable by others; whatever goes wrong leaves
nothing half-written."""

import errno
import hashlib
import json
import threading
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.result.result import parse_result
from stepdiag.fleet import archive as archiving
from stepdiag.fleet.archive import add, finished_in, refresh_index
from stepdiag.fleet.resolve import solve_anew
from stepdiag.fleet.store import INDEX, LISTED, MARK, Store
from stepdiag.fleet.tables import to_parquet
from stepdiag.fleet.terminal import as_csv
from stepdiag.fleet.trend import trends_of
from testkit.cli import stepdiag
from testkit.fleets import finished_survey, series_of, write_history
from testkit.forgeries import listed_anew
from testkit.hostile.foreign_logs import SURVEY, with_survey


@pytest.fixture(scope="module")
def survey(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished survey that the tests only read."""
    return finished_survey(tmp_path_factory.mktemp("survey"), event="crash")


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(str(tmp_path / "store"), create=True)


def everything_in(store: Store) -> list[str]:
    root = Path(store.root)
    return sorted(
        path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file()
    )


def test_others_read_the_numbers_without_us(survey: Path, store: Store) -> None:
    """A reader of Parquet from outside, by the names of folders and columns alone."""
    added = add(survey, store)
    result = parse_result((survey / "result.json").read_text(encoding="utf-8"))
    table = pa.concat_tables(
        pq.read_table(path, partitioning=None)
        for path in Path(store.root).glob("machine=*/year=*/*.parquet")
    )
    rows = sorted(
        (
            (
                each["machine"],
                each["time"].year,
                *(each[name] for name in ("position_mm", "value", "u", "k", "unit", "event")),
            )
            for each in table.to_pylist()
            if each["quantity"] == "EXX"
        ),
        key=lambda row: row[2],
    )
    assert [row[2] for row in rows] == result.errors["EXX"].position_mm.tolist()
    assert [row[3] for row in rows] == result.errors["EXX"].value.tolist()
    assert {(row[0], row[5], row[6], row[7]) for row in rows} == {
        ("Mill 7/ä", 1, "um", "crash")
    }
    assert rows[0][1] == int(added.place.year)


def test_every_file_is_there_with_its_hash_and_the_logs_replay(
    survey: Path, store: Store, tmp_path: Path
) -> None:
    added = add(survey, store)
    folder = Path(store.root) / added.place.folder
    listed = json.loads((folder / LISTED).read_text(encoding="utf-8"))["files"]
    assert {"result.json", "readings.csv", "0001.mcap"} <= set(listed)
    assert {
        name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in listed
    } == listed
    assert (folder / "0001.mcap").stat().st_size < (survey / "0001.mcap").stat().st_size, (
        "logs are packed"
    )
    assert stepdiag("replay", folder / "0001.mcap", "--out", tmp_path / "again").code == 0
    assert (tmp_path / "again/result.json").read_bytes() == (
        survey / "result.json"
    ).read_bytes()


def test_the_same_survey_twice_is_one(survey: Path, store: Store) -> None:
    assert add(survey, store).outcome == "archived"
    before = everything_in(store)
    assert add(survey, store).outcome == "already there"
    archived = Path(store.root) / store.tables()[0].folder
    assert add(archived, store).outcome == "already there", "packed, it is the same survey"
    assert everything_in(store) == before


def test_other_results_of_the_same_logs_are_refused(
    survey: Path, store: Store, tmp_path: Path
) -> None:
    add(survey, store)
    other = tmp_path / "other"
    other.mkdir()
    (other / "0001.mcap").write_bytes((survey / "0001.mcap").read_bytes())
    (other / "result.json").write_text(
        (survey / "result.json")
        .read_text(encoding="utf-8")
        .replace('"estimate"', '"by hand"')
    )
    before = everything_in(store)
    with pytest.raises(DataError, match="archived with these logs"):
        add(other, store)
    assert everything_in(store) == before


@pytest.mark.parametrize("files", [0, 1, 3])
def test_a_share_that_fills_up_leaves_nothing_listed_and_the_next_try_completes(
    survey: Path, store: Store, monkeypatch: pytest.MonkeyPatch, files: int
) -> None:
    usual, written = Store.write, []

    def full(self: Store, name: str, data: bytes, *, anew: bool = True) -> None:
        if len(written) == files:
            monkeypatch.setattr("pathlib.Path.replace", _no_space)
            monkeypatch.setattr("pathlib.Path.hardlink_to", _no_space)
        written.append(name)
        usual(self, name, data, anew=anew)

    monkeypatch.setattr(Store, "write", full)
    with pytest.raises(UsageError, match="No space left"):
        add(survey, store)
    monkeypatch.undo()
    assert store.tables() == []
    assert not [name for name in everything_in(store) if name.endswith(".part")]
    assert add(survey, store).outcome == "archived"
    assert len(store.tables()) == 1


def _no_space(_self: Path, _target: Path) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


def test_two_writers_at_once_do_no_harm(survey: Path, store: Store) -> None:
    """The same survey by four at a time, and the index made anew by all of them."""
    write_history(store, "other", [1.0] * 5)
    trouble: list[Exception] = []

    def write() -> None:
        try:
            add(survey, store)
            refresh_index(store, most_loose=0)
        except Exception as error:  # noqa: BLE001  # said by the test
            trouble.append(error)

    threads = [threading.Thread(target=write) for _ in range(4)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    assert trouble == []
    assert len(store.tables()) == 6
    assert {each.machine for each in series_of(store)} == {"other", "Mill 7/ä"}
    assert not [name for name in everything_in(store) if name.endswith(".part")]


def test_what_another_zstd_packed_is_the_same_log_and_what_it_says_is_compared(
    survey: Path, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another computer got half-way: its log, packed to other bytes, is completed; one with other
    records is refused."""
    with monkeypatch.context() as other:
        other.setattr("stepdiag.daq.recording.archive.LEVEL", 1)
        add(survey, store)
    place = store.tables()[0]
    log = Path(store.path(f"{place.folder}/0001.mcap"))
    theirs = log.read_bytes()
    Path(store.path(place.table)).unlink()
    Path(store.path(f"{place.folder}/{LISTED}")).unlink()
    assert add(survey, store).outcome == "archived"
    assert log.read_bytes() == theirs
    assert (
        store.json(f"{place.folder}/{LISTED}")["files"]["0001.mcap"]
        == hashlib.sha256(theirs).hexdigest()
    )
    Path(store.path(place.table)).unlink()
    log.write_bytes(theirs[:-200])
    with pytest.raises(DataError, match="a file in a store is never overwritten"):
        add(survey, store)


@pytest.mark.parametrize("links", [True, False])
def test_a_file_that_came_meanwhile_stays_where_the_share_knows_links(
    store: Store, monkeypatch: pytest.MonkeyPatch, *, links: bool
) -> None:
    """Another writer's file appears between the look and the writing: with other bytes it is never
    taken for ours."""
    Path(store.path("x")).write_bytes(b"theirs")
    monkeypatch.setattr(Store, "exists", lambda _self, _name: False)
    if not links:
        monkeypatch.setattr("pathlib.Path.hardlink_to", _no_space)
        assert store.write_checked("x", b"ours") == b"ours"
        return
    with pytest.raises(DataError, match="find out which computer wrote this file"):
        store.write_checked("x", b"ours")
    assert Path(store.path("x")).read_bytes() == b"theirs"


def test_the_index_says_the_same_as_the_tables(store: Store) -> None:
    write_history(store, "a", [1.0, 2.0, 3.0])
    loose = as_csv(trends_of(series_of(store), lambda *_: None))
    assert refresh_index(store, most_loose=0) == 3
    assert as_csv(trends_of(series_of(store), lambda *_: None)) == loose
    write_history(store, "b", [4.0])
    assert [each.machine for each in series_of(store)] == ["a", "b"]
    Path(store.path(store.tables()[0].table)).unlink()
    assert len(series_of(store, "a")[0].points) == 2, (
        "what is not in the store any more is not told from the index"
    )


@pytest.mark.parametrize("name", [INDEX, "table"])
@pytest.mark.parametrize("data", [b"", b"PAR1 nonsense PAR1", None])
def test_damaged_and_foreign_tables_are_named(
    store: Store, name: str, data: bytes | None
) -> None:
    write_history(store, "a", [1.0, 2.0])
    refresh_index(store, most_loose=0)
    place = store.tables()[0].table if name == "table" else INDEX
    if name == "table":
        Path(store.path(INDEX)).unlink()
    path = Path(store.path(place))
    if data is None:
        pq.write_table(pa.table({"machine": [1]}), path)
    else:
        path.write_bytes(data)
    with pytest.raises(DataError, match=path.name):
        series_of(store)


@pytest.mark.parametrize("name", [INDEX, "table"])
def test_a_table_of_a_newer_or_foreign_version_is_named_as_such(
    store: Store, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    with monkeypatch.context() as newer:
        if name == "table":
            newer.setattr("stepdiag.fleet.tables.VERSION", "3")
        write_history(store, "a", [1.0, 2.0])
    if name == INDEX:
        with monkeypatch.context() as newer:
            newer.setattr(
                "stepdiag.fleet.archive.to_parquet",
                lambda table: to_parquet(table).replace(b"stepdiag-rows", b"stepdiag-ROWS"),
            )
            refresh_index(store, most_loose=0)
    with pytest.raises(
        DataError,
        match="a newer version of stepdiag can read this file"
        if name == "table"
        else "found none",
    ):
        series_of(store)


@pytest.mark.parametrize(
    "mark",
    [
        "{}",
        "[1]",
        "nonsense",
        '{"format": "stepdiag-store", "version": 2}',
        '{"format": "other", "version": 1}',
    ],
)
def test_a_store_of_another_kind_is_refused(tmp_path: Path, mark: str) -> None:
    (tmp_path / MARK).write_text(mark, encoding="utf-8")
    with pytest.raises((UsageError, DataError), match=MARK):
        Store(str(tmp_path))


@pytest.mark.parametrize(
    "address", ["nothing-here", "nosuchprotocol://x/y", "s3://bucket/x", ""]
)
def test_a_store_that_is_away_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, address: str
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError):
        Store(address)


def test_a_store_may_be_anywhere_that_fsspec_opens(survey: Path) -> None:
    store = Store("memory://works/archive", create=True)
    assert add(survey, store).outcome == "archived"
    assert add(survey, store).outcome == "already there"
    refresh_index(store, most_loose=0)
    assert "volumetric-rms" in {each.quantity for each in series_of(store, "Mill 7/ä")}


def test_only_finished_surveys_are_taken(survey: Path, tmp_path: Path) -> None:
    (tmp_path / "open").mkdir()
    (tmp_path / "open/0001.mcap").write_bytes(b"")
    (tmp_path / "solved-elsewhere").mkdir()
    (tmp_path / "solved-elsewhere/result.json").write_text("{}", encoding="utf-8")
    with pytest.raises(UsageError, match="finished surveys"):
        finished_in([tmp_path])
    assert finished_in([tmp_path, survey.parent]) == [survey]


def test_a_link_out_of_the_folder_is_not_archived(
    survey: Path, store: Store, tmp_path: Path
) -> None:
    folder = tmp_path / "0001"
    folder.mkdir()
    for path in survey.glob("*.*"):
        (folder / path.name).write_bytes(path.read_bytes())
    (folder / "secret.txt").symlink_to("/etc/hostname")
    add(folder, store)
    assert not [name for name in everything_in(store) if "secret" in name]


def test_a_damaged_log_is_not_archived(survey: Path, store: Store, tmp_path: Path) -> None:
    folder = tmp_path / "0001"
    folder.mkdir()
    (folder / "result.json").write_bytes((survey / "result.json").read_bytes())
    (folder / "0001.mcap").write_bytes((survey / "0001.mcap").read_bytes()[:-400])
    with pytest.raises(DataError, match="stepdiag recover"):
        add(folder, store)
    assert store.tables() == []


def test_the_command_says_what_it_did(survey: Path, tmp_path: Path) -> None:
    told = stepdiag("archive", "add", survey, "--to", tmp_path / "store", "--json")
    assert [each["outcome"] for each in json.loads(told.out)] == ["archived"]
    told = stepdiag("archive", "add", survey, "--to", tmp_path / "store")
    assert told.out.startswith("already in the store: ")
    assert archiving.MOST_LOOSE > 0


def test_an_old_log_whose_survey_is_refused_is_solved_with_another(
    survey: Path, store: Store
) -> None:
    """Without one it is named with its reason, and the command says the way."""
    place = add(survey, store).place
    text = SURVEY.replace('machine = "virtual"', 'machine = "Mill 7/ä"\nevent = "crash"')
    text = text[: text.index("[[export]]")]
    old = with_survey(text + "[of_old]\nkey = 1\n")
    folder = Path(store.root) / place.folder
    (folder / "0001.mcap").write_bytes(old)
    lost = solve_anew(store.address, tuple(place))
    assert (lost.outcome, "SHA-256" in str(lost.reason)) == ("failed", True), (
        "a log that is not the archived one is named"
    )
    listed_anew(store, place)
    refused = solve_anew(store.address, tuple(place))
    assert (refused.outcome, "of_old" in str(refused.reason)) == ("failed", True)
    stood_in = solve_anew(store.address, tuple(place), text)
    assert (stood_in.outcome, stood_in.changed, str(stood_in.reason)) == (
        "solved anew",
        (),
        "with the survey file of --survey",
    )
    other = solve_anew(store.address, tuple(place), text.replace("Mill 7/ä", "Mill 8"))
    assert (other.outcome, "Mill 8" in str(other.reason)) == ("failed", True)
    told = stepdiag("resolve", store.root, "--survey", survey / "result.json")
    assert (told.code, "--machine" in told.refusal) == (2, True)


def test_a_survey_that_is_read_is_solved_as_it_was_driven_whatever_file_is_given(
    survey: Path, store: Store
) -> None:
    place = add(survey, store).place
    another = SURVEY.replace(
        'machine = "virtual"', 'machine = "Mill 7/ä"\nevent = "crash"'
    ).replace("300.0, 200", "310.0, 200")
    assert "310.0" in another
    assert solve_anew(store.address, tuple(place), another).outcome == "the same bytes"
