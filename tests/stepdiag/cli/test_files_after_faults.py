"""From a fault on the wires to the files in the control: never worse than before, and never much
worse than without the fault, unsaid."""

from functools import cache

import pytest

from testkit.fault_cases import (
    BEGIN,
    CASES,
    CLEAN,
    END,
    FILES,
    PAGE,
    run,
    what_became,
)

QUICK = {
    "positions written with one decimal",
    "by -20 µm, on the first step",
    "aborted and driven again whole",
    "a stop measured again 55 µm off, alone",
    "by 20 µm in a run along an axis",
    "by 2 µm",
}
"""One of each kind; `make faults` runs them all."""


@pytest.fixture(scope="module")
def clean_um(tmp_path_factory):
    done, _ = run(CLEAN, tmp_path_factory.mktemp("clean"))
    assert what_became(done) == FILES
    assert done.after_um < 0.1 * done.before_um
    return done.after_um


@pytest.mark.parametrize(
    "case", [case for case in CASES if case.words in QUICK], ids=lambda case: case.words
)
def test_the_files_after_a_fault(tmp_path, clean_um, case):
    done, said = run(case, tmp_path)
    assert set(case.said) <= said
    assert what_became(done) == case.becomes
    if done.after_um is not None:
        assert done.after_um <= case.most_left_um(clean_um, done)
    else:
        assert all(fault.setup in done.words for fault in case.faults)


@cache
def table():
    return PAGE.read_text(encoding="utf-8").partition(BEGIN)[2].partition(END)[0]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.words)
def test_the_table_of_the_documentation_is_made_of_the_cases(case):
    assert case.row in table()


def test_the_table_has_no_other_rows():
    assert (
        len([line for line in table().splitlines() if line.startswith("|")]) == len(CASES) + 2
    )
