"""One standstill measured twice, and one place passed twice: where they differ the laser has lost
its count, and that is named."""

from itertools import product

import msgspec
import numpy as np
import pytest

from stepdiag.daq.capture.captured_stop import Remark
from stepdiag.daq.passes.doubt import acceptance_of
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.passes.slips import step_in
from stepdiag.daq.survey.file import parse_survey
from testkit.exact.captured import stops_of
from testkit.examples import spread
from testkit.timeline import survey_text

DOUBTED = (Remark("stop-doubtful", "dwell longer"),)


def book_of(*stops, **plan):
    passes = PassBook(parse_survey(survey_text(**plan), "survey.toml"))
    for number, stop in enumerate(each for part in stops for each in part):
        passes.add(msgspec.structs.replace(stop, window_from_ns=number))
    return passes


def relative(only):
    readings = {index: stop.reading_mm for index, stop in only.chosen().items()}
    return [readings[k] - readings[0] for k in range(10)]


TRUE = [stop.reading_mm for stop in stops_of()]


@pytest.mark.parametrize("size_mm", [0.003, -0.055, 143.0])
def test_a_stop_that_reads_otherwise_joins_over_the_stops_measured_on_both_sides(size_mm):
    passes = book_of(stops_of(only=range(6)), stops_of(only=range(3, 10), zero=size_mm))
    (only,) = passes.passes
    assert relative(only) == pytest.approx(TRUE, abs=1e-9)
    assert only.complete
    (said,) = passes.news()
    assert (said.code, said.stop) == ("reading-differs", 3)
    assert said.size_um == pytest.approx(size_mm * 1e3)


def test_one_common_stop_alone_is_doubted_until_a_person_accepts_it():
    passes = book_of(stops_of(only=range(6)), stops_of(only=range(5, 10), zero=0.05))
    (only,) = passes.passes
    (doubt,) = passes.doubts()
    assert (doubt.stop, doubt.code) == (5, "reading-differs")
    assert "drive again from stop 4 on" in str(only.why_incomplete())
    passes.accept(acceptance_of(doubt, reason="mirror not touched", name="me", time_s=0.0))
    assert only.complete
    assert passes.accepted()[0][0] == doubt


def test_what_is_joined_by_a_doubtful_stop_alone_is_doubted_with_it():
    """The stop measured again takes over what its reading before was off by, and hands it on: only
    a sure stop beside it ends the doubt."""
    off = [
        msgspec.structs.replace(stop, reading_mm=stop.reading_mm + 0.01, doubts=DOUBTED)
        for stop in stops_of(only=[5])
    ]
    lost = [
        msgspec.structs.replace(stop, broken="beam lost")
        for stop in stops_of(only=[5], zero=3.3)
    ]
    passes = book_of(
        stops_of(only=range(5)), off, lost, stops_of(only=range(6, 10), zero=3.3)
    )
    (only,) = passes.passes
    assert {(each.stop, each.code) for each in passes.doubts()} == {(5, "stop-doubtful")}
    assert all(only.doubt(stop) == "dwell longer" for stop in range(5, 10))
    sure = [
        msgspec.structs.replace(stop, broken="beam lost" if stop.stop == 4 else "")
        for stop in stops_of(only=range(4, 10), zero=-2.0)
    ]
    (only,) = book_of(
        stops_of(only=range(5)), off, lost, stops_of(only=range(6, 10), zero=3.3), sure
    ).passes
    assert only.complete
    assert relative(only) == pytest.approx(TRUE, abs=1e-9)


def test_a_mirror_that_was_turned_never_makes_one_pass():
    """The stops measured twice disagree: the whole pass is asked for, and once it is driven it
    alone counts."""
    turned = [
        msgspec.structs.replace(stop, reading_mm=stop.reading_mm * 1.0001 + 0.05)
        for stop in stops_of()
    ]
    passes = book_of(stops_of(only=range(6)), turned[3:])
    (only,) = passes.passes
    assert "drive the whole pass again" in str(only.why_incomplete())
    passes.add_all(turned)
    assert only.complete
    assert relative(only) == pytest.approx([reading * 1.0001 for reading in TRUE], abs=1e-9)


@pytest.mark.parametrize("size_um", [-200.0, -20.0, 5.0])
def test_a_slip_between_out_and_back_is_named_and_leaves_with_its_pass(size_um):
    """Backlash of 12 µm between the passes is no slip."""
    slipped = [
        msgspec.structs.replace(
            stop, reading_mm=stop.reading_mm + size_um * 1e-3 * (stop.stop >= 4)
        )
        for stop in stops_of()
    ]
    back = stops_of(outward=False, zero=size_um * 1e-3 + 0.012)
    passes = book_of(slipped, back, back=True)
    named = [
        (each.pass_number, each.stop) for each in passes.doubts() if each.code == "count-slip"
    ]
    assert (1, 4) in named
    assert next(
        each.size_um for each in passes.doubts() if each.pass_number == 1
    ) == pytest.approx(size_um, abs=0.01)
    passes.add_all(stops_of(zero=size_um * 1e-3))
    assert not passes.doubts()


def test_what_a_machine_does_is_no_slip():
    """Reversal, drift and 0.3 µm of repeatability: at most one false word in a hundred pairs of
    passes."""
    rng = np.random.default_rng(3)
    place = np.arange(31)
    smooth = [
        rng.normal(0, 5)
        + rng.normal(0, 3) * place / 31
        + np.sin(place / 31 * rng.uniform(1, 6))
        for _ in range(200)
    ]
    found = [
        step_in(
            each + rng.normal(0, 0.42, 31),
            np.full(31, 0.05),
            "xyz" * 10,
            np.full(30, 3**-0.5),
        )
        for each in smooth
    ]
    assert sum(each is not None for each in found) <= 2


def approaches_um(rng, share, n, repeatability_um):
    """Return what a machine adds to the readings of a pass: an axis keeps its place until it moves
    again."""
    placed = rng.normal(0.0, repeatability_um, 3)
    readings = [placed @ share]
    for step in range(3 * n):
        placed[step % 3] = rng.normal(0.0, repeatability_um)
        readings.append(placed @ share)
    return np.array(readings) + rng.normal(0.0, 0.1, 3 * n + 1)


@pytest.mark.parametrize(
    ("size_mm", "n", "repeatability_um"),
    spread(
        [
            *product(
                [
                    (500.0, 400.0, 300.0),
                    (1000.0, 500.0, 400.0),
                    (4000.0, 1000.0, 800.0),
                    (4000.0, 300.0, 200.0),
                ],
                [2, 3, 5, 10, 20],
                [0.2, 0.5],
            )
        ],
        3,
    ),
)
def test_how_a_good_or_ordinary_machine_repeats_is_no_slip(size_mm, n, repeatability_um):
    """On a long machine one axis brings all the scatter: at most one pair of passes in a hundred is
    named (62 of all steps)."""
    rng, share = np.random.default_rng(n), np.array(size_mm) / np.linalg.norm(size_mm)
    pairs = [
        [approaches_um(rng, share, n, repeatability_um) for _ in range(2)] for _ in range(200)
    ]
    u_um, of_steps = np.full(3 * n + 1, 0.14), np.tile(share, n)
    assert (
        sum(
            step_in(one - other, u_um, "xyz" * n, of_steps) is not None
            for one, other in pairs
        )
        <= 2
    )


@pytest.mark.parametrize("n", [3, 5, 10, 20])
def test_a_slip_larger_than_the_machine_scatters_is_found_on_a_long_machine(n):
    rng, share = (
        np.random.default_rng(n),
        np.array([4000.0, 300.0, 200.0]) / np.linalg.norm([4000.0, 300.0, 200.0]),
    )
    for _ in range(50):
        one, other = (approaches_um(rng, share, n, 0.5) for _ in range(2))
        at = int(rng.integers(1, 3 * n))
        other[at:] += 100.0
        step = step_in(one - other, np.full(3 * n + 1, 0.14), "xyz" * n, np.tile(share, n))
        assert step is not None
        assert step.stop == at


@pytest.mark.parametrize("outward", [True, False])
@pytest.mark.parametrize("at", [2, 3, 5, 6])
def test_a_slip_of_a_pass_with_two_steps_an_axis_is_named_with_both_places(outward, at):
    """n = 2, one way: the steps of an axis differ by 200 µm, which no axis does. Which of them is
    at fault nobody can say."""
    stops = [
        msgspec.structs.replace(
            stop, reading_mm=stop.reading_mm + (0.2 if stop.stop >= at else 0.0)
        )
        for stop in stops_of(outward=outward, n=2)
    ]
    passes = PassBook(parse_survey(survey_text(n=2), "survey.toml"))
    passes.add_all(stops)
    only = passes.passes[0]
    (doubt,) = [each for each in only.doubts() if each.code == "count-slip"]
    both = {at, at - 3 if at > 3 else at + 3}
    assert doubt.stop in both
    assert {str(stop + 1) for stop in both} <= set(
        str(doubt.words).replace(":", " ").replace(",", " ").split()
    )
    assert "no other jump explains the readings" in str(doubt.words)


def test_two_steps_of_one_axis_that_an_old_leadscrew_makes_are_no_slip():
    stops = [
        msgspec.structs.replace(
            stop, reading_mm=stop.reading_mm + (0.05 if stop.stop >= 5 else 0.0)
        )
        for stop in stops_of(n=2)
    ]
    passes = PassBook(parse_survey(survey_text(n=2), "survey.toml"))
    passes.add_all(stops)
    assert passes.doubts() == ()


@pytest.mark.parametrize("size_um", [5.0, -9.0])
def test_the_wrong_pass_is_never_named_alone(size_um):
    """The steps of the machine scatter as much as the count slipped: from its own steps a pass
    cannot be told to be at fault."""
    for seed in range(30):
        rng = np.random.default_rng(seed)
        errors_mm, at = np.cumsum(rng.normal(0.0, 4e-3, 13)), int(rng.integers(1, 13))
        out = [
            msgspec.structs.replace(stop, reading_mm=stop.reading_mm + errors_mm[stop.stop])
            for stop in stops_of(n=4)
        ]
        back = [
            msgspec.structs.replace(
                stop,
                reading_mm=stop.reading_mm
                + errors_mm[12 - stop.stop]
                + size_um * 1e-3 * (stop.stop >= at),
            )
            for stop in stops_of(outward=False, n=4)
        ]
        passes = PassBook(parse_survey(survey_text(n=4, back=True), "survey.toml"))
        passes.add_all([*out, *back])
        assert (2, at) in [(doubt.pass_number, doubt.stop) for doubt in passes.doubts()], seed
