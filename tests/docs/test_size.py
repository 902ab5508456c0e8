"""Every room of the product has its reason in docs/size.md."""

import re
from pathlib import Path

CHECKOUT = Path(__file__).parents[2]
FLOORS = ("daq", "exporters", "solver", "stepdiag")


def test_every_room_has_a_row_with_its_reason() -> None:
    text = (CHECKOUT / "docs" / "size.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([\w/]+)/` \| \d+ \| \S.*\|$", text, flags=re.MULTILINE)
    rooms = {
        path.parent.relative_to(CHECKOUT).as_posix()
        for floor in FLOORS
        for path in (CHECKOUT / floor).resolve().rglob("*.py")
    }
    assert sorted(rows) == sorted(rooms)
