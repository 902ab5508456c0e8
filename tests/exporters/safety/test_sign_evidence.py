"""A sign test is held like a survey: its runs follow the known curve, and its record is evidence
for what it names alone."""

from dataclasses import replace
from datetime import date

import numpy as np
import pytest

from stepdiag.base.errors import DataError
from stepdiag.base.readings.readings import make_readings
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.safety.sign_evidence import (
    Subject,
    known_um,
    record,
    require_sound,
    subject,
)
from stepdiag.exporters.safety.sign_run import SignRun, from_readings
from stepdiag.exporters.safety.sign_test import bump, verdict
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME, made_result

CONTROL = controller_named("siemens")
PROFILE = profile_of("siemens", VOLUME, sections=8)
AT = np.linspace(-200.0, 200.0, 17)
NODES = VOLUME.nodes_mm(0)
MACHINES = 100


def curve(dice: np.random.Generator) -> list[float]:
    """Draw the positioning error of an axis at the nodes of a survey."""
    along = np.linspace(0.0, 1.0, len(NODES))
    bows = 6.0 * dice.normal() * np.sin(np.pi * along) + 3.0 * dice.normal() * np.sin(
        2.0 * np.pi * along
    )
    return list(bows + 10.0 * dice.normal() * along)


def runs(dice: np.random.Generator, own: list[float], sense: float = 1.0) -> SignRun:
    """Drive both runs: scatter of 0.3 um, and a beam that leans a little differently in each."""
    known = np.interp(AT, NODES, own)
    bumped = sense * bump(CONTROL, PROFILE, "EXX").moved_um(AT)
    off, on = (
        um + 0.3 * dice.normal(size=17) + 0.002 * dice.normal() * AT
        for um in (known, known + bumped)
    )
    return SignRun(AT, off, on, grows=True)


def refused(run: SignRun, own: list[float], function: str = "EXX") -> str:
    """Return what a pair of runs is refused for, or nothing."""
    test = bump(CONTROL, PROFILE, function)
    try:
        require_sound(
            test,
            run,
            known_um(made_result({function: own}), CONTROL, PROFILE, test, run.position_mm),
        )
    except DataError as error:
        return str(error)
    return ""


def test_right_runs_pass_and_show_the_sense_of_the_control() -> None:
    """Of 200 good pairs of runs, half on a control of the opposite sense, less than 2 % are
    refused, and no sense is wrong."""
    stopped, wrong = 0, 0
    for seed in range(MACHINES):
        dice = np.random.default_rng(seed)
        for sense, word in ((1.0, "as-error"), (-1.0, "as-compensation")):
            own = curve(dice)
            run = runs(dice, own, sense)
            stopped += bool(refused(run, own))
            wrong += verdict(bump(CONTROL, PROFILE, "EXX"), *run[:3]).sense != word
    assert (stopped, wrong) == (0, 0)


def test_swapped_runs_are_named() -> None:
    """Both senses: without the known curve each would be recorded as the other one."""
    for seed in range(MACHINES):
        dice = np.random.default_rng(seed)
        own = curve(dice)
        run = runs(dice, own, (1.0, -1.0)[seed % 2])
        assert "the two runs are swapped" in refused(
            run._replace(off_um=run.on_um, on_um=run.off_um), own
        )


def test_a_table_that_was_on_in_both_runs_is_named() -> None:
    dice = np.random.default_rng(1)
    own = curve(dice)
    run = runs(dice, own)
    assert "the bump in both runs" in refused(run._replace(off_um=run.on_um), own)


def test_a_dial_that_counts_backwards_is_named_or_refused() -> None:
    """A dial shows no growth: the known curve alone shows its direction, and one that is too flat
    decides nothing."""
    named = 0
    for seed in range(MACHINES):
        dice = np.random.default_rng(seed)
        own = curve(dice)
        run = runs(dice, own)
        found = refused(run._replace(off_um=-run.off_um, on_um=-run.on_um, grows=False), own)
        assert found
        named += "counts backwards" in found
    assert named > 0.8 * MACHINES
    flat = refused(runs(np.random.default_rng(0), [0.0] * 5)._replace(grows=False), [0.0] * 5)
    assert "too flat to show" in flat


def test_runs_of_another_machine_are_refused() -> None:
    passed = 0
    for seed in range(MACHINES):
        dice = np.random.default_rng(seed)
        passed += not refused(runs(dice, curve(dice)), curve(dice))
    assert (
        passed < 0.35 * MACHINES
    )  # curves of two bows that are alike by chance; the machine's name is checked beside it


def test_few_positions_are_refused() -> None:
    run = SignRun(AT[::4], 0.0 * AT[::4], 0.0 * AT[::4], grows=True)
    assert "at least 7 positions" in refused(run, [0.0] * 5)


@pytest.mark.parametrize(
    ("factor", "words"),
    [(-1.0, "counts backwards"), (0.5, "the optics' factor is wrong"), (1.0, "")],
)
def test_readings_grow_with_the_position(factor: float, words: str) -> None:
    """A laser that counts backwards turned the verdict, and was recorded as a wrong sense."""
    place = np.column_stack([AT, 0.0 * AT, 0.0 * AT])

    def read(by: float):
        return make_readings(
            setup=["linear-x"] * 17,
            pass_number=[1] * 17,
            stop=range(17),
            position_mm=place,
            reading_mm=by * (AT - AT[0]),
        )

    if not words:
        assert from_readings(read(1.0), read(1.0), "X").grows
        return
    with pytest.raises(DataError, match="table on") as refusal:
        from_readings(read(1.0), read(factor), "X")
    assert words in str(refusal.value)


def kept() -> tuple[Subject, dict[str, object]]:
    test = bump(CONTROL, PROFILE, "EXX")
    own = [0.0, 3.0, 8.0, 4.0, 1.0]
    run = runs(np.random.default_rng(0), own)
    files = [ControlFile(name="off.csv", data=b"1"), ControlFile(name="on.csv", data=b"2")]
    about = subject("siemens", PROFILE)
    made = record(test, verdict(test, *run[:3]), about, date(2026, 6, 1), files)
    return about, {name: getattr(made, name) for name in made.__struct_fields__}


def test_a_record_is_evidence_for_what_it_names_alone() -> None:
    from stepdiag.exporters.tables.profile import SignTestRecord

    about, fields = kept()
    assert about.covers(SignTestRecord(**fields))
    assert len(fields["bump_sha256"]) >= 1
    assert len(fields["runs_sha256"]) == 2
    for name, other in {
        "machine": "its neighbour",
        "control": "fanuc",
        "measuring_system": "2",
        "bump_sha256": [],
        "runs_sha256": [],
    }.items():
        assert not about.covers(SignTestRecord(**{**fields, name: other})), name
    assert not about.covers(
        SignTestRecord(kind="eec", date=date(2026, 6, 1), verdict="as-error")
    )
    assert not replace(about, system="2").covers(SignTestRecord(**fields))
