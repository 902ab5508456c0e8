"""Recorded inputs give what they gave (tests/data/reference/README.md)."""

import pytest

from testkit.references import check, files
from testkit.references.exporters import CALLS, GROUPS, group_of


@pytest.mark.parametrize("path", files("exporters"), ids=lambda path: path.stem)
def test_the_exporters_make_of_a_recorded_input_what_they_made(path):
    check(path, CALLS)


@pytest.mark.parametrize("call", GROUPS)
def test_every_case_stands_in_a_file(call):
    kept = {path.stem for path in files("exporters")}
    assert {f"{call}-{group_of(call, name)}" for name in GROUPS[call][0]()} <= kept
