"""``python -m benchmarks.large_angles N [ANGLE...]``: what the solver leaves at machines with large
angles, beside a plain Gaussian estimator that knows how large these are.

The plain estimator is linear. Its columns are differences of the virtual machine's readings: the
nine functions as values at the targets, the nine angular functions as the half waves from which
machines are drawn, the lean of each mirror, the zero of each setup. Its priors are the true mean
squares of the waves and the true noise. Nothing of the solver is in it. Machines and surveys are
those of `benchmarks.explained`, seeds from 900.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks import explained
from benchmarks.exact import ExactModel, left_um
from stepdiag.base.readings.readings import Readings
from stepdiag.base.volume import rms
from stepdiag.virtual.drive.sequence import Box
from stepdiag.virtual.physics.machine import Machine
from stepdiag.virtual.physics.optics import perpendiculars

Array = NDArray[np.float64]
FIRST, ANGLES_URAD = 900, (5.0, 30.0, 90.0)
FREE_UM, LEAN_UM = 1e4, 1e3


@dataclass(frozen=True, kw_only=True)
class Plain:
    """The estimator of one plan and one size of angles."""

    model: ExactModel
    start_um: Array
    gain: Array

    @classmethod
    def of(cls, row: explained.Row) -> "Plain":
        """Return the estimator for the surveys of a row."""
        size = np.array(explained.SIZE_MM)
        model = ExactModel(
            box=Box(
                origin_mm=(0.0, 0.0, 0.0),
                size_mm=explained.SIZE_MM,
                increments=row.increments,
            ),
            setups=row.setups,
            noise_um={},
            angle_urad=row.angle_urad,
            chain="FXYZ",
        )
        count = sum(model.counts[:2])
        start = _quiet(row, model.machine(np.zeros(count)))
        start_um = 1e3 * start.reading_mm
        own = [
            1e3 * _quiet(row, model.machine(one)).reading_mm - start_um
            for one in np.eye(count)
        ]
        beside, usual = _leans_and_zeros(start, size)
        slopes = np.column_stack([*own, *beside])
        prior = np.concatenate([np.full(model.counts[0], FREE_UM), model.usual_urad(), usual])
        weight = 1.0 / (explained.NOISE_UM**2 + explained.REPEATABILITY_UM**2)
        matrix = weight * slopes.T @ slopes + np.diag(prior**-2.0)
        gain: Array = np.linalg.solve(matrix, weight * slopes.T).astype(
            np.float64, copy=False
        )
        return cls(model=model, start_um=start_um, gain=gain[:count])

    def machine(self, readings: Readings) -> Machine:
        """Return the most likely machine by the readings."""
        return self.model.machine(self.gain @ (1e3 * readings.reading_mm - self.start_um))


def _quiet(row: explained.Row, machine: Machine) -> Readings:
    """Return the readings of a machine without noise, misses and lean."""
    return explained.drive(replace(row, noise_um=0.0, stated_um=1.0), machine, 0, still=True)[
        0
    ]


def _leans_and_zeros(readings: Readings, size_mm: Array) -> tuple[list[Array], Array]:
    """Return the columns of each setup's zero and of its mirror's lean by 0.1 mrad, and their
    priors in these units.
    """
    names, columns, usual = np.array(readings.setup), [], []
    for setup in dict.fromkeys(names.tolist()):
        mine = names == setup
        columns.append(mine.astype(np.float64))
        usual.append(FREE_UM)
        if setup.startswith("linear"):
            continue
        travel = explained.signs_of(setup) * size_mm
        beside_mm = readings.position_mm - readings.position_mm[mine][0]
        for across in perpendiculars(travel / np.linalg.norm(travel)):
            columns.append(0.1 * mine * (beside_mm @ across))
            usual.append(LEAN_UM)
    return columns, np.array(usual)


def line(row: explained.Row, seeds: Sequence[int]) -> str:
    """Return the line of the table of a row."""
    plain = Plain.of(row)
    points = np.random.default_rng(5).uniform(size=(explained.POINTS, 3)) * explained.SIZE_MM
    judged, beside = [], []
    for seed in seeds:
        machine = explained.machine_of(row, seed)
        readings, truth = explained.drive(row, machine, seed)
        found = plain.machine(readings).error_at(points)
        beside.append(left_um(points, truth.error_at(points) - found))
        judged.append(explained.judge(row, seed, 1.0))
    told = [one.after for one in judged if one.after]
    left, plainly = (rms(np.array(each)) for each in ([one.true for one in told], beside))
    inside = sum(one.low <= one.true <= one.high for one in told)
    return (
        f"| {row.name} | {left:.2f} | {plainly:.2f} | {left / plainly:.2f} | {inside} of "
        f"{len(told)} | {sum(one.silent for one in judged)} |"
    )


def main(
    count: int, angles_urad: Sequence[float], show: Callable[[str], None] = print
) -> None:
    """Print the table."""
    show("| surveys | left, um | plain estimator | ratio | inside the promise | silent |")
    show("|---|---|---|---|---|---|")
    for plan in (row for row in explained.ROWS if row.name.startswith("5 urad")):
        for urad in angles_urad:
            name = plan.name.replace("5 urad", f"{urad:g} urad")
            row = replace(plan, angle_urad=urad, name=name)
            show(line(row, range(FIRST, FIRST + count)))


if __name__ == "__main__":
    main(int(sys.argv[1]), [float(one) for one in sys.argv[2:]] or ANGLES_URAD)
