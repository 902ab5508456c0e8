"""The chain of custody through a store: what is true holds, and every forgery is named by the first
link that does not."""

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from stepdiag.base.errors import DataError, StepdiagError, UsageError
from stepdiag.certificate import custody
from stepdiag.fleet import resolve
from stepdiag.fleet.archive import add, refresh_index
from stepdiag.fleet.custody import check, verify_in_store
from stepdiag.fleet.history import history_in
from stepdiag.fleet.store import INDEX, LISTED, MARK, Store
from stepdiag.fleet.tables import result_named, to_parquet
from testkit.cli import stepdiag
from testkit.fleets import NOW, finished_survey
from testkit.forgeries import edited_index, edited_table, flipped, listed_anew, table_of_ours


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a store of two surveys and the certificate of the first, with the laboratory's
    file beside it."""
    folder = tmp_path_factory.mktemp("custody")
    store = Store(str(folder / "store"), create=True)
    survey = finished_survey(folder / "survey")
    for each in (survey, finished_survey(folder / "other", machine="Mill 8")):
        add(each, store)
    refresh_index(store, most_loose=0)
    (folder / "laboratory.toml").write_text('[laboratory]\nname = "Lab"\n', encoding="utf-8")
    told = stepdiag(
        "certificate",
        survey,
        "--laboratory",
        folder / "laboratory.toml",
        "--out",
        folder / "c.xml",
    )
    assert told.code == 0, told.refusal
    shutil.rmtree(folder / "survey")
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    shutil.copytree(made, tmp_path / "case")
    return tmp_path / "case"


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Solve once for all changes of one store; everything else is read, hashed and written again as
    always."""
    again, known = custody._again, {}

    def once(path, links, held, suffix):
        key = (
            hashlib.sha256(path.read_bytes()).hexdigest(),
            tuple(links),
            tuple(sorted(str(each) for each in held)),
        )
        if key not in known:
            known[key] = again(path, links, held, suffix)
        return known[key]

    monkeypatch.setattr(custody, "_again", once)


def verdict(folder: Path) -> str:
    found = verify_in_store(folder / "c.xml", str(folder / "store"))
    return "" if found.broken is None else found.broken.key


def table_in(folder: Path, machine: str = "Mill 7") -> Path:
    return next(
        path for path in (folder / "store").rglob("*.parquet") if machine in path.as_posix()
    )


def test_what_is_true_holds(folder: Path) -> None:
    told = stepdiag("verify", folder / "c.xml", "--custody", folder / "store")
    assert (told.code, "is correct: 3 links" in told.out) == (0, True), told.out
    result = table_in(folder).with_suffix("") / "result.json"
    assert (
        result_named(table_in(folder).read_bytes())
        == hashlib.sha256(result.read_bytes()).hexdigest()
    )


def test_result_that_was_solved_anew_is_in_the_walk(folder: Path) -> None:
    """Its table is walked beside that of what was archived, and the certificate still rests on the
    archived one."""
    store = Store(str(folder / "store"))
    place = next(each for each in store.tables() if "Mill 7" in each.machine)
    text = (_survey(folder) / "result.json").read_text(encoding="utf-8")
    version = json.loads(text)["software"]["version"]
    resolve._kept(store, place, text, text.replace(f'"{version}"', '"99.0"'))
    assert verdict(folder) == ""
    anew = next((folder / "store").rglob("*@99.0.parquet"))
    edited_table(anew, "value", lambda values: [values[0] + 0.1, *values[1:]])
    assert verdict(folder) == "custody-table"


def _value(column: str, by: float) -> Callable[[Path], None]:
    return lambda folder: edited_table(
        table_in(folder), column, lambda values: [values[0] + by, *values[1:]]
    )


def _statistics(folder: Path) -> None:
    """Keep every number, and state least and largest of every column, by which readers choose what
    they read."""
    edited_table(table_in(folder), "value", statistics=True)


def _with_hashes(folder: Path, forge: Callable[[Path], object]) -> None:
    """Forge, then write the new SHA-256 of every file into the list of files: a forger who knows
    the chain."""
    forge(folder)
    store = Store(str(folder / "store"))
    for place in store.tables():
        listed_anew(store, place)


def _survey(folder: Path, machine: str = "Mill 7") -> Path:
    return table_in(folder, machine).with_suffix("")


def _exchanged(folder: Path) -> None:
    """The table of another machine's survey under this survey's name."""
    table_in(folder).write_bytes(table_in(folder, "Mill 8").read_bytes())


def _text(name: str, old: str, new: str) -> Callable[[Path], None]:
    def forge(folder: Path) -> None:
        path = _survey(folder) / name
        text = path.read_text(encoding="utf-8")
        assert old in text
        path.write_text(text.replace(old, new, 1), encoding="utf-8", newline="")

    return forge


def _index(folder: Path) -> None:
    edited_index(
        Store(str(folder / "store")), "value", lambda values: [each / 2 for each in values]
    )


def _result_of_table(folder: Path) -> None:
    table_in(folder).write_bytes(to_parquet(table_of_ours(table_in(folder)), "0" * 64))


FORGERIES: dict[str, tuple[Callable[[Path], object], str]] = {
    "a value in the table": (_value("value", 0.1), "custody-table"),
    "an uncertainty in the table": (_value("u", 0.1), "custody-table"),
    "a value in the table, with its hash": (
        lambda f: _with_hashes(f, _value("value", 0.1)),
        "custody-table",
    ),
    "the table of another machine": (_exchanged, "custody-table"),
    "the statistics of the table": (_statistics, "custody-table-bytes"),
    "the statistics of the table, with its hash": (
        lambda f: _with_hashes(f, _statistics),
        "custody-table-bytes",
    ),
    "another result named by the table": (_result_of_table, "custody-table-result"),
    "the index": (_index, "custody-table"),
    "the result": (_text("result.json", '"value": ', '"value":  '), "custody-table-result"),
    "the result, with its hash": (
        lambda f: _with_hashes(f, _text("result.json", '"value": ', '"value":  ')),
        "custody-table-result",
    ),
    "the readings": (_text("readings.csv", "1", "2"), "custody-stored"),
    "a hash in the list of files": (
        _text(LISTED, '"readings.csv": "', '"readings.csv": "0'),
        "custody-refused",
    ),
    "the list of files without one": (
        _text(LISTED, "readings.csv", "readings.old"),
        "custody-refused",
    ),
    "a log of another survey": (
        lambda f: shutil.copy(
            next(_survey(f, "Mill 8").glob("*.mcap")), next(_survey(f).glob("*.mcap"))
        ),
        "custody-stored",
    ),
    "a log of another survey, with its hash": (
        lambda f: _with_hashes(
            f,
            lambda g: shutil.copy(
                next(_survey(g, "Mill 8").glob("*.mcap")), next(_survey(g).glob("*.mcap"))
            ),
        ),
        "custody-stored",
    ),
    "the survey gone": (lambda f: table_in(f).unlink(), "custody-no-survey"),
}


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("name", FORGERIES)
def test_forgery_is_named_by_its_link(name: str, folder: Path) -> None:
    forge, link = FORGERIES[name]
    forge(folder)
    assert verdict(folder) == link
    told = stepdiag("verify", folder / "c.xml", "--custody", folder / "store")
    assert (told.code, told.out.startswith("WRONG c.xml: ")) == (5, True)


@pytest.mark.usefixtures("quick")
def test_every_flipped_bit_of_the_survey_is_found(folder: Path) -> None:
    """Any bit of table, index, list, result, log and the other files of the survey;
    `benchmarks.custody` flips 10,000."""
    files = [
        table_in(folder),
        folder / "store" / INDEX,
        *sorted(path for path in _survey(folder).rglob("*") if path.is_file()),
    ]
    rng = np.random.default_rng(46)
    for turn in range(5 * len(files)):
        with flipped(files[turn % len(files)], rng):
            assert verdict(folder), f"{files[turn % len(files)].name}, turn {turn}"
    assert verdict(folder) == ""


def test_flipped_bit_is_named_by_the_check_and_shows_no_other_figure(folder: Path) -> None:
    """Any bit of any file of a store: `archive check` names it, and `trend` shows the same figures
    or names what it left out."""
    store, rng = Store(str(folder / "store")), np.random.default_rng(47)
    assert list(check(store)) == []
    before = shown(store)
    files = [path for path in sorted((folder / "store").rglob("*")) if path.is_file()]
    for turn in range(4 * len(files)):
        path = files[turn % len(files)]
        with flipped(path, rng):
            if path.name == MARK:
                # it holds no figure; a store that is opened requires its format and version
                continue
            assert list(check(store)), f"{path.name}, turn {turn}"
            assert shown(store) in (before, "named"), f"{path.name}, turn {turn}"
    Path(store.path(INDEX)).unlink()
    assert shown(store) == before, "without the index the tables give the same figures"


def shown(store: Store) -> str:
    """Return every figure that `trend` shows, or that a table was named."""
    try:
        history = history_in(store, NOW)
    except StepdiagError:
        return "named"
    if any(each.damaged for each in history.left_out):
        return "named"
    return "\n".join(
        f"{each.machine} {each.quantity} {each.shown.tolist()} {each.values.tolist()} "
        f"{each.u.tolist()}"
        for each in history.series
    )


def test_check_reads_a_store_whole(folder: Path) -> None:
    told = stepdiag("archive", "check", folder / "store")
    assert (told.code, "is undamaged and contains 2 surveys" in told.out) == (0, True)
    (_survey(folder) / "readings.csv").write_text("", encoding="utf-8")
    (_survey(folder, "Mill 8") / "result.json").unlink()
    told = stepdiag("archive", "check", folder / "store")
    assert (told.code, "2 damaged" in told.refusal) == (3, True)


def test_survey_solved_anew_is_under_hashes_of_its_own(folder: Path) -> None:
    store = Store(str(folder / "store"))
    place = next(each for each in store.tables() if "Mill 7" in each.machine)
    text = (_survey(folder) / "result.json").read_text(encoding="utf-8")
    resolve._kept(
        store,
        place,
        text,
        text.replace(f'"{json.loads(text)["software"]["version"]}"', '"99.0"'),
    )
    assert list(check(store)) == []
    anew = place._replace(software="99.0")
    for file in (anew.table, anew.listed, f"{anew.folder}/result.json"):
        with flipped(Path(store.path(file)), np.random.default_rng(3)):
            assert [name for name, _ in check(store)] == [anew.folder]


def test_store_of_an_older_version_names_no_result(folder: Path) -> None:
    """A table without the SHA-256 and a list without the table are walked by their numbers."""
    path = table_in(folder)
    path.write_bytes(to_parquet(table_of_ours(path)))
    listed = _survey(folder) / LISTED
    known = json.loads(listed.read_text(encoding="utf-8"))
    del known["table"]
    listed.write_bytes(json.dumps(known, indent=1, sort_keys=True).encode() + b"\n")
    assert verdict(folder) == ""
    _value("value", 0.1)(folder)
    assert verdict(folder) == "custody-table"


def test_other_places_are_no_store(folder: Path) -> None:
    with pytest.raises(UsageError):
        verify_in_store(folder / "c.xml", str(folder))
    with pytest.raises(DataError):
        verify_in_store(folder / "laboratory.toml", str(folder / "store"))
