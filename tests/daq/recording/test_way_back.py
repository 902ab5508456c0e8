"""A daemon that starts while the machine is on its way back, with positions and without a counter:
the laser shows which way it goes."""

import bisect
import functools

import pytest

from stepdiag.daq.log.codec import time_of
from stepdiag.daq.recording.session import Round, Session
from stepdiag.daq.recording.sinks import Nowhere
from stepdiag.daq.recording.verdicts import Verdicts
from stepdiag.daq.survey.file import parse_survey
from testkit.exact.driven import WALL_OFFSET_NS, Program, machine_of, survey_file
from testkit.fault_cases import STOPPED
from testkit.timeline import Timeline

STOPS, PASSES = 5, 4
TURN, END = STOPS, 2 * STOPS - 1
PLACED = STOPPED + '[plc.signals.setup]\naddress = 3\ntype = "uint16"\n'
PLACED += "".join(
    f'[plc.signals.{name}]\naddress = {at}\ntype = "int32"\nscale = 1e-4\n'
    for name, at in (("x_mm", 4), ("y_mm", 6), ("z_mm", 8))
)
NOT_YET = -1
"""The daemon before saw no stop at all."""
ON_THE_WAY_S, STANDING_S = -0.15, 0.1


@functools.cache
def bench():
    """Return the events of two surveys of one run there and back, and the (arrival, departure) of
    each of their stops in seconds."""
    program = Program(machine_of(5), back=True, n=STOPS - 1)
    for _ in range(2):
        program.drive("linear-x")
    times = Timeline(program.stops, move_s=0.3).schedule()
    return list(program.events()), [
        times[index] for index, each in enumerate(program.stops) if each.counts
    ]


def follow(session, from_s, to_s):
    for event in bench()[0]:
        if from_s <= time_of(event) * 1e-9 < to_s:
            session.consume(event)


def driven_again(folder, seen, back_at, again, comes_s=ON_THE_WAY_S):
    """Return the session of a daemon that comes back at a stop of the way back; afterwards the way
    out is driven again from a stop on.

    ``seen`` is the last stop that the daemon before saw.
    """
    stands, text = (
        bench()[1],
        survey_file(back=True, n=STOPS - 1, setups=("linear-x",), signals=PLACED),
    )
    survey = parse_survey(text, "survey.toml")
    more = {"on_outcome": lambda _: None, "wall_offset_ns": lambda: WALL_OFFSET_NS}
    first = Session(survey, text, Round(folder, {}), Nowhere(), **more)
    if seen != NOT_YET:
        follow(first, 0.0, stands[seen][1] + 0.25)
    second = Session(survey, text, first.as_round(Verdicts()), Nowhere(), **more)
    follow(second, stands[back_at][0] + comes_s, stands[END][1] + 0.6)
    follow(second, stands[END + 1 + again][0] - 0.25, stands[END + STOPS][1] + 0.6)
    second.close("the bench has ended")
    return second


def of_the_other_direction(each):
    """Return the stops of a pass that were driven in the other direction; the first one may be the
    last of the pass before."""
    wrong = []
    for index, stop in each.chosen().items():
        at = (
            bisect.bisect(
                [begin for begin, _ in bench()[1]],
                (stop.window_from_ns + stop.window_to_ns) * 0.5e-9,
            )
            - 1
        )
        number, driven = divmod(at, STOPS)
        if (number + 1 - each.number) % 2 and not (index == 0 and driven == STOPS - 1):
            wrong.append(index)
    return wrong


@pytest.mark.parametrize(
    ("seen", "back_at", "again", "comes_s"),
    [
        (NOT_YET, TURN + 2, 2, ON_THE_WAY_S),
        (1, TURN + 1, 3, ON_THE_WAY_S),
        (1, TURN + 2, 2, ON_THE_WAY_S),
        (3, TURN + 3, 2, ON_THE_WAY_S),
        (3, TURN + 3, 2, STANDING_S),
    ],
)
def test_a_stop_of_the_way_back_in_the_way_out_is_doubted(
    tmp_path, seen, back_at, again, comes_s
):
    """Its backlash is in the reading; place and step alone are those of the way out."""
    (one,) = [
        each
        for each in driven_again(tmp_path, seen, back_at, again, comes_s).book.passes
        if each.whole
    ]
    assert (wrong := of_the_other_direction(one)), "the bench drives it so that one enters"
    assert set(wrong) <= {
        doubt.stop for doubt in one.open_doubts() if doubt.code == "other-side"
    }


def test_stops_missed_after_the_end_of_the_way_back_keep_the_way_out(tmp_path):
    """The way back ended at its last stop, so the machine goes out: two stops later it is seen."""
    passes = driven_again(tmp_path, NOT_YET, TURN + 1, 3).book.passes
    assert sorted(each.number for each in passes) == [1, 2]
    assert not any(of_the_other_direction(each) for each in passes)


@pytest.mark.parametrize("seen", [1, 3])
def test_driven_again_from_the_first_stop_the_pass_is_whole_and_undoubted(tmp_path, seen):
    one = driven_again(tmp_path, seen, TURN + 1, 0).book.passes[0]
    assert one.whole
    assert not one.open_doubts()
    assert not of_the_other_direction(one)


def test_a_survey_there_and_back_that_nobody_disturbs_has_no_stop_from_the_other_side(
    tmp_path,
):
    text = survey_file(back=True, n=STOPS - 1, setups=("linear-x",), signals=PLACED)
    more = {"on_outcome": lambda _: None, "wall_offset_ns": lambda: WALL_OFFSET_NS}
    session = Session(
        parse_survey(text, "survey.toml"), text, Round(tmp_path, {}), Nowhere(), **more
    )
    follow(session, 0.0, bench()[1][END][1] + 0.6)
    assert [
        (each.number, each.whole, each.open_doubts()) for each in session.book.passes
    ] == [
        (1, True, ()),
        (2, True, ()),
    ]
