"""Every file door of the command line, with files that are right but for one field: a command is
done or refused in words, never broken."""

import os
import random
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from testkit.examples import spread
from testkit.hostile.door import how_it_broke
from testkit.hostile.doors import NEVER_DONE, doors

EXAMPLES = max(1, int(os.environ.get("STEPDIAG_FUZZ_EXAMPLES", "60")) // 60)
DOORS = doors()


@pytest.mark.parametrize("name", spread([*DOORS], 3))
def test_one_field_wrong_is_done_or_refused_in_words(
    name: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    door = DOORS[name]

    @settings(max_examples=EXAMPLES, suppress_health_check=list(HealthCheck), deadline=None)
    @given(st.integers(0, 2**32))
    def run(seed: int) -> None:
        text = door.change(door.files[door.wrong], random.Random(seed))
        assert not how_it_broke(door.with_text(text), tmp_path_factory.mktemp("door"))

    run()


@pytest.mark.parametrize("name", DOORS)
def test_the_right_files_pass(name: str, tmp_path: Path) -> None:
    """Else all that the test above tries would be refused before it is looked at."""
    told = DOORS[name].go_through(tmp_path)
    assert told.code == NEVER_DONE.get(name, 0), told
