"""How the property tests draw: the same examples in every `make test`, new ones with
``--hypothesis-profile explore``.

And what one process does, one after the other, where several share the tests: pytest-xdist 3.8
reads its own mark ``xdist_group`` no more with pytest 9.2, without a word.
"""

import gc
import os
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, settings
from xdist.scheduler import LoadScopeScheduling

from testkit.running.steady import run_steadily

os.environ.setdefault(
    "OPENBLAS_NUM_THREADS", "1"
)  # as the program does, and before numpy is loaded
# `python -m stepdiag` begins its search in the working directory: what a test starts would be the
# checkout, not the wheel that is tested
os.environ["PYTHONSAFEPATH"] = "1"

# A change is judged by what it did, not by the luck of the draw nor by how busy the machine is;
# `make explore` looks for new examples.
BUSY = [HealthCheck.too_slow]
settings.register_profile(
    "steady",
    max_examples=40,
    derandomize=True,
    deadline=None,
    database=None,
    print_blob=True,
    suppress_health_check=BUSY,
)
settings.register_profile(
    "explore", derandomize=False, deadline=None, print_blob=True, suppress_health_check=BUSY
)
# of a changed program only whether a test notices it is asked (tools/mutants): few examples, and
# none made smaller
settings.register_profile(
    "mutants",
    settings.get_profile("steady"),
    max_examples=25,
    phases=[Phase.explicit, Phase.generate],
)
settings.load_profile("steady")

gc.disable()  # until all tests are read: a sixth of the time that this takes

TOGETHER = {
    "there is one Debian to boot": (
        "tests/system/service/test_deb.py",
        "tests/system/service/test_systemd_boot.py",
        "tests/system/service/test_unit_elsewhere.py",
    ),
    "one server, and one survey that it serves": ("tests/system/service/test_opcua.py",),
    "one server among strangers": ("tests/system/service/test_opcua_strangers.py",),
    "one page with a token": ("tests/system/faults/test_page_access.py",),
    "one archive of surveys": ("tests/system/service/test_resolve.py",),
    "the sources are read once": ("tests/stepdiag/texts/test_findings.py",),
    "usual surveys are solved once (testkit.exact.surveys.solved)": (
        "tests/solver/methods/test_estimate.py::test_four_diagonals_and_three_linear_runs",
        "tests/stepdiag/api/test_tables.py",
        "tests/solver/methods/test_estimate.py::test_angular_errors_known_to_one_microradian",
        "tests/solver/methods/test_estimate.py::test_stated_uncertainties_of_the_usual_survey",
        "tests/solver/adjustment/test_faults.py::test_good_surveys_are_left_alone",
    ),
}
"""Beginnings of the names of tests that one process runs."""

LONGEST = (
    "tests/stepdiag/cli/test_every_option.py",
    "tests/solver/planning/test_planner.py",
    "tests/solver/methods/test_positions.py",
    "tests/daq/capture/references/test_references.py",
    "tests/daq/capture/test_cause.py",
    "tests/solver/model/test_lateral.py",
    "tests/stepdiag/comparing/test_compare.py",
    "tests/solver/references/test_references.py",
    "tests/stepdiag/certificate/test_custody.py",
    "tests/stepdiag/certificate/test_report_beside.py",
    "tests/fuzz/test_command_line.py",
    "tests/system/service/test_demo_live.py",
    "tests/system/recording/test_proof_run.py",
    "tests/system/recording/test_commission_head.py",
    "tests/system/recording/test_further_setup.py",
    "tests/system/recording/test_no_signals.py",
    "tests/system/service/test_opcua_strangers.py",
    "tests/system/service/test_opcua.py",
    "tests/system/shop/test_bad_instruments.py",
    "tests/system/faults/test_page_access.py",
    "tests/system/recording/test_survey_end_to_end.py",
    "tests/system/recording/test_soak.py",
    "tests/system/shop/test_angles.py",
    "tests/page/test_real_daemon.py",
    "tests/page/test_stages.py",
    "tests/page/test_screens.py",
    "tests/page/test_commands.py",
    "tests/page/test_liveness.py",
)
"""Beginnings of the names of the tests that are begun first, in this order: one that begins last is
waited for alone."""

FOLDERS = {
    "system": "tests/system/",
    "control": "tests/system/control/",
    "page": "tests/page/",
}
"""Where the tests of a mark stand: each group of tools/test reads its own folder alone."""

COMING = Path(__file__).parents[1] / ".setup" / "coming"


class Together(LoadScopeScheduling):
    """Each file goes to whoever is free, in the system tests each test, but for those of
    `TOGETHER`.

    What the tests of a file share is made once, and who hands them out has 210 things to keep
    account of, not 6,000.
    """

    def _split_scope(self, nodeid: str) -> str:
        alone = nodeid if nodeid.startswith(FOLDERS["system"]) else nodeid.partition("::")[0]
        return next(
            (why for why, names in TOGETHER.items() if nodeid.startswith(names)), alone
        )


@pytest.hookimpl(tryfirst=True, optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    return Together(config, log) if config.getvalue("dist") == "loadgroup" else None


def pytest_runtest_protocol(item, nextitem):
    """Real time and real lines are in these two groups alone."""
    return (
        run_steadily(item, nextitem)
        if item.get_closest_marker("system") or item.get_closest_marker("page")
        else None
    )


@pytest.fixture(scope="session")
def debian():
    """Wait for the packages of Debian while `make test` installs them (tools/test)."""
    while COMING.exists():
        time.sleep(0.2)


def pytest_collection_finish():
    """Six thousand tests and all that they import stay until the end: nobody looks through them for
    what could be freed, while they are read neither."""
    gc.collect()
    gc.freeze()
    gc.enable()


def pytest_unconfigure():
    """What was frozen goes at the end as it came, or duckdb takes it for leaked and says so on
    sixty lines a process."""
    gc.unfreeze()


def pytest_collection_modifyitems(items):
    """Refuse a marked test outside the folder of its group, which no group would run; begin with
    the longest."""
    marked = (
        (item, folder)
        for item in items
        for mark, folder in FOLDERS.items()
        if item.get_closest_marker(mark)
    )
    lost = [item.nodeid for item, folder in marked if not item.nodeid.startswith(folder)]
    if lost:
        raise pytest.UsageError(
            f"these tests stand outside the folder of their group ({FOLDERS}) and would never "
            f"run: {', '.join(lost)}"
        )
    items.sort(
        key=lambda item: next(
            (rank for rank, name in enumerate(LONGEST) if item.nodeid.startswith(name)),
            len(LONGEST),
        )
    )
