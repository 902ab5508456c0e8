"""After an unwatched time: the count is proven to have held by the instrument's own number and by
another pass of the setup, or the stops stay doubted.
"""

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.daq.passes.counts import Numbered, went_on
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.passes.stretches import same_um
from stepdiag.daq.survey.assumed import assumptions_of
from stepdiag.daq.survey.file import parse_survey
from testkit.exact.captured import stops_of
from testkit.examples import spread
from testkit.timeline import survey_text

RATE_HZ, DWELL_S, INCREMENTS = 250, 3.0, 6
LASERS = {
    "umd": 'format = "umd"\nport = "/dev/null"',
    "line": None,
    "frames": 'format = "frames"\nport = "/dev/null"\n[laser.frames]\nsync = "AA55"\n'
    'layout = ["counter u32", "position i32"]',
    "qudis": 'format = "qudis"\nport = "socket://127.0.0.1:2101"',
}
"""The lasers that number their samples; the line's number repeats after 65,536."""


def survey_with(laser, *, back=True):
    """Return a survey with a laser of the list."""
    text = survey_text(n=INCREMENTS, back=back)
    if LASERS[laser] is not None:
        begin, end = text.index("[laser]"), text.index("[plc]")
        text = f"{text[:begin]}[laser]\n{LASERS[laser]}\n{text[end:]}"
    return parse_survey(text, "survey.toml")


MOST_UM = same_um(assumptions_of(survey_with("line")).repeatability_um)
"""Two drives of a stop may differ by this much."""


def scattered(stops, rng, scatter_um):
    """Return stops of a machine whose axes arrive within a scatter, each until it moves again."""
    along = np.array([0.8, 0.53, 0.27])
    miss, made = rng.normal(scale=scatter_um, size=3), []
    for stop in stops:
        if stop.axis:
            miss["xyz".index(stop.axis)] = rng.normal(scale=scatter_um)
        reading_mm = stop.reading_mm + 1e-3 * float(miss @ along)
        made.append(msgspec.structs.replace(stop, reading_mm=reading_mm))
    return made


def driven(
    rng, *, cut=8, away_s=60.0, lost_um=0.0, scatter_um=0.1, counts=True, restart=False
):
    """Return the stops out and back; before the stop ``cut`` of the way out nothing was recorded
    for a while."""
    time_s, count, made = 1.8e9, 12_345, []
    for outward in (True, False):
        stops = scattered(stops_of(n=INCREMENTS, outward=outward), rng, scatter_um)
        for stop in stops:
            unwatched = (
                "the recording was interrupted" if outward and stop.stop == cut else ""
            )
            passed_s = away_s if unwatched else DWELL_S
            time_s += passed_s
            count = (
                round(0.4 * passed_s * RATE_HZ)
                if unwatched and restart
                else count + round(passed_s * RATE_HZ)
            )
            off = lost_um if not outward or stop.stop >= cut else 0.0
            made.append(
                msgspec.structs.replace(
                    stop,
                    reading_mm=stop.reading_mm + 1e-3 * off,
                    time_s=time_s,
                    count=count if counts else None,
                    unwatched=unwatched,
                    window_from_ns=round((time_s - 1.8e9) * 1e9),
                )
            )
    return made


def taken(stops, laser="umd", *, back=True):
    """Return the book with the stops, and the remarks that it made of a held count."""
    passes = PassBook(survey_with(laser, back=back))
    passes.add_all(stops)
    return passes, [found.code for found in passes.news() if found.severity == "info"]


@given(
    laser=st.sampled_from(list(LASERS)),
    cut=st.integers(2, 3 * INCREMENTS - 1),
    away_s=st.floats(1.0, 40_000.0),
    seed=st.integers(0),
)
def test_a_laser_that_ran_on_with_a_free_beam_leaves_no_doubt(laser, cut, away_s, seed):
    """Between a second and half a day: while the way out alone is in, it is doubted with the
    reason; the way back ends the doubt. A number that repeats every four minutes proves less."""
    away_s = min(away_s, 1_000.0) if laser == "line" else away_s
    stops = driven(np.random.default_rng(seed), cut=cut, away_s=away_s, scatter_um=0.05)
    out = 3 * INCREMENTS + 1
    alone, _ = taken(stops[:out], laser)
    assert "another whole pass of this setup shows" in str(alone.doubts()[0].why)
    passes, remarks = taken(stops, laser)
    assert passes.complete()
    assert remarks == ["laser-unwatched"]


@given(
    size_um=st.floats(-4.0, 5.0).map(lambda power: 10.0**power),
    sign=st.sampled_from([1, -1]),
    cut=st.integers(1, 3 * INCREMENTS),
    scatter_um=st.floats(0.0, 1.0),
    seed=st.integers(0),
)
def test_no_doubt_is_lifted_beyond_what_is_the_same(size_um, sign, cut, scatter_um, seed):
    """Of a lost count of any size from a tenth of a nanometre to 100 mm no more stays in the
    readings without a doubt than two drives of a stop may differ by."""
    rng = np.random.default_rng(seed)
    passes, _ = taken(driven(rng, cut=cut, lost_um=sign * size_um, scatter_um=scatter_um))
    assert passes.doubts() or size_um <= MOST_UM


def test_a_lost_count_above_what_is_the_same_is_never_proven_away():
    """Machines that repeat to 0.05 to 1 um, the loss a hair above: the step would have to be
    hidden by the scatter of its own drive, which its neighbours show."""
    rng = np.random.default_rng(7)
    proven = 0
    for _ in spread(range(300), 3):
        stops = driven(
            rng,
            cut=int(rng.integers(1, 3 * INCREMENTS)),
            lost_um=float(rng.choice([-1, 1]) * (MOST_UM + rng.exponential(0.3))),
            scatter_um=float(np.exp(rng.uniform(np.log(0.05), 0.0))),
        )
        proven += taken(stops)[0].complete()
    assert proven <= 2


@pytest.mark.parametrize("restart", [True, False], ids=["switched on anew", "no number"])
@given(
    cut=st.integers(1, 3 * INCREMENTS), away_s=st.floats(10.0, 40_000.0), seed=st.integers(0)
)
def test_without_a_number_that_ran_on_nothing_is_proven(restart, cut, away_s, seed):
    """Though both passes agree."""
    rng = np.random.default_rng(seed)
    stops = driven(
        rng, cut=cut, away_s=away_s, scatter_um=0.0, counts=restart, restart=restart
    )
    passes, remarks = taken(stops)
    (doubt,) = passes.doubts()
    assert doubt.code == "laser-unwatched"
    assert ("does not match the elapsed time" in str(doubt.why)) is restart
    assert not remarks


def test_both_passes_cut_at_the_same_step_prove_nothing():
    """Either may have lost what the other lost."""
    stops = driven(np.random.default_rng(1), scatter_um=0.0)
    back = 3 * INCREMENTS + 1 + 3 * INCREMENTS - 7
    stops[back] = msgspec.structs.replace(
        stops[back], unwatched="no sample was received for 9.0 s"
    )
    passes, remarks = taken(stops)
    assert [doubt.code for doubt in passes.doubts()] == ["laser-unwatched"] * 2
    assert not remarks


def test_a_single_pass_stays_doubted():
    stops = driven(np.random.default_rng(1))[: 3 * INCREMENTS + 1]
    passes, _ = taken(stops, back=False)
    assert [doubt.code for doubt in passes.doubts()] == ["laser-unwatched"]


def numbered(first, *, begun_s, seconds, repeats_after):
    """Return a stretch of an instrument that sends a number every 4 ms from a number on."""
    both = Numbered()
    for passed in (0.0, seconds):
        count = first + round(passed * RATE_HZ)
        both.add(count, begun_s + passed)
    assert repeats_after > both.last[0] - both.first[0]
    return both


@given(
    repeats_after=st.sampled_from([2.0**16, 2.0**31, 2.0**32, np.inf]),
    start=st.integers(0, 2**16 - 1),
    away_s=st.floats(0.5, 100_000.0),
    off_s=st.floats(-1.5, 1.5),
)
def test_a_number_that_runs_on_is_seen_over_its_ends(repeats_after, start, away_s, off_s):
    """Also where the clock of the computer starts in whole seconds."""
    before = numbered(start, begun_s=0.0, seconds=60.0, repeats_after=repeats_after)
    then = before.last[0] + round(away_s * RATE_HZ)
    after = numbered(
        int(then % repeats_after) if np.isfinite(repeats_after) else then,
        begun_s=60.0 + away_s + max(off_s, 0.01 - away_s),
        seconds=10.0,
        repeats_after=repeats_after,
    )
    ran = went_on(before, after, repeats_after)
    assert ran is True or (ran is None and repeats_after == 2.0**16 and away_s > 60.0)


@given(
    repeats_after=st.sampled_from([2.0**31, 2.0**32, np.inf]),
    start=st.integers(0, 10**9),
    off_s=st.floats(4.0, 10**6) | st.floats(-(10**6), -4.0),
)
def test_another_number_is_seen(repeats_after, start, off_s):
    before = numbered(start, begun_s=0.0, seconds=600.0, repeats_after=repeats_after)
    then = max(before.last[0] + round((60.0 + off_s) * RATE_HZ), 0)
    after = numbered(then, begun_s=660.0, seconds=10.0, repeats_after=repeats_after)
    assert went_on(before, after, repeats_after) is False
