"""The virtual program: where it goes, when it stands, what it counts, and what faults make of
it."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from stepdiag.virtual.base.faults import Fault, FaultBoard
from stepdiag.virtual.drive.player import Drive, Player
from stepdiag.virtual.drive.program import Plan, again, steps
from stepdiag.virtual.drive.sequence import Box, outward_direction
from stepdiag.virtual.drive.setups import aligned_setup
from stepdiag.virtual.instruments.readout import Readout
from stepdiag.virtual.physics.error_functions import Amplitudes, ErrorSet, random_errors
from stepdiag.virtual.physics.machine import Machine
from testkit.ordinary.measured import Conditions, simulate_pass

BOX = Box(size_mm=(100.0, 80.0, 60.0), increments=2)
PLAN = Plan(box=BOX, setups=("npp",), passes=2, dwell_s=1.0, overrun_mm=5.0, pause_s=1.0)


def dwells(*faults, plan=PLAN):
    return [step for step in steps(plan, FaultBoard(faults)) if step.kind == "dwell"]


def test_a_program_stands_at_every_stop_of_both_passes():
    """Contract 1: 3n+1 stops a pass, the return pass in reverse, stops numbered as they are
    visited."""
    standing = dwells()
    assert [(step.pass_number, step.stop) for step in standing] == [
        (p, s) for p in (1, 2) for s in range(7)
    ]
    assert standing[7].target_mm == pytest.approx([0.0, 80.0, 60.0])


def dwelt(plan=PLAN, drive=None, seed=0):
    """Return the segments of all dwells of a program as it is played."""
    dwelling = []
    one = Player(
        steps(plan, FaultBoard()), drive or Drive(), seed=seed, on_enter=dwelling.append
    )
    one.advance(1e6)
    return [segment for segment in dwelling if segment.step.kind == "dwell"]


def test_every_axis_approaches_every_stop_in_the_direction_of_its_pass():
    sides = [segment.approach.tolist() for segment in dwelt()]
    assert sides == [[-1.0, 1.0, 1.0]] * 7 + [[1.0, -1.0, -1.0]] * 7


def test_a_program_without_overrun_leaves_each_axis_on_its_old_side_until_it_moves():
    sides = [segment.approach.tolist() for segment in dwelt(replace(PLAN, overrun_mm=0.0))]
    assert sides[6:11] == [
        [-1.0, 1.0, 1.0],
        [-1.0, 1.0, 1.0],
        [-1.0, 1.0, -1.0],
        [-1.0, -1.0, -1.0],
        [1.0, -1.0, -1.0],
    ]


def test_a_program_without_overrun_at_the_first_stop_comes_straight_to_it():
    """From home (0, 0, 0) to the first stop of npp at (100, 0, 0): X came from below, Y and Z never
    moved; the turn has its overrun."""
    sides = [
        segment.approach.tolist() for segment in dwelt(replace(PLAN, first_overrun=False))
    ]
    assert sides[:4] == [
        [1.0, 0.0, 0.0],
        [-1.0, 0.0, 0.0],
        [-1.0, 1.0, 0.0],
        [-1.0, 1.0, 1.0],
    ]
    assert sides[7] == [1.0, -1.0, -1.0]


def test_an_axis_that_does_not_move_keeps_its_place():
    """Each move of an axis draws one error of arrival along that axis; the standard deviation is
    that of the drive."""
    box = replace(BOX, increments=40)
    stops = dwelt(
        replace(PLAN, box=box, setups=("ppp", "npp", "pnp"), passes=4),
        Drive(repeatability_um=0.5),
    )
    off = np.array([1e3 * (segment.true_to_mm - segment.to_mm) for segment in stops])
    moved = np.diff([segment.to_mm for segment in stops], axis=0) != 0.0
    within = np.array(
        [
            before.step.pass_number == after.step.pass_number
            for before, after in pairwise(stops)
        ]
    )
    held = within[:, None] & ~moved
    assert held.sum() == 2 * 120 * 12
    assert np.all(np.diff(off, axis=0)[held] == 0.0)
    drawn = off[1:][within[:, None] & moved]
    assert np.std(drawn) == pytest.approx(0.5, rel=0.1)
    assert abs(np.mean(drawn)) < 0.05


def test_the_encoders_see_their_part_of_an_arrival():
    stops = dwelt(PLAN, Drive(repeatability_um=0.5, servo_um=2.0), seed=4)
    off = np.array([1e3 * (segment.true_to_mm - segment.to_mm) for segment in stops])
    servo = np.array([segment.servo_um[1] for segment in stops])
    assert np.std(servo) == pytest.approx(2.0, rel=0.3)
    assert np.std(off - servo) == pytest.approx(0.5, rel=0.4)


def test_the_laser_sees_the_component_of_an_arrival_along_the_beam():
    machine = Machine(errors=ErrorSet(low_mm=BOX.origin_mm, size_mm=BOX.size_mm))
    readings = []
    for drive in (Drive(ring_um=0.0), Drive(ring_um=0.0, repeatability_um=20.0)):
        fresh = Player(steps(PLAN, FaultBoard()), drive)
        readout = Readout(
            machine, fresh, drive, lambda name: aligned_setup(machine, BOX, name)
        )
        stops = dwelt(PLAN, drive)
        readings.append(
            np.array(
                [readout.read(np.array([segment.end_s - 1e-6]))[0][0] for segment in stops]
            )
        )
    off = np.array([segment.true_to_mm - segment.to_mm for segment in stops])
    assert readings[1] - readings[0] == pytest.approx(
        off @ outward_direction(BOX, "npp"), abs=1e-6
    )


@pytest.mark.parametrize(
    ("fault", "seen"),
    [
        (Fault(kind="stop-skipped", setup="npp", pass_number=1, stop=2), [0, 1, 3, 4, 5, 6]),
        (
            Fault(kind="program-aborted", setup="npp", pass_number=1, stop=3, value=1),
            [0, 1, 2, 3, 2, 3, 4, 5, 6],
        ),
    ],
)
def test_faults_of_the_program_change_the_stops(fault, seen):
    assert [step.stop for step in dwells(fault) if step.pass_number == 1] == seen


def test_faults_of_the_counter_change_what_a_stop_adds():
    faults = [
        Fault(kind=kind, stop=stop)
        for kind, stop in (("count-missed", 1), ("count-doubled", 2), ("stop-unsignalled", 3))
    ]
    first = dwells(*faults)[:5]
    assert [(step.counts, step.signalled) for step in first] == [
        (1, True),
        (0, True),
        (2, True),
        (0, False),
        (1, True),
    ]


def test_a_wrong_axis_order_is_driven():
    standing = dwells(Fault(kind="axis-order", setup="npp", text="zyx"))
    assert standing[1].target_mm == pytest.approx([100.0, 0.0, 30.0])


def test_a_fault_strikes_once_where_it_is_placed():
    board = FaultBoard(
        (Fault(kind="beam-lost", setup="npp", stop=1, delay_s=0.2, duration_s=1.0),)
    )
    for stop, wall_s in ((0, 5.0), (1, 6.0), (1, 9.0)):
        board.reach("npp", 1, stop, "dwell", wall_s)
    assert board.spans("beam-lost") == [(6.2, 7.2)]
    assert board.active("beam-lost", 6.1) is None
    assert board.active("beam-lost", 7.1) is not None
    assert board.due("beam-lost", 6.3)
    assert not board.due("beam-lost", 6.3)


def test_a_move_is_trapezoidal():
    """100 mm at 6000 mm/min and 1000 mm/s2: 0.1 s and 5 mm in each ramp, 1.1 s in all; 2.5 mm never
    reach the feed."""
    drive = Drive(feed_mm_min=6000.0, acceleration_mm_s2=1000.0)
    assert drive.duration_s(100.0) == pytest.approx(1.1)
    assert 100.0 * drive.fraction(
        100.0, np.array([-1.0, 0.1, 0.55, 1.0, 1.1, 9.0])
    ) == pytest.approx([0, 5, 50, 95, 100, 100])
    assert drive.duration_s(2.5) == pytest.approx(0.1)
    assert drive.fraction(0.0, np.array([0.0])) == 1.0


def player(plan=PLAN, **options):
    return Player(steps(plan, FaultBoard()), Drive(), **options)


def test_the_player_counts_stops_and_finishes():
    played = player()
    last = played.advance(1e6)
    assert played.finished.is_set()
    assert last.stop_count == 14
    assert last.end_s == math.inf


def test_the_handshake_holds_the_machine_until_its_stop_is_captured():
    played = player(handshake=True)
    assert played.advance(1e4).step.stop == 0
    played.capture(7, 1e4)
    assert played.advance(2e4).step.stop == 0
    played.capture(1, 2e4)
    assert played.advance(2e4 + 5.0).step.stop == 1


def test_a_held_dwell_goes_on_until_it_is_let_go():
    held = [True]
    played = player(hold=lambda segment: held[0] and segment.step.stop == 0)
    assert played.advance(100.0).step.stop == 0
    assert played.advance(110.0).step.stop == 0
    held[0] = False
    assert played.advance(112.0).step.stop == 1


def test_a_held_move_stands_in_position_without_saying_so():
    held = [True]
    played = player(
        hold=lambda segment: (
            held[0] and segment.step.kind == "move" and segment.step.stop == 1
        )
    )
    at = played.advance(100.0)
    assert at.step.kind == "move"
    assert Drive().fraction(at.distance_mm, np.array([100.0 - at.start_s])) == 1.0
    held[0] = False
    assert played.advance(101.0).step.kind == "dwell"


def test_a_captured_stop_is_not_held():
    played = player(handshake=True, hold=lambda _: True)
    played.advance(1e4)
    played.capture(1, 1e4)
    assert played.advance(1e4 + 5.0).step.stop == 1


def test_a_program_on_command_waits_for_each_start():
    played = player(Plan(box=BOX, setups=("ppp", "npp"), passes=1, dwell_s=1.0, pause_s=None))
    played.start(0.0)
    assert played.advance(100.0).step.setup == ""
    played.start(100.0)
    assert played.advance(101.0).step.setup in ("", "ppp")
    assert played.advance(1000.0).stop_count == 7
    played.start(1000.0)
    assert played.advance(2000.0).stop_count == 14


def test_the_readout_at_rest_is_the_ideal_reading():
    """Heavy ringing has died at the end of every dwell; between stops the path is continuous to a
    fraction of a micrometre."""
    machine = Machine(
        errors=random_errors(2, (0.0, 0.0, 0.0), BOX.size_mm, Amplitudes(angle_urad=10.0))
    )
    drive = Drive(ring_um=3.0, ring_decay_s=0.02)
    played = Player(steps(PLAN, FaultBoard()), drive)
    ends = []
    for moment in np.arange(0.0, 60.0, 0.5):
        times = moment + np.arange(500) * 1e-3
        for segment in played.span(times[0], times[-1]):
            if segment.step.kind == "dwell" and segment.end_s not in ends:
                ends.append(segment.end_s)
    assert len(ends) == 14
    fresh = Player(steps(PLAN, FaultBoard()), drive)
    readout = Readout(machine, fresh, drive, lambda name: aligned_setup(machine, BOX, name))
    readings = np.array([readout.read(np.array([end - 1e-6]))[0][0] for end in ends])
    ideal = [
        simulate_pass(machine, BOX, "npp", number, conditions=Conditions(seed=1)).reading_mm
        for number in (1, 2)
    ]
    assert readings[:7] - readings[0] == pytest.approx(ideal[0], abs=1e-6)
    assert readings[7:] - readings[7] == pytest.approx(ideal[1], abs=1e-6)


def test_the_readout_is_continuous_and_blind_between_programs():
    machine = Machine(errors=random_errors(2, (0.0, 0.0, 0.0), BOX.size_mm))
    drive = Drive(repeatability_um=0.5, ring_um=1.0)
    readout = Readout(
        machine,
        Player(steps(PLAN, FaultBoard()), drive),
        drive,
        lambda name: aligned_setup(machine, BOX, name),
    )
    times = np.arange(0.0, 8.0, 1e-4)
    indicated, beam = readout.read(times)
    assert not beam[0]
    assert beam[-1]
    seen = indicated[beam]
    assert np.max(np.abs(np.diff(seen))) < 2000.0 / 60.0 * 1e-4 * 1.01


def test_an_aborted_program_stands_with_an_alarm_and_sees_its_beam():
    board = FaultBoard(
        (Fault(kind="program-aborted", setup="npp", pass_number=1, stop=3, duration_s=4.0),)
    )
    (alarm,) = [step for step in steps(PLAN, board) if step.alarm]
    assert (alarm.setup, alarm.duration_s, alarm.beam) == ("npp", 4.0, True)


def test_a_stop_dwells_longer_once():
    usual, longer = (
        dwells(),
        dwells(Fault(kind="dwell-longer", setup="npp", stop=2, duration_s=3.5)),
    )
    more_s = [
        after.duration_s - before.duration_s
        for before, after in zip(usual, longer, strict=True)
    ]
    assert [(number, each) for number, each in enumerate(more_s) if each] == [(2, 3.5)]


def test_a_setup_is_driven_again_where_the_program_waits():
    """Named at a start it comes before the next one, after the last one too; while something is
    driven it is not remembered."""
    plan = Plan(box=BOX, setups=("npp", "linear-x"), passes=1, pause_s=None)
    seen = []
    player = Player(
        steps(plan, FaultBoard()),
        Drive(),
        on_enter=lambda one: seen.append(one.step.setup or "waits"),
    )

    def started(at_s, *more):
        player.advance(at_s)
        player.start(at_s, *more)
        player.advance(at_s + 3.0)
        player.start(at_s + 3.0, again(plan, "linear-x", FaultBoard()))
        player.advance(at_s + 900.0)

    for index, more in enumerate(
        ([], [again(plan, "npp", FaultBoard())], [], [again(plan, "npp", FaultBoard())])
    ):
        started(1.0 + 1000.0 * index, *more)
    driven = [
        setup
        for before, setup in zip(["", *seen], seen, strict=False)
        if setup not in (before, "waits")
    ]
    assert driven == ["npp", "npp", "linear-x", "npp"]
    assert player.finished.is_set()
