"""Recorded inputs give what they gave (tests/data/reference/README.md)."""

import pytest

from testkit.references import check, files
from testkit.references.solver import CALLS


@pytest.mark.parametrize("path", files("solver"), ids=lambda path: path.stem)
def test_the_solver_makes_of_a_recorded_input_what_it_made(path):
    check(path, CALLS)
