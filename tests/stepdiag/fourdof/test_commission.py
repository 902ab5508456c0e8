"""The calibration that a commissioning run gives, against ray-traced heads with every imperfection
drawn; what is refused, by name."""

from dataclasses import replace

import numpy as np
import pytest

from stepdiag.base.errors import DataError
from stepdiag.daq.survey.head_file import (
    AxisTable,
    HeadFile,
    HeadIdentity,
    parse_head_file,
    render_head_file,
)
from stepdiag.daq.survey.models import HeadRun
from stepdiag.fourdof.calibrated import calibrated
from stepdiag.fourdof.commission import Standing, commission
from stepdiag.solver.fourdof.head import motion
from stepdiag.virtual.instruments.head import Disturbance, HeadStand, VirtualHead, Wander
from testkit.examples import spread
from testkit.ordinary.heads import ordinary_head, stage_pose

STAND = HeadStand(np.zeros(3), *np.eye(3)[[2, 0, 1]])
STILL = np.zeros((1, 2))
NEAR_MM, TRAVEL_MM = 300.0, 800.0
RUN = HeadRun(beam="+z", detector_x="+x", detector_y="+y", distance_mm=NEAR_MM)
NEW = HeadFile(head=HeadIdentity(id="4D-9", format="fourdof", date="2026-11-01", version=2))
PLACES = [
    (end, axis, place)
    for end in (0.0, TRAVEL_MM)
    for axis in (0, 1)
    for place in (-300.0, -150.0, 0.0, 150.0, 300.0)
]


class Rig:
    """One head before a machine that jogs; ``optics`` changes the drawn head."""

    def __init__(self, seed, wobble_urad=120.0, **optics):
        self.optics = replace(ordinary_head(seed), **optics)
        self.rng = np.random.default_rng(seed)
        drift = Disturbance(
            pointing_urad=Wander(amplitude=10.0, seed=seed),
            wobble_urad=Wander(amplitude=wobble_urad, period_s=2.5, seed=seed + 1),
        )
        self.head = VirtualHead(
            self.optics,
            STAND,
            stage_pose(NEAR_MM, STILL, STILL, STAND),
            disturbance=drift,
            seed=seed,
        )

    def look(self, way_mm, moved_um, time_s, turn_urad=(0.0, 0.0), *, wobbled=0.0, lit=1.0):
        many = np.ones((len(time_s), 1))
        pose = stage_pose(
            NEAR_MM + way_mm,
            1e-3 * np.array(moved_um) * many,
            np.array(turn_urad) * many,
            STAND,
        )
        return self.head.channels(
            pose, time_s, lit * many[:, 0], wobbled * many[:, 0]
        ).astype(float)

    def stand(self, way_mm, moved_um, from_s, seconds, **how):
        time_s = from_s + np.arange(0.0, seconds, 0.02)
        missed = self.rng.normal(0.0, 0.5, 2) if seconds < 5.0 else np.zeros(2)
        channels = self.look(way_mm, np.array(moved_um) + missed, time_s, **how)
        return Standing(
            position_mm=np.array([*(1e-3 * np.array(moved_um)), way_mm]),
            time_s=time_s,
            channels=channels,
        )

    def standings(self):
        jogs = [
            self.stand(end, place * np.eye(2)[axis], 3.0 * number, 2.0)
            for number, (end, axis, place) in enumerate(PLACES)
        ]
        wobbles = [
            self.stand(end, (0.0, 0.0), 100.0 + end, 20.0, wobbled=1.0)
            for end in (0.0, TRAVEL_MM)
        ]
        return [*jogs, *wobbles, self.stand(TRAVEL_MM, (0.0, 0.0), 2000.0, 5.0, lit=0.0)]

    def commissioned(self, file=NEW, run=RUN):
        return commission(self.standings(), file, run, "z", "2026-11-26")


def true_fields(optics):
    """What the optics are, by the fields of the file."""
    return {
        "qd.rotation_mrad": optics.qd.rotation_mrad,
        "psd1.rotation_mrad": optics.psd1.rotation_mrad,
        "psd2.rotation_mrad": optics.psd2.rotation_mrad,
        "crosstalk.psd1_leak": -1e3 * optics.psd1_defocus_mm / optics.psd1_focal_mm**2,
        "crosstalk.psd2_leak": -1e3 * optics.psd2_defocus_mm / optics.psd2_focal_mm**2,
    }


@pytest.mark.parametrize("seed", spread(range(8), 2))
def test_every_field_lies_within_its_uncertainty(seed):
    rig = Rig(seed)
    done = rig.commissioned()
    found = dict(
        zip(
            done.file.uncertainty.of,
            zip(done.found.value, done.found.u, strict=True),
            strict=True,
        )
    )
    for name, true in true_fields(rig.optics).items():
        value, u = found[name]
        assert abs(value - true) < 4 * u + 1e-5, name
    for name, optics in (
        ("qd", rig.optics.qd),
        ("psd1", rig.optics.psd1),
        ("psd2", rig.optics.psd2),
    ):
        table = done.file.detector(name)
        assert (table.x.sign, table.y.sign) == tuple(map(int, optics.sign))
        assert table.dark == pytest.approx(np.array(optics.dark) * optics.full_sum, abs=20.0)
    assert 0.3 < done.found.u_jog_um < 0.75
    assert done.file.absent() == []
    assert parse_head_file(render_head_file(done.file).encode(), "head.toml") == done.file


@pytest.mark.parametrize("seed", spread(range(4), 2))
def test_the_head_then_reads_what_a_target_does(seed):
    """Straightness and angles of ten places of the travel, the pointing drifting: within a fraction
    of a micrometre and microradian."""
    rig = Rig(seed)
    head = calibrated(rig.commissioned().file)
    way = np.linspace(0.0, TRAVEL_MM, 11)
    moved = np.column_stack([20.0 * np.sin(way / 200.0), 10.0 * np.cos(way / 150.0)])
    turned = np.column_stack([15.0 * np.cos(way / 250.0), 20.0 * np.sin(way / 300.0)])
    stops = zip(way, moved, turned, strict=True)
    channels = np.array(
        [
            rig.look(z, m, 3000.0 + z + np.arange(0, 1, 0.02), t).mean(axis=0)
            for z, m, t in stops
        ]
    )
    seen = motion(channels, NEAR_MM + way, head)
    share = (way / TRAVEL_MM)[:, None]
    error = seen.straightness_um - moved
    assert np.abs(error - (1 - share) * error[0] - share * error[-1]).max() < 0.4
    assert np.abs(seen.angle_urad - turned - (seen.angle_urad - turned)[0]).max() < 0.4


def test_what_a_run_does_not_decide_is_refused_by_name():
    still = Rig(1, wobble_urad=0.0)
    with pytest.raises(DataError, match=r"commission: psd[12].*wobble"):
        still.commissioned()
    standings = Rig(1).standings()
    with pytest.raises(
        DataError,
        match=r"commission: dark: expected at least 20 samples without light, found 0; block the "
        r"beam",
    ):
        commission(standings[:-1], NEW, RUN, "z", "2026-11-26")
    near = [one for one in standings if one.position_mm[2] == 0.0] + standings[-1:]
    with pytest.raises(DataError, match="jogs in both lateral directions at two distances"):
        commission(near, NEW, RUN, "z", "2026-11-26")


def test_detectors_that_stand_otherwise_than_stated_are_refused():
    turned = HeadRun(beam="+z", detector_x="+y", detector_y="+x", distance_mm=NEAR_MM)
    with pytest.raises(
        DataError,
        match=r"commission: qd: expected a roll within 500 mrad.*check detector_x and detector_y",
    ):
        Rig(2).commissioned(run=turned)
    towards = HeadRun(beam="-z", detector_x="+x", detector_y="+y", distance_mm=NEAR_MM)
    with pytest.raises(DataError, match=r"commission: (lever|psd)"):
        Rig(2).commissioned(run=towards)


def test_a_sum_at_its_end_and_a_clipped_spot_are_refused():
    plain = ordinary_head(3)
    with pytest.raises(
        DataError,
        match=r"commission: qd: expected a sum that varies with the noise of the light, found a "
        r"sum that repeats the value 9.*the electronics are saturated",
    ):
        Rig(3, qd=replace(plain.qd, ceiling=0.9)).commissioned()
    standings = Rig(3).standings()
    far_mm, highest = (
        max(one.position_mm[2] for one in standings),
        np.median(standings[0].channels[:, 5]),
    )
    ended = [
        Standing(
            position_mm=one.position_mm,
            time_s=one.time_s,
            channels=np.where(np.arange(9) == 5, np.minimum(risen, highest), risen),
        )
        for one in standings
        for risen in [one.channels * (1.01 if one.position_mm[2] == far_mm else 0.999)]
    ]
    with pytest.raises(
        DataError,
        match=r"commission: psd1: expected a sum that varies with the noise of the light",
    ):  # at the far end alone
        commission(ended, NEW, RUN, "z", "2026-11-26")
    cut = standings[4].channels.copy()
    cut[:, 2] *= 0.95
    standings[4] = Standing(
        position_mm=standings[4].position_mm, time_s=standings[4].time_s, channels=cut
    )
    with pytest.raises(
        DataError,
        match=r"commission: qd: .*differs from the other sums by 5\.\d %: this detector",
    ):
        commission(standings, NEW, RUN, "z", "2026-11-26")


def test_a_curve_that_the_run_contradicts_is_refused():
    rig = Rig(4)
    made = rig.commissioned().file
    assert rig.commissioned(made).file.qd.x.coefficients_um == pytest.approx(
        made.qd.x.coefficients_um, rel=0.01
    )
    double = AxisTable(
        coefficients_um=tuple(2 * c for c in made.psd1.x.coefficients_um),
        low=-0.95,
        high=0.95,
    )
    with pytest.raises(
        DataError, match=r"commission: psd1.x: expected gains from 0.95 to 1.05, found 0\.50"
    ):
        rig.commissioned(made.with_axis("psd1", "x", double))
