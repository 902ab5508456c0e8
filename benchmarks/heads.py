"""``python -m benchmarks.heads``: 4-DOF heads with every imperfection drawn, commissioned by the
machine, then driven out and back.

Exact rays (`stepdiag.virtual.instruments.head`) that share no code with the product. For every
class of head: the share of true values of both straightness and both angular functions within 2 u,
how far off the worst is in u, and the rms error.
"""

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.errors import StepdiagError
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.survey.file import parse_survey
from stepdiag.daq.survey.head_file import HeadFile, HeadIdentity, render_head_file
from stepdiag.daq.survey.models import Survey
from stepdiag.fourdof.commission import Standing, commission
from stepdiag.fourdof.runs import evaluate_head, over_passes
from stepdiag.virtual.instruments.head import (
    Counts,
    Disturbance,
    HeadOptics,
    HeadStand,
    VirtualHead,
    Wander,
)
from testkit.ordinary.heads import Imperfections, ordinary_head, stage_pose

Array = NDArray[np.float64]
STAND = HeadStand(np.zeros(3), *np.eye(3)[[2, 0, 1]])
STILL = np.zeros((1, 2))
SURVEY = """
[survey]
name = "heads"
machine = "exact"
[volume]
size_mm = [{travel}, {travel}, {travel}]
increments = {stops}
[plan]
setups = ["fourdof-z"]
return_pass = {back}
[machine]
compensation = "off"
[laser]
format = "umd"
port = "/dev/none"
[environment]
source = "fixed"
[uncertainty]
source_shift_um = 0.0
[head]
format = "fourdof"
port = "/dev/none-either"
id = "4D-43"
calibration = "head.toml"
[head.z]
beam = "+z"
detector_x = "+x"
detector_y = "+y"
distance_mm = {near}
"""
NONE = Imperfections(
    defocus_mm=0.0, roll_mrad=0.0, growth_per_m=0.0, gain=0.0, dark=0.0, signs=False
)

SEEDS = range(4300, 4360)


@dataclass(frozen=True, kw_only=True)
class Case:
    """A class of heads and runs: what is imperfect, the travel, the pointing's drift, noise of PSD1
    in a stop's mean, passes, and by how much a jog misses (k = 1)."""

    name: str
    size: Imperfections
    travel_mm: float = 1000.0
    near_mm: float = 300.0
    stops: int = 10
    pointing_urad: float = 15.0
    period_s: float = 400.0
    noise_urad: float = 0.0
    passes: int = 2
    jog_um: float = 0.5
    wobble_urad: float = 120.0


CASES = (
    Case(name="ideal", size=NONE),
    Case(name="PSDs 0.3 mm out of focus", size=replace(NONE, defocus_mm=0.3)),
    Case(name="spot grows by 1.5 % a metre", size=replace(NONE, growth_per_m=0.015)),
    Case(name="rolls of 20 mrad", size=replace(NONE, roll_mrad=20.0)),
    Case(name="every imperfection", size=Imperfections()),
    Case(name="every imperfection, 3 m", size=Imperfections(), travel_mm=3000.0),
    Case(name="every imperfection, 0.4 m", size=Imperfections(), travel_mm=400.0),
    *(
        Case(
            name=f"8 m one way, PSD1 {noise:g} urad",
            size=NONE,
            travel_mm=8000.0,
            stops=16,
            noise_urad=noise,
            passes=1,
        )
        for noise in (0.5, 1.0, 1.7)
    ),
)


@dataclass(frozen=True, kw_only=True)
class Guideway:
    """Two straightness functions in um and two angles in urad over the way from 0 to 1, a slope,
    and how they are drawn."""

    seed: int

    def at(self, way: Array) -> tuple[Array, Array]:
        """Return lateral motion in um (N, 2), the beam's misalignment in it, and angles in urad (N,
        2)."""
        rng = np.random.default_rng([self.seed, 7])
        waves = np.arange(1, 5)
        size = rng.normal(size=(4, 4)) / waves[:, None]
        phase = rng.uniform(0.0, 2.0 * math.pi, size=(4, 4))
        value = np.einsum(
            "wk,nwk->nk",
            size,
            np.sin(math.pi * waves[None, :, None] * way[:, None, None] + phase[None]),
        )
        slope = rng.normal(0.0, 60.0, size=2)
        return 4.0 * value[:, :2] + slope * way[:, None], 15.0 * value[:, 2:]


@dataclass(frozen=True, kw_only=True)
class Rig:
    """One head on one guideway."""

    case: Case
    seed: int

    def survey(self) -> Survey:
        """Return the survey whose run this is."""
        case = self.case
        back = str(case.passes > 1).lower()
        return parse_survey(
            SURVEY.format(
                travel=case.travel_mm, stops=case.stops, near=case.near_mm, back=back
            ),
            "survey.toml",
        )

    def optics(self) -> HeadOptics:
        """Return the head's optics."""
        return ordinary_head(self.seed, self.case.size)

    def head(self) -> VirtualHead:
        """Return the head, aligned at the near end."""
        drift = Wander(
            amplitude=self.case.pointing_urad, period_s=self.case.period_s, seed=self.seed
        )
        wobble = Wander(amplitude=self.case.wobble_urad, period_s=2.5, seed=self.seed + 1)
        aligned = stage_pose(self.case.near_mm, STILL, STILL, STAND)
        return VirtualHead(
            self.optics(),
            STAND,
            aligned,
            disturbance=Disturbance(pointing_urad=drift, wobble_urad=wobble),
            seed=self.seed,
        )

    def look(
        self,
        head: VirtualHead,
        way: float,
        moved_um: Array,
        time_s: Array,
        *,
        wobbled: bool = False,
        lit: bool = True,
    ) -> Counts:
        """Return what the head counts with the target at a place of the way, moved aside."""
        lateral, angle = Guideway(seed=self.seed).at(np.array([way]))
        many = np.ones((len(time_s), 1))
        pose = stage_pose(
            self.case.near_mm + way * self.case.travel_mm,
            1e-3 * (lateral + moved_um) * many,
            angle * many,
            STAND,
        )
        return head.channels(
            pose,
            time_s,
            np.full(len(time_s), float(lit)),
            np.full(len(time_s), float(wobbled)),
        )

    def commissioning(self) -> list[Standing]:
        """Return the stands of the commissioning run: jogs at both ends, wobbles, and the beam
        blocked."""
        rng = np.random.default_rng([self.seed, 11])
        head, standings, now = self.head(), [], 1000.0
        for way in (0.0, 1.0):
            for column in range(2):
                for place in (-300.0, -150.0, 0.0, 150.0, 300.0):
                    jog = np.zeros(2)
                    jog[column] = place
                    time = now + np.arange(0.0, 2.0, 0.01)
                    missed = rng.normal(0.0, self.case.jog_um, size=2)
                    standings.append(
                        self._standing(
                            way, jog, time, self.look(head, way, jog + missed, time)
                        )
                    )
                    now += 3.0
            time = now + np.arange(0.0, 30.0, 0.01)
            standings.append(
                self._standing(
                    way,
                    np.zeros(2),
                    time,
                    self.look(head, way, np.zeros(2), time, wobbled=True),
                )
            )
            now += 60.0
        time = now + np.arange(0.0, 5.0, 0.01)
        standings.append(
            self._standing(
                1.0, np.zeros(2), time, self.look(head, 1.0, np.zeros(2), time, lit=False)
            )
        )
        return standings

    def _standing(self, way: float, jog_um: Array, time_s: Array, counts: Counts) -> Standing:
        place = np.array([*(1e-3 * jog_um), way * self.case.travel_mm])
        return Standing(position_mm=place, time_s=time_s, channels=counts.astype(np.float64))

    def book(self, survey: Survey) -> PassBook:
        """Return the passes of the run."""
        head, book, now = self.head(), PassBook(survey), 2000.0
        rng = np.random.default_rng([self.seed, 13])
        order = np.arange(self.case.stops + 1)
        for number in range(self.case.passes):
            for stop in order if number % 2 == 0 else order[::-1]:
                now += 5.0
                counts = self.look(
                    head, stop / self.case.stops, np.zeros(2), now + np.arange(0.0, 0.5, 0.02)
                )
                book.add(
                    self._stop(
                        counts, int(stop), outward=number % 2 == 0, time_s=now, rng=rng
                    )
                )
        return book

    def _stop(
        self,
        counts: Counts,
        stop: int,
        *,
        outward: bool,
        time_s: float,
        rng: np.random.Generator,
    ) -> CapturedStop:
        mean, u = counts.mean(axis=0), counts.std(axis=0, ddof=1) / math.sqrt(len(counts))
        noise = self.case.noise_urad * 1e-6 * 150.0 / 2.0 * 1e6
        mean[3:5] += rng.normal(0.0, noise, size=2) if noise else 0.0
        u[3:5] = np.hypot(u[3:5], noise)
        place = stop / self.case.stops * self.case.travel_mm
        return CapturedStop(
            setup="fourdof-z",
            outward=outward,
            stop=stop if outward else self.case.stops - stop,
            position_mm=(0.0, 0.0, place),
            axis="z",
            stop_count=None,
            reading_mm=None,
            u_um=0.1,
            scatter_um=0.1,
            slope_um_s=0.0,
            samples=25,
            rejected=0,
            window_from_ns=0,
            window_to_ns=0,
            time_s=time_s,
            beam=1.0,
            channels=tuple(mean.tolist()),
            u_channels=tuple(u.tolist()),
        )


def new_file() -> HeadFile:
    """Return the file that `fourdof new` writes."""
    return HeadFile(
        head=HeadIdentity(id="4D-43", format="fourdof", date="2026-03-31", version=2)
    )


def after(rig: Rig) -> HeadFile:
    """Return what the commissioning finds."""
    line = rig.survey().head.z  # type: ignore[union-attr]
    return commission(rig.commissioning(), new_file(), line, "z", "2026-11-26").file


@dataclass(frozen=True, kw_only=True)
class Seen:
    """Errors of one run and their u, over all positions: straightness in um and angles in urad."""

    error: Array
    u: Array
    straight: NDArray[np.bool_]

    @property
    def within(self) -> float:
        """Return the share within 2 u."""
        return float(np.mean(np.abs(self.error) <= 2.0 * self.u))


def seen(rig: Rig, file: HeadFile) -> Seen:
    """Return what the run says with this calibration beside the truth. Raises StepdiagError for
    what is refused."""
    survey = rig.survey()
    found = evaluate_head(
        survey, rig.book(survey).passes, {"head.toml": render_head_file(file).encode()}, {}
    )
    lateral, angle = Guideway(seed=rig.seed).at(np.linspace(0.0, 1.0, rig.case.stops + 1))
    share = np.linspace(0.0, 1.0, len(lateral))[:, None]
    straight = lateral - (1.0 - share) * lateral[0] - share * lateral[-1]
    errors, u, kind = [], [], []
    for one in over_passes(found):
        true = straight[:, "XY".index(one.name[1])]
        errors.append((one.value_um - true)[1:-1])
        u.append(one.u_um[1:-1])
        kind.append(np.ones(len(true) - 2, dtype=np.bool_))
    for name, known in found.angles.items():
        # a turn about Y sends the reflection of a beam along +Z against X, one about X along Y
        true = -(angle[:, 0] - angle[0, 0]) if name == "EBZ" else angle[:, 1] - angle[0, 1]
        errors.append((known.value_urad - true)[1:])
        u.append(known.u_urad[1:])
        kind.append(np.zeros(len(true) - 1, dtype=np.bool_))
    return Seen(
        error=np.concatenate(errors), u=np.concatenate(u), straight=np.concatenate(kind)
    )


def tried(case: Case, seeds: Sequence[int]) -> Iterator[Seen | None]:
    """Yield what each head of a class says, None where it is refused."""
    for seed in seeds:
        rig = Rig(case=case, seed=seed)
        try:
            yield seen(rig, after(rig))
        except StepdiagError:
            yield None


def line(case: Case, seeds: Sequence[int]) -> str:
    """Return a row of the table."""
    runs = [one for one in tried(case, seeds) if one is not None]
    refused = len(seeds) - len(runs)
    if not runs:
        return f"| {case.name} | - | - | - | - | - | {refused} |"
    parts = []
    for straight in (True, False):
        within = [
            float(np.mean((np.abs(one.error) <= 2.0 * one.u)[one.straight == straight]))
            for one in runs
        ]
        rms = math.sqrt(
            float(
                np.mean(
                    np.concatenate([one.error[one.straight == straight] for one in runs]) ** 2
                )
            )
        )
        parts += [f"{100 * float(np.mean(within)):.0f}", f"{rms:.2f}"]
    worst = max(float(np.max(np.abs(one.error) / one.u)) for one in runs)
    return f"| {case.name} | {' | '.join(parts)} | {worst:.1f} | {refused} |"


def print_table(seeds: Sequence[int], part: str = "") -> None:
    """Print the table."""
    print(
        "| heads | straightness within 2 u, % | rms, um | angles within 2 u, % | rms, urad | "
        "worst in u | refused |"
    )
    print("|---|---|---|---|---|---|---|")
    for case in CASES:
        if part in case.name:
            print(line(case, seeds), flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=len(SEEDS), help="heads of each class")
    parser.add_argument("--first", type=int, default=SEEDS[0], help="the first seed")
    parser.add_argument("--case", default="", help="only classes whose name contains this")
    options = parser.parse_args()
    print_table(range(options.first, options.first + options.runs), options.case)


if __name__ == "__main__":
    main()
