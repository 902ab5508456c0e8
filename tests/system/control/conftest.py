"""The survey of the leaning machine that several tests begin with."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from testkit.linuxcnc.job import surveyed
from testkit.linuxcnc.machine import BOX, DIAGONALS, angles_of, leaning_machine
from testkit.linuxcnc.rig import linuxcnc


@pytest.fixture(scope="session")
def first_survey(
    tmp_path_factory: pytest.TempPathFactory,
) -> Callable[[], tuple[Path, float]]:
    """Return a call that drives the survey once, and what it comes to: its folder, which nobody
    writes to, and what the machine errs with nothing loaded.

    A call, and no fixture that is ready: where a busy computer lost it, the test that asked is
    tried again and drives it again.
    """

    @cache
    def driven() -> tuple[Path, float]:
        machine, folder = leaning_machine(), tmp_path_factory.mktemp("control")
        (folder / "angles.csv").write_text(angles_of(machine), encoding="utf-8")
        with linuxcnc(swift=True) as control:
            return surveyed(
                control, machine, folder, (*DIAGONALS, "linear-x", "linear-y"), BOX, BOX
            )

    return driven
