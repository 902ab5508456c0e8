"""From readings to geometry: what is accepted, and refusals that name setup, pass and stop."""

from dataclasses import replace

import numpy as np
import pytest

from stepdiag.base.errors import DataError
from stepdiag.base.readings.readings import Readings, make_readings
from stepdiag.solver.model.layout import lay_out
from testkit.exact.surveys import DIAGONALS, Bench

BENCH = Bench(
    diagonal_noise_um=0.0, linear_noise_um=0.0, increments=5, origin_mm=(-100.0, 20.0, 5.0)
)
SURVEY = BENCH.survey()


def without(readings: Readings, setup: str, stop: int, *, renumber: bool) -> Readings:
    """Leave out one stop; the later ones close the gap where ``renumber``."""
    rows = [
        row
        for row in range(len(readings))
        if not (readings.setup[row] == setup and readings.stop[row] == stop)
    ]
    left = readings.select(rows)
    later = (np.array(left.setup) == setup) & (left.stop > stop)
    return replace(left, stop=left.stop - later) if renumber else left


def with_values(readings: Readings, setup: str, change) -> Readings:
    mine = np.array(readings.setup) == setup
    return replace(
        readings, reading_mm=np.where(mine, change(readings.reading_mm), readings.reading_mm)
    )


def test_the_volume_follows_from_the_diagonals():
    volume = lay_out(SURVEY).volume
    assert volume.origin_mm == BENCH.origin_mm
    assert volume.size_mm == BENCH.size_mm
    assert volume.increments == 5


def test_a_reading_is_its_nominal_travel_plus_a_small_deviation():
    layout = lay_out(SURVEY)
    steps = np.diff(layout.deviation_um)[np.diff(layout.pass_index) == 0]
    assert 1.0 < np.max(np.abs(layout.deviation_um)) < 200.0
    assert np.max(np.abs(steps)) < 100.0


def test_the_spot_stays_on_the_beam_and_under_the_mirror():
    layout = lay_out(SURVEY)
    along = np.sum((layout.spot_mm - layout.position_mm) * layout.direction, axis=1)
    assert np.max(np.abs(along)) < 1e-9
    across = np.cross(layout.spot_mm - layout.beam_mm, layout.direction)
    assert np.max(np.abs(across)) < 1e-9


@pytest.mark.parametrize("stop", [1, 7, 14])
def test_a_stop_left_out_in_the_middle_is_named(stop):
    with pytest.raises(
        DataError,
        match=rf"morning: .*\(pnp\), pass 1 out, row with `stop = {stop}`: expected a move of one "
        r"axis|expected 3 moves in each step",
    ):
        lay_out(without(SURVEY, "pnp", stop, renumber=True), "morning")


@pytest.mark.parametrize(
    ("setup", "stop"), [("pnp", 1), ("npp", 7), ("ppp", 14), ("linear-y", 3)]
)
def test_a_stop_that_the_file_leaves_out_is_named_and_the_rest_is_placed_as_before(
    setup, stop
):
    whole, layout = lay_out(SURVEY), lay_out(without(SURVEY, setup, stop, renumber=False))
    (finding,) = layout.findings
    assert finding.code == "stop-missing"
    assert f"({setup}), pass 1 out, stop {stop + 1}." in finding.text
    left = [
        row
        for row in range(len(whole))
        if not str(whole.place(row)).endswith(f"({setup}), pass 1 out, stop {stop + 1}")
    ]
    assert layout.deviation_um == pytest.approx(whole.deviation_um[left])
    assert layout.volume == whole.volume


def test_a_gap_does_not_excuse_a_pass_that_drives_elsewhere():
    wrong = without(SURVEY, "pnp", 7, renumber=False)
    at = {
        stop: row
        for row, (name, stop) in enumerate(zip(wrong.setup, wrong.stop.tolist(), strict=True))
        if name == "pnp"
    }
    position = wrong.position_mm.copy()
    position[at[8]] = position[at[9]]
    with pytest.raises(DataError, match=r"\(pnp\), pass 1 out, row with `stop = 8`"):
        lay_out(replace(wrong, position_mm=position))


def test_a_single_diagonal_with_a_gap_keeps_its_increments():
    assert (
        lay_out(without(BENCH.survey(["ppp"]), "ppp", 8, renumber=False)).volume.increments
        == 5
    )


def test_a_pass_that_was_cut_off_is_refused():
    for last in (15, 14, 13):
        short = SURVEY.select(
            [
                row
                for row in range(len(SURVEY))
                if SURVEY.setup[row] != "npp" or SURVEY.stop[row] < last
            ]
        )
        with pytest.raises(DataError, match=r"setup npp"):
            lay_out(short)


def test_a_diagonal_of_another_box_is_refused():
    other = replace(BENCH, size_mm=(500.0, 420.0, 300.0)).survey(["ppn"])
    rest = BENCH.survey(["ppp", "npp", "pnp"])
    both = {
        name: np.concatenate([getattr(rest, name), getattr(other, name)])
        for name in ("pass_number", "stop", "position_mm", "reading_mm")
    }
    with pytest.raises(DataError, match=r"setup .*expected Y from 20 to 440 mm"):
        lay_out(make_readings(setup=[*rest.setup, *other.setup], **both))


def test_a_setup_that_drives_another_diagonal_is_refused():
    swapped = replace(
        SURVEY,
        setup=tuple({"ppp": "npp", "npp": "ppp"}.get(name, name) for name in SURVEY.setup),
    )
    with pytest.raises(
        DataError,
        match=r"\(ppp\), pass 1 out, row with `stop = 1`: expected a move of one axis, "
        r"X\+ or Y\+ or Z\+, after "
        r"the row with `stop = 0`, found X by -100 mm",
    ):
        lay_out(swapped)


def test_a_wrong_sign_and_a_wrong_unit_of_the_laser_are_told_apart():
    with pytest.raises(
        DataError,
        match=r"\(ppn\), pass 1 out: expected readings that grow .* the opposite sign; set the "
        r"sign of the laser",
    ):
        lay_out(with_values(SURVEY, "ppn", np.negative))
    with pytest.raises(
        DataError,
        match=r"\(ppn\), pass 1 out: expected steps of the laser that agree .* found 1000 "
        r"times the commanded steps",
    ):
        lay_out(with_values(SURVEY, "ppn", lambda reading: 1000 * reading))


def test_a_linear_run_may_start_at_the_high_end_with_the_laser_there():
    """A reading grows away from the laser: the same machine error then counts with the opposite
    sign."""
    forward = BENCH.survey([*DIAGONALS, "linear-y"])
    mine = np.array(forward.setup) == "linear-y"
    order = np.concatenate([np.flatnonzero(~mine), np.flatnonzero(mine)[::-1]])
    turned = forward.select(order)
    mine = np.array(turned.setup) == "linear-y"
    last = turned.reading_mm[mine][0]
    turned = replace(
        turned,
        stop=np.where(mine, turned.stop[mine].max() - turned.stop, turned.stop),
        reading_mm=np.where(mine, last - turned.reading_mm, turned.reading_mm),
        beam_mm=np.full_like(turned.beam_mm, np.nan),
    )
    layout = lay_out(turned)
    rows = layout.setup_index == len(layout.setups) - 1
    assert np.allclose(layout.direction[rows], [0.0, -1.0, 0.0])
    assert np.max(np.abs(layout.deviation_um[rows])) < 30.0


def test_stops_beyond_the_diagonals_are_left_out_and_said():
    longer = BENCH.survey(DIAGONALS)
    run = replace(BENCH, size_mm=(600.0, 400.0, 300.0), increments=6).survey(["linear-x"])
    joined = {
        name: np.concatenate([getattr(longer, name), getattr(run, name)])
        for name in ("pass_number", "stop", "position_mm", "reading_mm")
    }
    layout = lay_out(make_readings(setup=[*longer.setup, *run.setup], **joined))
    assert len(layout) == len(longer) + 6
    assert [finding.code for finding in layout.findings] == ["outside-volume"]
    assert "linear run X (linear-x), pass 1 out, stop 7" in layout.findings[0].text


def test_an_axis_that_no_setup_travels_has_no_length():
    volume = lay_out(BENCH.survey(["linear-x"])).volume
    assert volume.size_mm == (500.0, 0.0, 0.0)
    assert volume.origin_mm == BENCH.origin_mm
    assert volume.travelled == (True, False, False)
    assert not volume.solid


def test_no_readings_are_refused():
    with pytest.raises(DataError, match="expected readings, found none"):
        lay_out(
            make_readings(
                setup=[], pass_number=[], stop=[], position_mm=np.zeros((0, 3)), reading_mm=[]
            )
        )


@pytest.mark.parametrize("first", [0, 1, 7])
def test_counts_are_numbered_from_anywhere(first):
    """Out and back on one count is one, whatever its number is."""
    survey = BENCH.survey(passes=(1, 2), joined=True)
    layout = lay_out(replace(survey, zero=survey.zero - survey.zero.min() + first))
    assert np.array_equal(layout.offset_index, lay_out(survey).offset_index)
    assert len(np.unique(layout.offset_index)) == len(set(survey.setup))
