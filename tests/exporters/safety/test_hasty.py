"""Sequences of a hasty engineer: none ends with exit code 0 and a machine that is worse than
before."""

from collections import Counter

from testkit.exact.hasty import NEEDED, lived, stories
from testkit.examples import spread


def test_no_hasty_sequence_ends_quietly_with_a_worse_machine(tmp_path) -> None:
    """Old tables, half switched, loaded twice or half, edited, of another machine, listed wrongly;
    right ones go through. Every sixth sequence, all in `make explore` and `benchmarks.hasty`."""
    quiet, stopped, refused = [], Counter(), []
    told = spread(list(enumerate(stories())), 6)
    for number, story in told:
        why, before, after = lived(story, number, tmp_path / f"{number}")
        stopped[why] += 1
        if not why and after > 1.02 * before + 0.3:
            quiet.append(f"{story}: {before:.2f} -> {after:.2f} um")
        if why not in ("", NEEDED) and story.right:
            refused.append(f"{story}: {why}")
    assert quiet == []
    assert refused == []
    assert len(told) >= 16
    assert min(stopped["read back"], stopped["loading"]) >= 1
