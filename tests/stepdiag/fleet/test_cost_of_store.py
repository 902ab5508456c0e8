"""What a store may cost that another hand altered: every door of it, with each of its files made to
cost as much as it can.

Each file and each door once in every run, all of them with each other by ``make explore``.
"""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from stepdiag.fleet import tables
from stepdiag.fleet.archive import add, refresh_index
from stepdiag.fleet.store import INDEX, LISTED, MARK, Store, sealed
from stepdiag.fleet.tables import to_parquet
from stepdiag.fleet.tolerances import FILE
from testkit.fleets import finished_survey
from testkit.forgeries import listed_anew
from testkit.hostile.cost import EVERY, GROWN, cost_of
from testkit.hostile.door import Door

DOORS = {
    "trend": ("trend", "store"),
    "check": ("archive", "check", "store"),
    "resolve": ("resolve", "store"),
    "add": ("archive", "add", "survey/0001", "--to", "store"),
}
TEXTS = (MARK, FILE, LISTED, "result.json", "result.json.sha256")
TABLES = ("rows", "index", "lists of the index")
ROWS = 1_000_000


def by_turns(names: tuple[str, ...]) -> list[tuple[str, str]]:
    every = [
        (door, name, at + turn)
        for turn, door in enumerate(DOORS)
        for at, name in enumerate(names)
    ]
    return [(door, name) for door, name, turn in every if EVERY or turn % len(DOORS) == 0]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Return the files of a survey and of the store that holds it, by their place."""
    folder = tmp_path_factory.mktemp("works")
    made = finished_survey(folder / "survey")
    store = Store(str(folder / "store"), create=True)
    add(made, store)
    refresh_index(store, most_loose=0)
    (folder / "store" / FILE).write_text("[all]\nvolumetric-rms = 15.0\n", encoding="utf-8")
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def place_of(whole: dict[str, bytes], name: str) -> str:
    return next(
        place for place in whole if place.startswith("store/") and place.endswith(name)
    )


@pytest.mark.parametrize(("door", "name"), by_turns(TEXTS))
def test_a_text_of_a_store_costs_no_more_than_its_bytes_justify(
    whole: dict[str, bytes], door: str, name: str, tmp_path: Path
) -> None:
    kinds = list(GROWN)
    kind = kinds[(list(DOORS).index(door) * len(TEXTS) + TEXTS.index(name)) % len(kinds)]
    place = place_of(whole, f"/{name}")
    altered = GROWN[kind](whole[place].decode("utf-8"))
    made = Door(
        DOORS[door],
        {},
        "",
        lambda text, _: text,
        bytes_beside={**whole, place: altered.encode("utf-8")},
    )
    assert not cost_of(made, tmp_path / "door"), kind


def equal_rows(schema: pa.Schema, count: int, length: int) -> pa.Table:
    """Return equal rows that are small as a file, lists of so many numbers."""
    columns = {}
    for each in schema:
        if isinstance(each.type, pa.DictionaryType):
            columns[each.name] = pa.DictionaryArray.from_arrays(
                pa.array(np.zeros(count, dtype=np.int32)), pa.array(["um"])
            )
        elif pa.types.is_list(each.type):
            ends = pa.array(np.arange(count + 1, dtype=np.int32) * length)
            columns[each.name] = pa.ListArray.from_arrays(
                ends, pa.array(np.zeros(count * length)).cast(each.type.value_type)
            )
        else:
            columns[each.name] = pa.array(np.zeros(count, dtype=np.int64)).cast(each.type)
    return pa.table(columns, schema=schema)


@pytest.mark.parametrize(("door", "what"), by_turns(TABLES))
def test_a_table_of_a_store_costs_no_more_than_it_may(
    whole: dict[str, bytes], door: str, what: str, tmp_path: Path
) -> None:
    """A million equal rows, or lists of a million numbers, under a hash that is right."""
    schema = tables.SCHEMA if what == "rows" else tables.INDEX_SCHEMA
    table = equal_rows(schema, *((ROWS, 1) if what != "lists of the index" else (2, ROWS)))
    place, data = place_of(whole, ".parquet" if what == "rows" else INDEX), to_parquet(table)
    made = Door(
        DOORS[door],
        {},
        "",
        lambda text, _: text,
        bytes_beside={**whole, place: data if what == "rows" else sealed(data)},
    )
    made.place(tmp_path / "door")
    if what == "rows":
        store = Store(str(tmp_path / "door/store"))
        listed_anew(store, store.tables()[0])
    placed = {
        str(path.relative_to(tmp_path / "door")): path.read_bytes()
        for path in (tmp_path / "door").rglob("*")
        if path.is_file()
    }
    assert not cost_of(
        Door(DOORS[door], {}, "", lambda text, _: text, bytes_beside=placed),
        tmp_path / "again",
    )
