"""A person does what the words say, and that is the end of it: whole pass, or from the stop named,
with the readings right afterwards."""

import re

import numpy as np
import pytest

from stepdiag.virtual.drive.sequence import Box
from stepdiag.virtual.drive.setups import Alignment
from testkit.exact.driven import BOX_MM, Fault, Program, machine_of, recorded, survey_file
from testkit.fault_cases import COUNTED, STOPPED
from testkit.ordinary.measured import simulate_pass

LAST = 6
FAULTS = [
    pytest.param("beam", 3.3, "", id="beam cut"),
    pytest.param("reset", 0.0, "", id="laser reset"),
    pytest.param("jump", 5.0, "", id="step in the dwell"),
    pytest.param("frozen", 0.0, "", id="frozen reading"),
    pytest.param("slip", 200.0, "", id="slip of the count"),
    pytest.param("unsignalled", 0.0, "", id="stop not signalled"),
    pytest.param("skipped", 0.0, "", id="stop not driven"),
    pytest.param("silent", 1.0, "", id="PLC silent"),
    pytest.param("dead", 3.0, "", id="registers stand still"),
    pytest.param("alarm", 0.0, "", id="alarm"),
    pytest.param("beam", 3.3, STOPPED, id="beam cut, stopped alone"),
    pytest.param("jump", 5.0, STOPPED, id="step in the dwell, stopped alone"),
    pytest.param("cut", 0.05, STOPPED, id="dwell cut short, stopped alone"),
    pytest.param("cut", 0.25, STOPPED, id="dwell cut by half, stopped alone"),
    pytest.param("skipped", 0.0, COUNTED, id="stop not driven, counted"),
]


def driven(folder, signals, faults, *, again):
    """Return the pass of ppp as the book has it, driven once with faults and, where wanted, once
    more."""
    machine = machine_of(1)
    program = Program(machine, faults=faults, seed=1)
    for _ in range(1 + again):
        program.drive("ppp")
    folder.mkdir()
    session, _ = recorded(
        folder, survey_file(signals=signals, setups=("ppp",)), program.events()
    )
    return session.book.passes[0], simulate_pass(
        machine, Box(size_mm=BOX_MM, increments=2), "ppp", 1, alignment=MIRROR
    )


MIRROR = Alignment(mirror_mrad=(0.3, -0.2))


def off_um(each, truth):
    """Return by how much the readings in use are off at the worst stop, counted from the first."""
    read = np.array([stop.reading_mm for stop in each.chosen().values()])
    return (
        float(np.max(np.abs(read - read[0] - (truth.reading_mm - truth.reading_mm[0])))) * 1e3
    )


@pytest.mark.parametrize(("kind", "value", "signals"), FAULTS)
def test_what_the_words_say_is_the_end_of_it(tmp_path, kind, value, signals):
    fault = Fault(kind, "ppp", 1, 3, value)
    first, _ = driven(tmp_path / "once", signals, (fault,), again=False)
    words = str(first.why_incomplete())
    assert words
    assert re.search(
        r"drive (again from stop \d|the whole pass again|the pass again)", words
    ), words
    whole, truth = driven(tmp_path / "whole", signals, (fault,), again=True)
    assert whole.complete, whole.why_incomplete()
    assert off_um(whole, truth) < 0.5
    named = re.search(r"drive again from stop (\d)", words)
    if named:
        back = Fault("abort", "ppp", 1, LAST, LAST - int(named[1]) + 1)
        partly, truth = driven(tmp_path / "partly", signals, (fault, back), again=False)
        assert partly.complete, partly.why_incomplete()
        assert off_um(partly, truth) < 0.5
