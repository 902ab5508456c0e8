"""Surveys of the exact machine whose stops lie beside their targets: rounded programs, scattering
encoders, registers that flicker."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepdiag.base.readings.readings import Readings, make_readings
from stepdiag.solver.model.lateral import MeasuredStraightness
from stepdiag.virtual.drive.sequence import Box, outward_direction, outward_stops_mm
from stepdiag.virtual.drive.setups import Alignment, aligned_setup
from testkit.exact.surveys import DIAGONALS, LINEAR, Bench

Program = Callable[[str, int, np.ndarray], np.ndarray]
"""From setup, pass number and the targets of a pass in mm, in the order visited, to the positions
that the machine drives to."""


def as_written(setup: str, number: int, targets_mm: np.ndarray) -> np.ndarray:
    """Drive to the targets themselves."""
    return targets_mm


def rounded(decimals: Callable[[str, int], int], *, incremental: bool = False) -> Program:
    """Drive a program of so many decimals; an ``incremental`` one (G91) adds up what its steps
    lost."""

    def drive(setup: str, number: int, targets_mm: np.ndarray) -> np.ndarray:
        places = decimals(setup, number)
        if not incremental:
            return targets_mm.round(places)
        steps = np.diff(targets_mm, axis=0).round(places)
        start = targets_mm[:1].round(places)
        return np.concatenate([start, start + np.cumsum(steps, axis=0)]).round(places + 3)

    return drive


def scattered(size_um: float, seed: int, program: Program = as_written) -> Program:
    """Stand within so many um of where the ``program`` drives to, in every axis at every stop."""

    def drive(setup: str, number: int, targets_mm: np.ndarray) -> np.ndarray:
        draw = np.random.default_rng([seed, number, *setup.encode()])
        return program(setup, number, targets_mm) + 1e-3 * size_um * draw.uniform(
            -1.0, 1.0, targets_mm.shape
        )

    return drive


@dataclass(frozen=True, kw_only=True)
class Beside:
    """The survey of a bench, without noise. ``stands`` is where the machine stands at its stops,
    ``shows`` what its registers hold of that: the same (None), or something else. ``targets_mm``
    are targets of a linear run's own, by its name."""

    bench: Bench
    setups: Sequence[str] = (*DIAGONALS, *LINEAR)
    passes: Sequence[int] = (1, 2)
    joined: bool = True
    turned: bool = False
    axis_order: str = "xyz"
    stands: Program = as_written
    shows: Program | None = None
    targets_mm: dict[str, Sequence[float]] | None = None
    u_um: float = 0.02

    def readings(self) -> Readings:
        """Return the readings, exact for where the machine stands."""
        columns: dict[str, list] = {
            name: []
            for name in (
                "setup",
                "pass_number",
                "stop",
                "position_mm",
                "reading_mm",
                "beam_mm",
                "turned",
            )
        }
        bench = self.bench
        box = Box(
            origin_mm=bench.origin_mm, size_mm=bench.size_mm, increments=bench.increments
        )
        placing = np.random.default_rng(1000 + bench.seed)
        for setup in self.setups:
            placed = aligned_setup(bench.machine, box, setup, self._alignment(placing, setup))
            first_mm, last = None, (0.0, np.zeros(3))
            for number in self.passes:
                targets = self._targets(box, setup)[:: 1 if number % 2 else -1]
                stands = self.stands(setup, number, targets)
                shows = stands if self.shows is None else self.shows(setup, number, targets)
                side = outward_direction(box, setup) * (1 if number % 2 else -1)
                count = bench.machine.indicated_mm(placed, stands, direction=np.sign(side))
                if self.turned and number > 1:
                    # the machine turned round where the pass before ended: its last reading is this
                    # pass's first
                    count[0], shows[0] = last
                last = (count[-1], shows[-1])
                first_mm = count[0] if first_mm is None or not self.joined else first_mm
                columns["setup"] += [setup] * len(shows)
                columns["pass_number"] += [number] * len(shows)
                columns["stop"] += range(len(shows))
                columns["position_mm"] += shows.tolist()
                columns["reading_mm"] += (count - first_mm).tolist()
                offset = np.array(bench.beam_offset_mm.get(setup, (0.0, 0.0, 0.0)))
                columns["beam_mm"] += [(placed.zero_mm + offset).tolist()] * len(shows)
                columns["turned"] += [self.turned and number > 1] + [False] * (len(shows) - 1)
        zero = [1 if self.joined else -1] * len(columns["stop"])
        return make_readings(**columns, u_um=[self.u_um] * len(zero), zero=zero)

    def _targets(self, box: Box, setup: str) -> np.ndarray:
        own = (self.targets_mm or {}).get(setup)
        if own is None:
            return outward_stops_mm(box, setup, self.axis_order)
        targets = np.tile(np.array(box.origin_mm, dtype=np.float64), (len(own), 1))
        targets[:, "xyz".index(setup[-1])] = own
        return targets

    def _alignment(self, placing: np.random.Generator, setup: str) -> Alignment:
        mirror, beam = (
            self.bench.tilt_mrad * np.array([np.cos(angle), np.sin(angle)])
            for angle in placing.uniform(0, 2 * np.pi, 2)
        )
        return Alignment(
            mirror_mrad=(float(mirror[0]), float(mirror[1])),
            beam_mrad=(0.0, 0.0)
            if setup.startswith("linear")
            else (float(beam[0]), float(beam[1])),
            beam_offset_mm=self.bench.beam_offset_mm.get(setup, (0.0, 0.0, 0.0)),
        )

    def head(self) -> list[MeasuredStraightness]:
        """Return what a 4-DOF head on every axis measures where the machine stands on its runs:
        without noise, on lines of its own."""
        found = []
        for axis, letter in enumerate("XYZ"):
            targets = np.tile(
                np.array(self.bench.origin_mm, dtype=np.float64),
                (self.bench.increments + 1, 1),
            )
            targets[:, axis] += np.linspace(
                0.0, self.bench.size_mm[axis], self.bench.increments + 1
            )
            stands = self.stands(f"fourdof-{letter.lower()}", 1, targets)
            shows = (
                stands
                if self.shows is None
                else self.shows(f"fourdof-{letter.lower()}", 1, targets)
            )
            for component in range(3):
                if component != axis:
                    name = f"E{'XYZ'[component]}{letter}"
                    value = self.bench.machine.errors.functions[name](stands[:, axis])
                    found.append(
                        MeasuredStraightness(
                            name=name,
                            position_mm=shows[:, axis],
                            value_um=value - value[0],
                            u_um=np.full(len(value), 0.1),
                        )
                    )
        return found


def as_exact(survey: Beside) -> Beside:
    """Return the same survey with the machine at its targets."""
    return replace(survey, stands=as_written, shows=None)
