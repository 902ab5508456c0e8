"""The table of usual sizes in docs/uncertainty.md shows the sizes that the program uses."""

import re
from pathlib import Path

from stepdiag.base.conditions.assumptions import CLASSES

PAGE = (Path(__file__).parents[2] / "docs" / "uncertainty.md").read_text(encoding="utf-8")


def sizes(name):
    row = re.search(
        rf"^\| `{name}`[^|]*\|([^|]+)\|([^|]+)\|([^|]+)\|", PAGE, flags=re.MULTILINE
    )
    return dict(zip(("good", "ordinary", "poor"), map(float, row.groups()), strict=True))


def test_the_page_shows_the_usual_sizes_of_each_class():
    single = (
        "angles_urad",
        "repeatability_um",
        "setup_c",
        "growth_um_m",
        "drift_um",
        "wander_um",
    )
    assert {name: sizes(name) for name in single} == {
        name: {kind: usual[name] for kind, usual in CLASSES.items()} for name in single
    }
