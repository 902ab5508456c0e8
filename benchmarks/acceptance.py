"""How often is a machine accepted that stands exactly at its tolerance? ``python -m benchmarks.acceptance --surveys 2000``.

Surveys of exact machines drawn from the assumed sizes (`false_alarms.judge_survey`); the tolerance of each is its own true volumetric error
(rms), so that "conform" is a false acceptance and "not conform" a false rejection. Stated are 2.5 % of each (ISO 14253-1, guard band U).
"""

import argparse

from benchmarks.false_alarms import judge_survey
from stepdiag.base.conformity import verdict_of

FIRST = 460_000
"""Seeds that nothing else draws."""


def main() -> None:
    """Count and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--surveys", type=int, default=2000)
    parser.add_argument("--first", type=int, default=FIRST)
    given = parser.parse_args()
    count = {"conform": 0, "not_conform": 0, "not_decidable": 0, "no result": 0}
    for seed in range(given.first, given.first + given.surveys):
        told = judge_survey(seed, "stated").before
        count["no result" if told is None else verdict_of(told.low, told.high, told.true)] += 1
    judged = given.surveys - count["no result"]
    print(f"{judged} machines at their limit: {count}")
    for name in ("conform", "not_conform"):
        print(f"{name}: {100.0 * count[name] / max(judged, 1):.1f} %")


if __name__ == "__main__":
    main()
