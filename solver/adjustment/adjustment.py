"""The adjustment of a survey: fit, correction for the tilts just found, noise, wrong stops."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stepdiag.solver.adjustment.robustness import MOST, most_suspicious, name_excess, name_suspicion, weight_without
from stepdiag.solver.errors import DataError
from stepdiag.solver.findings import Finding
from stepdiag.solver.geometry.volume import Vector
from stepdiag.solver.linear.fit import Fit, fit, refit
from stepdiag.solver.model.angles import Angles
from stepdiag.solver.model.design import Design, Model, build_design
from stepdiag.solver.model.lateral import MeasuredStraightness, lateral_rows
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.model.noise import LEAST_U_UM, assumed_noise, noise_classes, robust_scale, starting_u_um, variance_scale
from stepdiag.solver.model.priors import angular_effect_um, has_stated_u, make_prior

TILT_ROUNDS = 2
COMMON_ROUNDS = 2
SIZE_ROUNDS = 4
MOST_TILT_MRAD = 200.0
"""A tenth of it sends the beam past the laser after a quarter of a metre."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Adjustment:
    """The fit of a survey and what came up on the way. Rows of the fit are the readings (first m), the head's straightness and the priors.

    ``u_um`` (m,) is the standard uncertainty used for every reading, infinite where a stop was left out.
    """

    layout: Layout
    design: Design
    fit: Fit
    angles: Angles
    estimates_angles: bool
    u_um: Vector
    findings: tuple[Finding, ...] = field(default=())

    @property
    def tilt_mrad(self) -> Vector:
        """Return the lean of every setup's mirror from the machine's diagonal, shape (setups, 3)."""
        return _tilts(self.design, _smallest_machine(self.design, self.fit), len(self.layout.setups))

    @property
    def residual_um(self) -> Vector:
        """Return the residuals of the readings, shape (m,)."""
        return self.fit.residual[: len(self.layout)]


def adjust(
    layout: Layout,
    chain: str,
    *,
    angles: Angles | None = None,
    estimate_angles: bool = False,
    straightness: Sequence[MeasuredStraightness] = (),
) -> Adjustment:
    """Adjust a survey, with the ``straightness`` that a 4-DOF head measured as further rows.

    Known angular functions are taken off first (theory 5.2); those with an uncertainty are adjusted within it. ``estimate_angles``
    frees those that are not known. Raises ``UsageError`` for a wrong chain, ``DataError`` for angles that do not span the volume.
    """
    known = angles or {}
    task = _Task(layout, chain, known, straightness, estimate_angles=estimate_angles)
    return task.run()


def _both_ways(layout: Layout) -> bool:
    """Tell whether every step diagonal was driven out and back: then the two directions separate."""
    stepped = {setup.name for setup in layout.setups if setup.kind in ("step", "face")}
    ways = {(key.setup, key.outward) for key in layout.passes}
    return bool(stepped) and all((name, outward) in ways for name in stepped for outward in (True, False))


class _Task:
    """The rounds of one adjustment: they share the rows and change target and weights."""

    def __init__(
        self, layout: Layout, chain: str, angles: Angles, straightness: Sequence[MeasuredStraightness], *, estimate_angles: bool
    ) -> None:
        self.layout = layout
        self.chain = chain
        self.angles = angles
        self.estimates_angles = estimate_angles
        self.model = Model(
            angles=estimate_angles or has_stated_u(angles), reversal=_both_ways(layout), play=layout.joined, lines=len(straightness)
        )
        self.design = build_design(layout, chain, self.model)
        lateral = lateral_rows(self.design, straightness, angles)
        prior = make_prior(self.design, angles, estimate_angles=estimate_angles)
        self.u = np.concatenate([starting_u_um(layout), lateral.u, prior.u])
        self.usual_u = self.u.copy()
        self.sized = [len(self.u) - len(prior.u) + rows for rows in prior.found]
        self.kept = np.ones(len(self.u))
        self.findings: list[Finding] = []
        self.rows = self.design.rows.followed_by(lateral.rows).followed_by(prior.rows)
        freed = layout.deviation_um - angular_effect_um(layout, chain, angles)
        self.target = np.concatenate([freed, lateral.target, np.zeros(len(prior.u))])

    def run(self) -> Adjustment:
        """Return the adjustment after all rounds."""
        current = self._fit_with_tilts()
        current = self._find_common_noise(current)
        for suspicious in self._suspicions(current):
            current = suspicious
        current = self._find_noise_by_class(self._find_sizes(current))
        u = np.where(self.kept > 0, self.u / np.sqrt(np.where(self.kept > 0, self.kept, 1.0)), np.inf)
        return Adjustment(
            layout=self.layout,
            design=self.design,
            fit=current,
            angles=self.angles,
            estimates_angles=self.estimates_angles,
            u_um=u[: len(self.layout)],
            findings=tuple(self.findings),
        )

    def _fit_with_tilts(self) -> Fit:
        current = fit(self.rows, self.design.blocks, self.target, self._weight())
        for _ in range(TILT_ROUNDS):
            self.target[: len(self.layout)] = self._target_for(_smallest_machine(self.design, current))
            current = refit(self.rows, self.target, current.weight, current.inverse)
        return current

    def _target_for(self, unknowns: Vector) -> Vector:
        """Return the deviations freed of what is of second order in the tilts just found, shape (m,).

        Mirror and beam lean together (theory 4.2): every reading is short by nu^2/2 of itself, and the machine's errors are seen
        along the normal, not along the diagonal. Taking this off the deviations leaves the rows, and what they cannot see, exact.
        """
        tilt_mrad = _tilts(self.design, unknowns, len(self.layout.setups))
        self._refuse_impossible(tilt_mrad)
        leaning = self.layout.leaning(tilt_mrad)
        machine = np.where(np.arange(len(unknowns)) < self.design.columns.machine, unknowns, 0.0)
        seen_more = build_design(leaning, self.chain, self.model).rows.times(machine) - self.design.rows.times(machine)
        lean = np.sum(tilt_mrad**2, axis=1)[self.layout.setup_index]
        travel_um = self.layout.since_zero_mm() * 1e3
        known = angular_effect_um(leaning, self.chain, self.angles)
        corrected: Vector = self.layout.deviation_um + 0.5e-6 * lean * travel_um - known - seen_more
        return corrected

    def _refuse_impossible(self, tilt_mrad: Vector) -> None:
        """Raise ``DataError`` for a mirror that could not send the beam back: each round would only lead further away."""
        size = np.linalg.norm(tilt_mrad, axis=1)
        if not np.all(size <= MOST_TILT_MRAD):
            setup = self.layout.setups[int(np.argmax(np.where(np.isnan(size), np.inf, size)))].name
            raise DataError(
                f"{self.layout.source}: setup {setup}",
                expected=f"readings that a mirror leaning by at most {MOST_TILT_MRAD:g} mrad explains",
                found=f"{np.max(size):.3g} mrad",
                remedy="readings or angles are not those of this machine: look at their positions and units",
            )

    def _weight(self) -> Vector:
        weight: Vector = self.kept / self.u**2
        return weight

    def _find_common_noise(self, current: Fit) -> Fit:
        """Bring all readings of unstated noise to the one weight that their residuals show, unmoved by wrong stops."""
        unknown = self._unstated()
        for _ in range(COMMON_ROUNDS if len(unknown) else 0):
            current = self._rescaled(current, {"readings": unknown}, {"readings": robust_scale(current, unknown)})
        return current

    def _find_sizes(self, current: Fit) -> Fit:
        """Enlarge what reversal changes along an axis, and drift, to what the data show (variance components)."""
        for _ in range(SIZE_ROUNDS if self.sized else 0):
            for rows in self.sized:
                scale = variance_scale(current, rows) or 1.0
                self.u[rows] = np.maximum(self.u[rows] * scale, self.usual_u[rows])
            current = fit(self.rows, self.design.blocks, self.target, self._weight(), current.inverse.null)
        return current

    def _find_noise_by_class(self, current: Fit) -> Fit:
        """Tell diagonals from linear runs by one step of variance components; more steps would fit the noise to the residuals."""
        classes = noise_classes(self.layout)
        scales = {name: variance_scale(current, rows) for name, rows in classes.items()}
        self.findings += assumed_noise(name for name, scale in scales.items() if scale is None)
        return self._rescaled(current, classes, scales) if classes else current

    def _unstated(self) -> NDArray[np.int64]:
        return np.concatenate([np.zeros(0, dtype=np.int64), *noise_classes(self.layout).values()])

    def _rescaled(self, current: Fit, classes: dict[str, NDArray[np.int64]], scales: dict[str, float | None]) -> Fit:
        for name, rows in classes.items():
            scale = scales[name]
            if scale is not None:
                self.u[rows] = np.maximum(self.u[rows] * scale, LEAST_U_UM)
        return fit(self.rows, self.design.blocks, self.target, self._weight(), current.inverse.null)

    def _suspicions(self, current: Fit) -> Iterator[Fit]:
        """Take out one contradiction after the other and yield the fit without it."""
        most = max(2, int(MOST * len(self.layout)))
        for found in range(most + 1):
            suspicion = most_suspicious(current, self.design.columns, len(self.layout))
            if suspicion is None:
                return
            if found == most:
                self.findings.append(name_excess(most))
                return
            self.kept = weight_without(self.kept / self.u**2, suspicion) * self.u**2
            self.findings.append(name_suspicion(self.layout, suspicion))
            current = self._find_common_noise(self._fit_with_tilts())
            yield current


def _smallest_machine(design: Design, current: Fit) -> Vector:
    """Return the unknowns of the smallest machine that explains the readings.

    Tilts and machine slopes share what is not identified; that share is given to the tilts, which are a thousand times larger.
    """
    null = current.inverse.null
    if not null.shape[1]:
        return current.unknowns
    machine = slice(0, design.columns.machine)
    shift = np.linalg.lstsq(null[machine], -current.unknowns[machine], rcond=None)[0]
    smallest: Vector = current.unknowns + null @ shift
    return smallest


def _tilts(design: Design, unknowns: Vector, setups: int) -> Vector:
    """Return the tilts (setups, 3) in mrad."""
    tilts = np.zeros((setups, 3))
    size = unknowns[design.columns.tilt : design.columns.drift]
    np.add.at(tilts, np.array(design.columns.tilt_setup, dtype=np.int64), size[:, None] * design.tilt_direction)
    return tilts
