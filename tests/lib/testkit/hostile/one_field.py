"""Files that are right but for one field: a value of another kind, beyond its range, or too long;
the field missing or doubled.

Bytes changed at random mostly end in the first parser; one field wrong gets past it, to what
believes that parsers have checked.
"""

import json
import random
import re
from collections.abc import Iterator

NUMBERS = (
    "0",
    "-1",
    "1e-320",
    "1e9",
    "1e300",
    "-1e300",
    "123456789012345678901234567890",
    "0.1",
    "3",
)
LONG = '"' + "x" * 100_000 + '"'
FORGED = '"a\\nb: forged"'
JSON_VALUES = (
    *NUMBERS,
    "null",
    "true",
    '""',
    '"x"',
    '"\\u0000"',
    FORGED,
    "[]",
    "{}",
    "[[[[1]]]]",
    LONG,
    "NaN",
    "-Infinity",
)
TOML_VALUES = (
    *NUMBERS,
    "nan",
    "-inf",
    "true",
    '""',
    '"x"',
    '"\\u0001"',
    FORGED,
    '"../../x"',
    "[]",
    "{}",
    "[[1], [2]]",
    LONG,
)
CSV_VALUES = (
    *NUMBERS,
    "nan",
    "inf",
    "",
    "x",
    '"',
    "ppp+1",
    "linear-x",
    " ",
    "1,2",
    "ä" * 1000,
)
WORDS = (
    *NUMBERS,
    "nan",
    "-inf",
    "",
    "x",
    "../../x",
    "1,5",
    "0x10",
    "1_0",
    "\u0661",
    "\0",
    "+-1",
    "9" * 5000,
)


def wrong_json(text: str, dice: random.Random) -> str:
    """Return a JSON text with one value, key or element wrong."""
    tree = json.loads(text)
    path = dice.choice(list(_paths(tree)))
    place = tree
    for step in path[:-1]:
        place = place[step]
    match dice.choice(("value", "value", "value", "missing", "doubled")):
        case "missing":
            del place[path[-1]]
        case "doubled" if isinstance(place, list):
            place.insert(path[-1], place[path[-1]])
        case _:
            place[path[-1]] = "@@wrong@@"
    return json.dumps(tree, ensure_ascii=False).replace(
        '"@@wrong@@"', dice.choice(JSON_VALUES), 1
    )


def _paths(
    tree: object, above: tuple[int | str, ...] = ()
) -> Iterator[tuple[int | str, ...]]:
    items = (
        tree.items()
        if isinstance(tree, dict)
        else enumerate(tree)
        if isinstance(tree, list)
        else ()
    )
    for key, value in items:
        yield (*above, key)
        yield from _paths(value, (*above, key))


def wrong_toml(text: str, dice: random.Random) -> str:
    """Return a TOML text with one setting or table wrong."""
    lines = text.splitlines()
    places = [
        number for number, line in enumerate(lines) if re.match(r"\s*(\w+\s*=|\[)", line)
    ]
    number = dice.choice(places)
    key, equals, _ = lines[number].partition("=")
    match dice.choice(("value", "value", "value", "missing", "doubled", "unknown")):
        case "missing":
            lines[number] = ""
        case "doubled":
            lines.insert(number, lines[number])
        case "value" if equals:
            lines[number] = f"{key}= {dice.choice(TOML_VALUES)}"
        case _:
            lines.insert(number + 1, f"unknown_{number} = {dice.choice(TOML_VALUES)}")
    return "\n".join(lines) + "\n"


def wrong_csv(text: str, dice: random.Random) -> str:
    """Return a CSV text with one field, row or column wrong."""
    rows = [line.split(",") for line in text.splitlines()]
    row = dice.randrange(len(rows))
    column = dice.randrange(len(rows[row]))
    match dice.choice(("value", "value", "value", "missing", "doubled", "column")):
        case "missing":
            del rows[row]
        case "doubled":
            rows.insert(row, rows[row])
        case "column":
            rows = [
                [field for place, field in enumerate(each) if place != column]
                for each in rows
            ]
        case _:
            rows[row][column] = dice.choice(CSV_VALUES)
    return "\n".join(",".join(each) for each in rows) + "\n"


def wrong_words(text: str, dice: random.Random) -> str:
    """Return a text of any form with one word or line wrong: another value, missing, doubled, or
    out of its place."""
    lines = text.splitlines(keepends=True)
    row = dice.randrange(len(lines))
    match dice.choice(("word", "word", "word", "missing", "doubled", "moved")):
        case "missing":
            del lines[row]
        case "doubled":
            lines.insert(row, lines[row])
        case "moved":
            lines.insert(dice.randrange(len(lines)), lines.pop(row))
        case _ if words := list(re.finditer(r"[^\s=,:;\[\]()]+", lines[row])):
            word = dice.choice(words)
            lines[row] = (
                lines[row][: word.start()] + dice.choice(WORDS) + lines[row][word.end() :]
            )
    return "".join(lines)
