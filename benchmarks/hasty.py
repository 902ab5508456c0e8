"""Sequences of a hasty engineer, with seeds: ``python -m benchmarks.hasty
[ROUNDS] [proof | others]``

Each ends with reading back what the control holds, or with a proof run; "others" are the controls
beside the SINUMERIK (`testkit.exact.others`). Counts the sequences
(`testkit.exact.hasty`) that end with exit code 0 and a machine that is worse, what stops the
others, and the right ones that are refused. A right sequence states what was on, and loads its own
files as a whole.
"""

import sys
import tempfile
from collections import Counter
from pathlib import Path

ROUNDS, FIRST_SEED = 8, 5000


def print_sequences(rounds: int, how: str = "") -> None:
    """Print the counts of so many rounds over all sequences, each on a machine of its own."""
    from testkit.exact import hasty, others

    def at_sinumerik(story: hasty.Story, seed: int, folder: Path) -> tuple[str, float, float]:
        ended: tuple[str, float, float] = hasty.lived(
            story, seed, folder, proof=how == "proof"
        )
        return ended

    stories, lived = (
        (others.stories, others.lived) if how == "others" else (hasty.stories, at_sinumerik)
    )
    ends: Counter[str] = Counter()
    quiet, refused, needed, of = [], 0, 0, 0
    with tempfile.TemporaryDirectory() as folder:
        for number, story in enumerate(each for _ in range(rounds) for each in stories()):
            seed = FIRST_SEED + number
            why, before_um, after_um = lived(story, seed, Path(folder) / f"{number}")
            ends[why if why.startswith("proof") else why.partition(":")[0] or "loaded"] += 1
            if not why and others.worse(before_um, after_um):
                quiet.append(f"{story}, seed {seed}: {before_um:.2f} -> {after_um:.2f} um")
            of += story.right
            refused += story.right and why not in ("", others.NEEDED)
            needed += story.right and why == others.NEEDED
    print(
        f"{sum(ends.values())} sequences: "
        f"{', '.join(f'{end} {count}' for end, count in ends.most_common())}"
    )
    print(
        f"{len(quiet)} end with exit code 0 and a machine that is worse; {refused} of {of} right "
        f"ones are refused, {needed} need a proof run"
    )
    print("\n".join(quiet))


if __name__ == "__main__":
    print_sequences(int(sys.argv[1]) if len(sys.argv) > 1 else ROUNDS, "".join(sys.argv[2:]))
