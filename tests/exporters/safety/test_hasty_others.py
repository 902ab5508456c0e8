"""Sequences of a hasty engineer at controls that no program guards: none ends with exit code 0 and
a machine that is worse than before."""

import pytest

from testkit.exact.others import MAKERS, NEEDED, Story, lived, stories, worse
from testkit.examples import spread

DRAWN = len(spread(range(4), 2))
"""Sequences of each control in a run of the tests; `benchmarks.hasty` goes through all."""


def some(maker: str) -> list[Story]:
    every = [story for story in stories() if story.maker == maker]
    return every[MAKERS.index(maker) :: len(every) // DRAWN]


@pytest.mark.parametrize("maker", MAKERS)
def test_no_hasty_sequence_ends_quietly_with_a_worse_machine(maker: str, tmp_path) -> None:
    """What is stated wrongly, listed wrongly, loaded half, twice, of another machine or in another
    size is stopped by a command; right sequences go through."""
    for number, story in enumerate(some(maker)):
        why, before, after = lived(story, 300 + number, tmp_path / f"{number}")
        assert why or not worse(before, after), (story, before, after)
        assert not story.right or why in ("", NEEDED), (story, why)
