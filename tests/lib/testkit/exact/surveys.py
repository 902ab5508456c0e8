"""Surveys of the exact virtual machine, as readings: nothing of the solver is used to make them."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.readings.readings import NO_ZERO, Readings, make_readings
from stepdiag.base.result.result import Result
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.model.angles import KnownAngle
from stepdiag.virtual.drive.sequence import Box
from stepdiag.virtual.drive.setups import Alignment
from stepdiag.virtual.physics.error_functions import (
    AXES,
    DISPLACEMENTS,
    Amplitudes,
    ErrorFunction,
    ErrorSet,
    random_errors,
)
from stepdiag.virtual.physics.machine import Machine
from stepdiag.virtual.physics.truth import Truth
from testkit.ordinary.measured import Conditions, simulate_pass

DATA = Path(__file__).parents[3] / "data"
DIAGONALS = ("ppp", "npp", "pnp", "ppn")
LINEAR = ("linear-x", "linear-y", "linear-z")

IDEAL = Assumptions(angles_urad=10.0, repeatability_um=0.0, growth_um_m=0.0, between_um=0.3)
"""The sizes of the machine of a `Bench`, which comes back exactly, does not grow, and has no
screws: for tests of what readings can show where the machine is no limit. What an ordinary machine
shows is asked with the default assumptions."""
IDEAL_SECTION = "[uncertainty]\n" + "".join(
    f"{name} = {getattr(IDEAL, name)}\n"
    for name in ("angles_urad", "repeatability_um", "growth_um_m", "between_um")
)
"""The same in a survey file."""


def golden_rows(name: str) -> list[dict[str, str]]:
    """Return the rows of a golden file, comments left out."""
    lines = [
        line
        for line in (DATA / f"golden_stepdiag_{name}.csv")
        .read_text(encoding="utf-8")
        .splitlines()
        if not line.startswith("#")
    ]
    return list(csv.DictReader(lines))


def golden_shapes() -> dict[str, np.ndarray]:
    """Return the true shapes behind the golden surveys by ISO name, um at the nodes."""
    shapes: dict[str, list[float]] = {}
    for row in golden_rows("expected"):
        shapes.setdefault(f"E{row['component'].upper()}{row['axis']}", []).append(
            float(row["true_endline_removed_um"])
        )
    return {name: np.array(values) for name, values in shapes.items()}


@dataclass(frozen=True, kw_only=True)
class Bench:
    """A machine with drawn errors and how its surveys are taken (the figures of the issue that asks
    for the estimator)."""

    seed: int = 0
    size_mm: tuple[float, float, float] = (500.0, 400.0, 300.0)
    origin_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    increments: int = 10
    chain: str = "FXYZ"
    angle_urad: float = 0.0
    diagonal_noise_um: float = 0.3
    linear_noise_um: float = 0.2
    tilt_mrad: float = 0.5
    states_u: bool = True
    drift_um_h: tuple[float, float, float] = (0.0, 0.0, 0.0)
    beam_offset_mm: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    reversal: Mapping[str, object] = field(default_factory=dict)
    waves: int = 0
    wave_um: float = 0.0
    errors_times: float = 1.0

    @property
    def machine(self) -> Machine:
        """Return the machine: straightness and positioning up to 9 µm, scales up to 20 µm/m,
        squareness 20 urad, all ``errors_times``."""
        wanted = Amplitudes(
            positioning_um=9.0 * self.errors_times,
            straightness_um=9.0 * self.errors_times,
            angle_urad=self.angle_urad,
            scale_um_m=20.0 * self.errors_times,
            squareness_urad=20.0 * self.errors_times,
        )
        drawn = random_errors(self.seed, self.origin_mm, self.size_mm, wanted)
        errors = ErrorSet(
            low_mm=drawn.low_mm,
            size_mm=drawn.size_mm,
            functions={
                name: self._waved(name, function)
                for name, function in drawn.functions.items()
            },
            squareness_urad=drawn.squareness_urad,
            reversal=self.reversal,  # type: ignore[arg-type]
        )
        return Machine(errors=errors, chain=self.chain, drift_um_h=self.drift_um_h)

    def _waved(self, name: str, function: ErrorFunction) -> ErrorFunction:
        """Return a displacement with ``waves`` full waves over its axis, each of a phase of its
        own; what turns stays as it is."""
        if not self.waves or name not in DISPLACEMENTS:
            return function
        turn = 2 * np.pi * self.waves / self.size_mm[AXES.index(name[2])]
        phase = float(
            np.random.default_rng((self.seed, DISPLACEMENTS.index(name))).uniform(
                0, 2 * np.pi
            )
        )
        return lambda at: (
            function(at) + self.wave_um * (np.sin(turn * at + phase) - np.sin(phase))
        )

    @property
    def truth(self) -> Truth:
        """Return the errors in the form of a result."""
        return self.machine.truth(self.increments)

    def survey(
        self,
        setups: Sequence[str] = (*DIAGONALS, *LINEAR),
        *,
        passes: Sequence[int] = (1,),
        axis_order: str = "xyz",
        joined: bool = False,
        linear_passes: Sequence[int] | None = None,
    ) -> Readings:
        """Measure: mirror and beam of every setup lean ``tilt_mrad`` in directions of their own.
        ``joined``: on one count a setup."""
        placing, rng = (
            np.random.default_rng(1000 + self.seed),
            np.random.default_rng(2000 + self.seed),
        )
        machine, box = (
            self.machine,
            Box(origin_mm=self.origin_mm, size_mm=self.size_mm, increments=self.increments),
        )
        columns: dict[str, list] = {
            "setup": [],
            "pass_number": [],
            "stop": [],
            "position_mm": [],
            "reading_mm": [],
            "beam_mm": [],
            "time_s": [],
        }
        zero: list[int] = []
        u_um: list[float] = []
        start_s = 0.0
        for setup in setups:
            linear = setup.startswith("linear")
            noise = self.linear_noise_um if linear else self.diagonal_noise_um
            how = self._alignment(placing, setup, linear=linear)
            count_from: float | None = None
            for number in linear_passes if linear and linear_passes is not None else passes:
                taken = Conditions(
                    noise_um=noise, seed=int(rng.integers(1 << 31)), start_s=start_s
                )
                one = simulate_pass(
                    machine,
                    box,
                    setup,
                    number,
                    alignment=how,
                    conditions=taken,
                    axis_order=axis_order,
                )
                start_s = float(one.time_s[-1]) + 10.0
                columns["setup"] += [setup] * len(one.stop)
                columns["pass_number"] += [number] * len(one.stop)
                for name in ("stop", "position_mm", "beam_mm", "time_s"):
                    columns[name] += getattr(one, name).tolist()
                count_from = one.first_mm if count_from is None or not joined else count_from
                columns["reading_mm"] += (
                    one.reading_mm + (one.first_mm - count_from)
                ).tolist()
                zero += [1 if joined else NO_ZERO] * len(one.stop)
                u_um += [noise] * len(one.stop)
        return make_readings(**columns, u_um=u_um if self.states_u else None, zero=zero)

    def _alignment(self, rng: np.random.Generator, setup: str, *, linear: bool) -> Alignment:
        mirror, beam = (
            self.tilt_mrad * np.array([np.cos(angle), np.sin(angle)])
            for angle in rng.uniform(0, 2 * np.pi, 2)
        )
        return Alignment(
            mirror_mrad=(float(mirror[0]), float(mirror[1])),
            beam_mrad=(0.0, 0.0) if linear else (float(beam[0]), float(beam[1])),
            beam_offset_mm=self.beam_offset_mm.get(setup, (0.0, 0.0, 0.0)),
        )

    def angles(
        self, u_urad: float, *, stated: bool = True, seed: int = 7
    ) -> dict[str, KnownAngle]:
        """Return the nine angular functions as a head would measure them, relative to their first
        position."""
        rng = np.random.default_rng(seed)
        known = {}
        for index, letter in enumerate(AXES):
            nodes = self.origin_mm[index] + np.linspace(
                0.0, self.size_mm[index], self.increments + 1
            )
            for about in "ABC":
                value = self.machine.errors.functions[f"E{about}{letter}"](nodes)
                noise = (
                    rng.normal(scale=u_urad, size=len(nodes))
                    if u_urad
                    else np.zeros(len(nodes))
                )
                noise[0] = 0.0
                u = np.full(len(nodes), u_urad if stated else np.nan)
                known[f"E{about}{letter}"] = KnownAngle(
                    position_mm=nodes, value_urad=value - value[0] + noise, u_urad=u
                )
        return known

    def lattice_mm(self) -> np.ndarray:
        """Return the corners, edges and inner points of the volume at every other node, shape (N,
        3)."""
        axes = [
            low + np.linspace(0.0, length, self.increments // 2 + 1)
            for low, length in zip(self.origin_mm, self.size_mm, strict=True)
        ]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


@cache
def solved(seed: int, angle_urad: float = 0.0) -> Result:
    """Return the result of the usual survey, four diagonals and three linear runs, of
    ``Bench(seed=seed, angle_urad=angle_urad)``.

    Angular errors are known to 1 urad. Tests that ask for many of these stand in `TOGETHER`
    (tests/conftest.py): one process solves them.
    """
    bench = Bench(seed=seed, angle_urad=angle_urad)
    return solve(bench.survey(), angles=bench.angles(1.0, seed=seed) if angle_urad else None)
