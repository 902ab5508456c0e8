"""From captured passes of the head to straightness, pitch and yaw by ISO 230-1 name, against the
ray-traced head on an exact machine."""

import msgspec
import numpy as np
import pytest

from stepdiag.base.errors import DataError
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.survey.file import parse_survey
from stepdiag.daq.survey.head_file import (
    CrosstalkTable,
    DetectorTable,
    HeadIdentity,
    LeverTable,
    LightTable,
    render_head_file,
)
from stepdiag.fourdof.runs import (
    evaluate_head,
    mean_straightness,
    merge_angles,
    over_passes,
    with_ends,
)
from stepdiag.solver.model.angles import KnownAngle
from stepdiag.virtual.bench.building import build_machine, head_builder
from stepdiag.virtual.bench.config import load_config
from testkit.exact.heads import head_file, survey_section
from testkit.timeline import survey_text

SETUPS = ("fourdof-x", "fourdof-y", "fourdof-z")
N = 6
BENCH = """
[volume]
size_mm = [600.0, 400.0, 300.0]
increments = 6
[machine]
angle_urad = 30.0
chain = "{chain}"
[head]
pointing_urad = {pointing}
vertex_mm = [{vertex}]
"""


def survey(rest="", **changes):
    text = survey_text(
        size=(600.0, 400.0, 300.0),
        n=N,
        setups=SETUPS,
        back=True,
        signals=survey_section("/dev/null1", rest=rest),
    )
    parsed = parse_survey(text, "survey.toml")
    return msgspec.structs.replace(
        parsed, head=msgspec.structs.replace(parsed.head, **changes)
    )


def captured(
    seen_by, *, chain="FXYZ", pointing=20.0, vertex="0.0, 0.0, 0.0", channels=9, laser=False
):
    """Passes out and back of all three axes, as the capture would hand them over; returns them with
    the truth."""
    config = load_config(BENCH.format(chain=chain, pointing=pointing, vertex=vertex))
    machine = build_machine(config)
    head_of = head_builder(config, config.head, machine)
    book = PassBook(seen_by)
    now = 0.0
    for setup in SETUPS:
        axis = "xyz".index(setup[-1])
        for outward in (True, False):
            for stop in range(N + 1):
                now += 5.0
                place = np.zeros((1, 3))
                place[0, axis] = (
                    (stop if outward else N - stop) * (600.0, 400.0, 300.0)[axis] / N
                )
                counts = head_of(setup).channels(machine.pose(place), np.array([now]))[0][
                    :channels
                ]
                book.add(
                    captured_stop(
                        setup,
                        outward,
                        stop,
                        tuple(place[0]),
                        counts,
                        place[0, axis] if laser else None,
                        now,
                    )
                )
    return book.passes, machine.truth(N)


def captured_stop(setup, outward, stop, place, counts, reading_mm, time_s):
    u = tuple(2.0 if k % 3 < 2 else 0.0 for k in range(len(counts)))
    return CapturedStop(
        setup=setup,
        outward=outward,
        stop=stop,
        position_mm=place,
        axis=setup[-1],
        stop_count=None,
        reading_mm=reading_mm,
        u_um=0.1,
        scatter_um=0.1,
        slope_um_s=0.0,
        samples=100,
        rejected=0,
        window_from_ns=0,
        window_to_ns=1,
        time_s=time_s,
        beam=1.0,
        channels=tuple(map(float, counts)),
        u_channels=u,
    )


FILES = {"head.toml": render_head_file(head_file()).encode()}
ROTATIONS = ("EBX", "ECX", "EAY", "ECY", "EAZ", "EBZ")
STRAIGHT = ("EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ")


def test_straightness_pitch_and_yaw_of_every_axis_are_found_through_a_drifting_beam():
    """20 urad of pointing at 0.9 m would be 18 µm of straightness; the fit of a FXYZ machine sees
    none of it."""
    wanted = survey()
    passes, truth = captured(wanted)
    found = evaluate_head(wanted, passes, FILES, {})
    assert found.findings == ()
    assert set(found.angles) == set(ROTATIONS)
    for name, known in found.angles.items():
        assert known.position_mm == pytest.approx(truth.position_mm[name[2]])
        assert known.value_urad == pytest.approx(truth.errors[name], abs=0.3), name
        assert np.all((known.u_urad > 0) & (known.u_urad < 2.0))
    for name, (_, value) in mean_straightness(found).items():
        assert value == pytest.approx(truth.errors[name], abs=0.3), name
    assert [one.name for one in found.straightness] == [
        name
        for axis in range(3)
        for _ in range(2)
        for name in STRAIGHT[2 * axis : 2 * axis + 2]
    ]
    assert {one.approach for one in found.straightness} == {1, -1}
    assert all(np.all((one.u_um > 0.1) & (one.u_um < 1.0)) for one in found.straightness)


def test_without_the_lever_the_drift_stays():
    """The dead path of 300 mm left out: the compensation is wrong by drift times dead path."""
    wanted = survey()
    passes, truth = captured(wanted, pointing=60.0)
    near = msgspec.structs.replace(
        wanted.head,
        **{
            axis: msgspec.structs.replace(wanted.head.run_along(axis), distance_mm=0.0)
            for axis in "xyz"
        },
    )
    found = mean_straightness(
        evaluate_head(msgspec.structs.replace(wanted, head=near), passes, FILES, {})
    )
    worst = max(
        float(np.abs(value - truth.errors[name]).max()) for name, (_, value) in found.items()
    )
    assert worst > 1.0


def test_the_laser_may_give_the_distance():
    wanted = survey(distance="laser")
    passes, truth = captured(wanted, laser=True)
    found = mean_straightness(evaluate_head(wanted, passes, FILES, {}))
    assert all(
        value == pytest.approx(truth.errors[name], abs=0.3)
        for name, (_, value) in found.items()
    )
    dark, _ = captured(wanted)
    with pytest.raises(
        DataError,
        match=r"\(fourdof-x\), pass 1 out, stop 1: expected a reading of the laser",
    ):
        evaluate_head(wanted, dark, FILES, {})


def test_a_cube_off_the_axis_needs_the_roll_of_a_level():
    """Theory 9 (a): 30 mm off the axis and 30 urad of roll are 0.9 µm; with vertex and level told,
    they are gone."""
    wanted = survey()
    passes, truth = captured(wanted, vertex="0.0, 30.0, 0.0")
    told = {
        "head.toml": render_head_file(
            head_file(crosstalk=CrosstalkTable(vertex_mm=(30.0, 0.0, 0.0)))
        ).encode()
    }
    level = {
        "EAX": KnownAngle(
            position_mm=truth.position_mm["X"],
            value_urad=truth.errors["EAX"],
            u_urad=np.full(N + 1, 1.0),
        )
    }
    blind = mean_straightness(evaluate_head(wanted, passes, FILES, {}))["EZX"][1]
    seen = mean_straightness(evaluate_head(wanted, passes, told, level))["EZX"][1]
    assert np.abs(blind - truth.errors["EZX"]).max() > 0.4
    assert seen == pytest.approx(truth.errors["EZX"], abs=0.3)


def test_a_calibration_of_another_head_or_none_is_refused():
    wanted = survey(id="4D-999")
    passes, _ = captured(wanted)
    with pytest.raises(DataError, match="expected '4D-999', the head of the survey"):
        evaluate_head(wanted, passes, FILES, {})
    with pytest.raises(DataError, match="expected the head's calibration file in the log"):
        evaluate_head(wanted, passes, {}, {})


def test_a_calibration_that_is_not_finished_gives_no_result():
    """What `show` and `solve` take is complete: the fields that nothing has measured are named."""
    wanted = survey()
    passes, _ = captured(wanted)
    identity = HeadIdentity(id="4D-001", format="fourdof", date="2026-11-26", version=2)
    for changes in ({}, {"lever": None}, {"qd": DetectorTable()}):
        unfinished = {
            "head.toml": render_head_file(head_file(head=identity, **changes)).encode()
        }
        with pytest.raises(
            DataError,
            match=r"head.toml: .*no measurement of .*next: `stepdiag fourdof commission`",
        ):
            evaluate_head(wanted, passes, unfinished, {})


def test_a_spot_that_loses_a_fiftieth_of_its_light_is_named_and_not_used():
    wanted = survey()
    passes, _ = captured(wanted)
    lit = {
        "head.toml": render_head_file(
            head_file(light=LightTable(sums=(1e6, 1e6, 1e6), within=0.01))
        ).encode()
    }
    assert evaluate_head(wanted, passes, lit, {}).findings == ()
    book = PassBook(wanted)
    for stop in (stop for each in passes for stop in each.chosen().values()):
        cut = stop.setup == "fourdof-x" and stop.stop == 3
        book.add(
            msgspec.structs.replace(
                stop,
                channels=(*stop.channels[:2], 0.98 * stop.channels[2], *stop.channels[3:]),
            )
            if cut
            else stop
        )
    found = evaluate_head(wanted, book.passes, lit, {})
    assert {finding.code for finding in found.findings} == {"fourdof-out-of-range"}
    assert all(
        "one of the three sums differed from the other two in 1 of 7" in finding.text
        for finding in found.findings
    )
    assert (
        sum(len(one.position_mm) for one in found.straightness)
        == sum(
            len(one.position_mm)
            for one in evaluate_head(wanted, passes, lit, {}).straightness
        )
        - 4
    )


def test_a_quadrant_detector_alone_gives_straightness_with_its_drift_and_says_so():
    wanted = survey()
    passes, truth = captured(wanted, pointing=0.0, channels=3)
    found = evaluate_head(wanted, passes, FILES, {})
    assert found.angles == {}
    assert {finding.code for finding in found.findings} == {"fourdof-uncompensated"}
    for name, (_, value) in mean_straightness(found).items():
        assert value == pytest.approx(truth.errors[name], abs=0.3), name


def test_an_angle_whose_ends_read_a_little_short_reaches_over_the_volume():
    """Registers of one decimal are off by 0.05 mm: the solver takes such an angle, and it was left
    out for 0.01 mm."""
    wanted = survey()
    book = PassBook(wanted)
    for stop in (stop for each in captured(wanted)[0] for stop in each.chosen().values()):
        at_end = stop.setup == "fourdof-x" and stop.position_mm[0] == 0.0
        book.add(
            msgspec.structs.replace(stop, position_mm=(0.05, *stop.position_mm[1:]))
            if at_end
            else stop
        )
    found = evaluate_head(wanted, book.passes, FILES, {})
    assert {"EBX", "ECX"} <= set(found.angles)
    assert found.angles["EBX"].position_mm[0] == 0.05
    assert "fourdof-beam-blocked" not in {finding.code for finding in found.findings}


def test_an_angle_without_its_end_is_not_used_while_straightness_is():
    """The stop at the low end was out of the head's range in both passes of X."""
    wanted = survey()
    passes, truth = captured(wanted)
    book = PassBook(wanted)
    for stop in (stop for each in passes for stop in each.chosen().values()):
        far = stop.setup == "fourdof-x" and stop.position_mm[0] == 0.0
        book.add(
            msgspec.structs.replace(stop, channels=(850_000.0, 0.0, 1e6, *stop.channels[3:]))
            if far
            else stop
        )
    found = evaluate_head(wanted, book.passes, FILES, {})
    assert not {"EBX", "ECX"} & set(found.angles)
    assert {"fourdof-out-of-range", "fourdof-beam-blocked"} == {
        finding.code for finding in found.findings
    }
    position, value = mean_straightness(found)["EYX"]
    assert position[0] == 100.0
    line = np.interp(position, position[[0, -1]], truth.errors["EYX"][[1, -1]])
    assert value == pytest.approx(truth.errors["EYX"][1:] - line, abs=0.3)


def test_a_dark_pass_says_nothing_and_says_so():
    wanted = survey()
    passes, _ = captured(wanted)
    first = passes[0]
    dark = [
        msgspec.structs.replace(stop, channels=(0.0,) * 9) for stop in first.chosen().values()
    ]
    book = PassBook(wanted)
    for stop in [*dark, *(stop for each in passes[1:] for stop in each.chosen().values())]:
        book.add(stop)
    found = evaluate_head(wanted, book.passes, FILES, {})
    codes = {finding.code for finding in found.findings}
    assert {"fourdof-beam-blocked"} <= codes
    assert sum(one.name == "EYX" for one in found.straightness) == 1
    assert any(
        finding.text.startswith("4-DOF run X (fourdof-x), pass 1 out: ")
        for finding in found.findings
    )


def test_level_and_head_are_merged_and_a_double_is_named():
    position = np.array([0.0, 100.0])
    ours, level = (
        KnownAngle(position_mm=position, value_urad=np.array([0.0, v]), u_urad=np.ones(2))
        for v in (1.0, 2.0)
    )
    merged, findings = merge_angles({"EAX": level, "EBX": level}, {"EBX": ours})
    assert merged == {"EAX": level, "EBX": ours}
    assert [finding.code for finding in findings] == ["angles-twice"]
    assert merge_angles({}, {"EBX": ours})[1] == ()


def test_the_parallel_shift_of_the_source_is_in_the_uncertainty():
    """No detector sees it: half of a shift of 6 µm in a pass, as a Brownian bridge, is 1.2 µm in
    the rms beside what u was."""
    wanted = survey()
    passes, _ = captured(wanted)
    still = msgspec.structs.replace(
        wanted, uncertainty=msgspec.structs.replace(wanted.uncertainty, source_shift_um=0.0)
    )
    moving = msgspec.structs.replace(
        wanted, uncertainty=msgspec.structs.replace(wanted.uncertainty, source_shift_um=6.0)
    )
    before, after = (
        evaluate_head(each, passes, FILES, {}).straightness for each in (still, moving)
    )
    for one, other in zip(before, after, strict=True):
        assert other.value_um == pytest.approx(one.value_um)
        assert other.u_um == pytest.approx(np.hypot(one.u_um, 3.0 / np.sqrt(6.0)))


def test_what_is_uncertain_of_the_levers_slope_counts_far_from_where_it_was_found():
    wanted = survey()
    passes, _ = captured(wanted, pointing=60.0)
    sure = {
        "head.toml": render_head_file(head_file(lever=LeverTable(dead_path_mm=30.0))).encode()
    }
    unsure = {
        "head.toml": render_head_file(
            head_file(lever=LeverTable(dead_path_mm=30.0, u_at_mm=300.0, u_scale=0.05))
        ).encode()
    }
    near, far = (
        evaluate_head(wanted, passes, files, {}).straightness[0].u_um
        for files in (sure, unsure)
    )
    assert far[0] == pytest.approx(near[0], rel=0.01)
    # 0.05 of 600 mm are 30 mm of lever; times some ten urad of drift
    assert far[-1] > near[-1] + 0.05


def noisy_days(bow_um=0.0, passes=10, noise_urad=0.5):
    """Straightness of X seen in so many outward passes of one head; the second half with a bow."""
    wanted = survey()
    book = PassBook(wanted)
    rng = np.random.default_rng(3)
    stops = [
        stop
        for each in captured(wanted)[0]
        for stop in each.chosen().values()
        if stop.setup == "fourdof-x" and stop.outward
    ]
    way = np.linspace(0.0, 1.0, len(stops))
    for number in range(passes):
        for stop, at in zip(stops, way, strict=True):
            drawn = rng.normal(0.0, noise_urad * 1e-6 * 150.0 / 2.0 * 1e6, 2)
            bent = (
                4.0
                * bow_um
                * at
                * (1.0 - at)
                * (number >= passes // 2)
                * 2.0
                / 1414.2
                * 1e6
                * 2.0
                / np.sqrt(np.pi)
            )
            channels = np.array(stop.channels) + np.array([bent, 0, 0, *drawn, 0, 0, 0, 0])
            u = (*stop.u_channels[:3], *np.full(2, noise_urad * 75.0), *stop.u_channels[5:])
            book.add(
                msgspec.structs.replace(
                    stop,
                    channels=tuple(channels.tolist()),
                    u_channels=u,
                    time_s=stop.time_s + 1000.0 * number,
                )
            )
    return wanted, book.passes


def test_ten_passes_lower_the_uncertainty_but_not_what_they_share():
    u = {}
    for passes in (1, 10):
        wanted, driven = noisy_days(passes=passes)
        found = evaluate_head(wanted, driven, FILES, {})
        (one,) = [one for one in over_passes(found) if one.name == "EYX"]
        u[passes] = one.u_um[3], found.angles["ECX"].u_urad[3]
    assert u[10][0] < 0.75 * u[1][0]
    # the curve of the QD, 0.5 um of the spot, is in every pass
    assert u[10][0] > 0.25


def test_two_days_that_differ_by_a_bow_are_named():
    wanted, driven = noisy_days(bow_um=10.0, passes=2)
    named = [
        one
        for one in evaluate_head(wanted, driven, FILES, {}).findings
        if one.code == "straightness-misclosure"
    ]
    assert [one.text[:26] for one in named] == ["EYX: passes 1 and 3 of the"]
    wanted, driven = noisy_days(passes=4)
    assert evaluate_head(wanted, driven, FILES, {}).findings == ()


def test_the_ends_of_the_line_are_in_the_uncertainty_between_them():
    """Independent u of 1 um everywhere: in the middle the line adds a half (JCGM 100, 5.1.2)."""
    assert with_ends(np.linspace(0.0, 4.0, 5), np.ones(5)) == pytest.approx(
        [1.0, np.sqrt(1.625), np.sqrt(1.5), np.sqrt(1.625), 1.0]
    )
