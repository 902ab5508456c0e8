"""``python -m benchmarks.sensitivity [--draws N] [--save FILE] [--beside FILE]``: which faults of a
standstill the capture sees, and what error enters the reading of a stop without a finding.

Every draw is a standstill of 0.8 to 1.6 s in virtual time, with one fault: a step of the count
within the standstill or between two stops, a drift, or a frozen value. Half of the standstills are
the first of a pass; the other half follow six standstills without a fault, which show the noise of
the pass. Standstills without a fault count false alarms: white noise, vibration, and slow air.

Counted are the share of the standstills that are doubted or refused, the largest error of the
others, and how many of all standstills are silent with an error beyond 2 u, twice the standard
uncertainty of the reading. The error of a reading is its difference from the place at the beginning
of the standstill. Each cell has the figures of 10, 50 and 1000 samples a second.

``--save`` keeps the counts; ``--beside`` prints saved counts of another tree as "that -> this".
"""

import argparse
import json
import math
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.readings.runs import Plan, Run
from stepdiag.base.volume import Volume
from stepdiag.daq.capture.naming.route import judge_step, route_of
from stepdiag.daq.capture.standing.certain_window import PassNoise, Taken, certain_windows
from stepdiag.daq.capture.standing.dwell import Dwell
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.survey.models import StopRules
from stepdiag.daq.timing.stream import Break, Span

DRAWS = 200
RATES_HZ = (10.0, 50.0, 1000.0)
RULES = StopRules()
SHOWING = 6
"""Standstills after which a pass shows its noise."""
ALIKE = 20
"""Draws that share the standstills before them."""
RESOLUTION_UM = 0.001
SETTLING_UM, SETTLING_S = 20.0, 0.05
"""A machine comes to rest from so far, exponentially: what a value that freezes too early keeps."""
AIR_HZ = np.geomspace(0.05, 5.0, 8)
"""Relaxations that make 1/f noise together."""

Values = NDArray[np.float64]
Noise = Callable[[np.random.Generator, Values], Values]
Fault = Callable[[np.random.Generator, Values, Values], Values]
"""Takes the times in s and the readings in um, and returns the readings with the fault."""


class Stream:
    """The samples of one standstill, as `certain_windows` asks for them."""

    resolution_um = RESOLUTION_UM

    def __init__(self, time_s: Values, um: Values) -> None:
        self._time_ns = time_s * 1e9
        self._mm = np.round(um / RESOLUTION_UM) * RESOLUTION_UM * 1e-3

    @property
    def breaks(self) -> list[Break]:
        """No count is lost."""
        return []

    def newest_ns(self) -> float:
        """Return the time of the last sample."""
        return float(self._time_ns[-1])

    def span(self, from_ns: float, to_ns: float, arrived_before_ns: float = math.inf) -> Span:
        """Return the samples of a time."""
        begin, end = np.searchsorted(
            self._time_ns, [from_ns, min(to_ns, arrived_before_ns) + 1.0]
        )
        times = self._time_ns[begin:end]
        return Span(
            time_ns=times,
            position_mm=self._mm[begin:end],
            beam=np.ones(len(times)),
            channels=None,
            unusable=0,
        )


def white(size_um: float) -> Noise:
    """Return noise without a memory."""
    return lambda rng, time_s: rng.normal(0.0, size_um, len(time_s))


def slow(size_um: float, corners_hz: Values) -> Noise:
    """Return the mean of relaxations, of this standard deviation together."""

    def noise(rng: np.random.Generator, time_s: Values) -> Values:
        rate_hz = 1.0 / (time_s[1] - time_s[0])
        size = 1 << int(np.ceil(np.log2(max(2.0 * len(time_s), 8.0 * rate_hz))))
        hz = np.fft.rfftfreq(size, 1.0 / rate_hz)[:, None]
        density = np.mean(2.0 / np.pi / corners_hz / (1.0 + (hz / corners_hz) ** 2), axis=1)
        drawn = rng.normal(size=(2, len(hz)))
        parts = np.sqrt(density * rate_hz * size / 4.0) * (drawn[0] + 1j * drawn[1])
        values: Values = size_um * np.fft.irfft(parts)[: len(time_s)]
        return values

    return noise


def vibration(size_um: float) -> Noise:
    """Return white noise, and a vibration three times its size at 8 to 60 Hz."""

    def noise(rng: np.random.Generator, time_s: Values) -> Values:
        hz, phase = rng.uniform(8.0, 60.0), rng.uniform(0.0, 6.3)
        swing: Values = 3.0 * size_um * np.sin(2.0 * np.pi * hz * time_s + phase)
        return swing + white(size_um)(rng, time_s)

    return noise


def stepped(size_um: float) -> Fault:
    """Return a slip of the count at a drawn time of the window."""
    return lambda rng, time_s, um: (
        um
        + rng.choice([-1.0, 1.0])
        * size_um
        * (time_s >= rng.uniform(RULES.settle_s, time_s[-1]))
    )


def drifting(um_s: float) -> Fault:
    """Return a constant drift from the beginning of the standstill on."""
    return lambda rng, time_s, um: um + rng.choice([-1.0, 1.0]) * um_s * time_s


def repeated(times: int) -> Fault:
    """Return a display that shows each value so many times."""
    return lambda _rng, _time_s, um: um[np.arange(len(um)) // times * times]


def frozen_within(rng: np.random.Generator, _time_s: Values, um: Values) -> Values:
    """Return a laser that stops updating at a drawn time of the standstill."""
    last = int(rng.integers(1, len(um)))
    return np.where(np.arange(len(um)) < last, um, um[last])


def frozen_before(rng: np.random.Generator, _time_s: Values, um: Values) -> Values:
    """Return a laser that stops updating while the machine comes to rest."""
    off_um = SETTLING_UM * np.exp(-rng.uniform(0.0, RULES.settle_s) / SETTLING_S)
    return np.full(len(um), um[0] + off_um)


def without(_rng: np.random.Generator, _time_s: Values, um: Values) -> Values:
    """Return a standstill without a fault."""
    return um


STEPS_UM = (0.2, 0.5, 1.0, 2.0, 5.0, 20.0)
DRIFTS_UM_S = (0.05, 0.2, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0)
NOISES: dict[str, Noise] = {
    "0.02 white": white(0.02),
    "0.3 white": white(0.3),
    "0.02 air": slow(0.02, AIR_HZ),
    "0.3 air": slow(0.3, AIR_HZ),
}
CLEAN: dict[str, Noise] = {
    **NOISES,
    "1.0 air": slow(1.0, AIR_HZ),
    "0.02 vibration": vibration(0.02),
    "0.3 vibration": vibration(0.3),
    "0.02 memory of 0.2 s": slow(0.02, np.array([0.8])),
    "0.3 memory of 0.2 s": slow(0.3, np.array([0.8])),
    "0.02 memory of 2 s": slow(0.02, np.array([0.08])),
    "0.3 memory of 2 s": slow(0.3, np.array([0.08])),
}
FAULTS: dict[str, Fault] = {
    **{f"step of {size:g} um": stepped(size) for size in STEPS_UM},
    **{f"drift of {size:g} um/s": drifting(size) for size in DRIFTS_UM_S},
    **{f"each value {times} times": repeated(times) for times in (2, 5, 10)},
    "frozen from a time on": frozen_within,
    "frozen before the window": frozen_before,
}


@dataclass
class Count:
    """What was counted of one fault, one noise and one rate."""

    draws: int = 0
    first: int = 0
    """Found among the first standstills of a pass."""
    later: int = 0
    """Found among the standstills of a pass that shows its noise."""
    beyond: int = 0
    """Silent, with an error beyond 2 u."""
    largest_um: float = 0.0
    """The largest silent error."""
    codes: dict[str, int] = field(default_factory=dict)

    def add(self, codes: list[str], *, later: bool, error_um: float, u_um: float) -> None:
        """Count a standstill."""
        self.draws += 1
        for code in codes:
            self.codes[code] = self.codes.get(code, 0) + 1
        if codes:
            self.later, self.first = self.later + later, self.first + (not later)
            return
        self.beyond += abs(error_um) > 2.0 * u_um
        self.largest_um = max(self.largest_um, abs(error_um))


def standstill(
    rng: np.random.Generator, noise: Noise, fault: Fault, rate_hz: float
) -> Taken | None:
    """Return the window of a drawn standstill whose place is zero."""
    dwell_s = rng.uniform(0.8, 1.6)
    time_s = np.arange(rng.uniform(0.0, 1.0) / rate_hz, dwell_s, 1.0 / rate_hz)
    stream = Stream(time_s, fault(rng, time_s, noise(rng, time_s)))
    dwell = Dwell(
        from_ns=0,
        to_ns=int(dwell_s * 1e9),
        not_before_ns=None,
        signals=Signals(stopped=True),
    )
    windows = certain_windows(stream, dwell, RULES)
    return windows[-1] if windows else None


def counted(draws: int, seed: int, noise: Noise, fault: Fault, rate_hz: float) -> Count:
    """Return the counts of a fault."""
    rng, count = np.random.default_rng((seed, int(rate_hz))), Count()
    shown = PassNoise()
    for draw in range(2 * draws):
        later = draw % 2 == 1
        if draw % ALIKE == 0:
            shown = PassNoise()
            for _ in range(SHOWING):
                if before := standstill(rng, noise, without, rate_hz):
                    shown.take(before, RULES)
        passed = deepcopy(shown) if later else PassNoise()
        taken = standstill(rng, noise, fault, rate_hz)
        if taken is None:
            count.add(["no reading"], later=later, error_um=0.0, u_um=0.0)
            continue
        taken = passed.take(taken, RULES)
        codes = sorted({each.key for each in taken.doubts})
        error_um = taken.window.mean_mm * 1e3
        count.add(codes, later=later, error_um=error_um, u_um=taken.window.u_um)
    return count


def counted_between(
    draws: int, seed: int, noise: Noise, size_um: float, rate_hz: float
) -> Count:
    """Return the counts of a slip of the count between two stops."""
    rng, count = np.random.default_rng((seed, int(rate_hz))), Count()
    for draw in range(2 * draws):
        x_mm, y_mm, z_mm = rng.uniform(100.0, 600.0, 3).tolist()
        plan = Plan(
            volume=Volume(
                origin_mm=(0.0, 0.0, 0.0), size_mm=(x_mm, y_mm, z_mm), increments=10
            ),
            runs=(Run(setup="ppp"),),
            axis_order="xyz",
        )
        route, stop = route_of(plan, "ppp", 1), int(rng.integers(1, 31))
        before, after = (standstill(rng, noise, without, rate_hz) for _ in range(2))
        if before is None or after is None:
            count.add(["no reading"], later=draw % 2 == 1, error_um=0.0, u_um=0.0)
            continue
        error_mm = size_um * 1e-3 + after.window.mean_mm - before.window.mean_mm
        moved_mm = route.step_mm(stop - 1, stop) + error_mm
        found = judge_step(route, stop - 1, stop, moved_mm, float(route.nominal_mm[stop]))
        count.add(
            [found.key] if found else [],
            later=draw % 2 == 1,
            error_um=error_mm * 1e3,
            u_um=math.hypot(before.window.u_um, after.window.u_um),
        )
    return count


def rows(draws: int) -> Iterator[tuple[str, list[Count]]]:
    """Yield every fault and noise with the counts of each rate."""
    for name, fault in FAULTS.items():
        for number, (kind, noise) in enumerate(NOISES.items()):
            yield (
                f"{name} | {kind}",
                [counted(draws, number, noise, fault, rate) for rate in RATES_HZ],
            )
    for size_um in STEPS_UM:
        for number, (kind, noise) in enumerate(NOISES.items()):
            if "white" in kind:
                yield (
                    f"{size_um:g} um between stops | {kind}",
                    [
                        counted_between(draws, number, noise, size_um, rate)
                        for rate in RATES_HZ
                    ],
                )
    for number, (kind, noise) in enumerate(CLEAN.items()):
        yield (
            f"none | {kind}",
            [counted(5 * draws, 100 + number, noise, without, rate) for rate in RATES_HZ],
        )


def cells(counts: list[Count]) -> list[str]:
    """Return the figures of a row, those of the rates in one cell."""
    return [
        " / ".join(f"{200 * each.first / each.draws:.3g}" for each in counts),
        " / ".join(f"{200 * each.later / each.draws:.3g}" for each in counts),
        " / ".join(f"{each.largest_um:.2f}" for each in counts),
        " / ".join(f"{100 * each.beyond / each.draws:.3g}" for each in counts),
    ]


COLUMNS = (
    "fault",
    "noise in um",
    "found in first standstills, %",
    "found later, %",
    "largest silent error, um",
    "silent and beyond 2 u, % of all",
)


def main() -> None:
    """Draw the standstills and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--draws", type=int, default=DRAWS, help="of each kind and size")
    parser.add_argument("--save", type=Path, help="write the counts to this file")
    parser.add_argument("--beside", type=Path, help="counts of another tree")
    options = parser.parse_args()
    before = json.loads(options.beside.read_text()) if options.beside else {}
    saved = {}
    print(f"| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}")
    for name, counts in rows(options.draws):
        saved[name] = [vars(each) for each in counts]
        there = before.get(name)
        shown = cells(counts)
        if there:
            old = cells([Count(**each) for each in there])
            shown = [
                after if was == after else f"{was} -> **{after}**"
                for was, after in zip(old, shown, strict=True)
            ]
        print(f"| {name} | {' | '.join(shown)} |", flush=True)
    if options.save:
        options.save.write_text(json.dumps(saved))


if __name__ == "__main__":
    main()
