"""What the conclusion promises of a machine after compensation, against exact machines that are
then compensated with those very tables."""

from datetime import date
from pathlib import Path

import numpy as np

from stepdiag.base.result.field import without_rigid_motion
from stepdiag.conclusion import Reach, conclude, export_of
from stepdiag.exporters.export.export import export
from stepdiag.exporters.tables.tables import mean_correction_um
from stepdiag.solver.methods.solve import solve
from testkit.exact.surveys import IDEAL, Bench
from testkit.examples import spread

MACHINES = spread([seed for seed in range(13) if seed != 6], 2)
"""The survey of machine 6 is refused: its diagonals and linear runs differ by three standard
uncertainties."""
INSIDE = 10
"""Points along each axis at which the truth is asked, none on a face: a mean over the volume."""


def bench(seed: int) -> Bench:
    """Return a machine with angles to 20 urad, drift to 2 um/h an axis, and up to four waves of 1.5
    µm in each displacement."""
    drawn = np.random.default_rng((15, seed))
    drift = drawn.uniform(-2.0, 2.0, 3)
    return Bench(
        seed=3000 + seed,
        angle_urad=float(drawn.uniform(0.0, 20.0)),
        waves=int(drawn.integers(2, 5)),
        wave_um=1.5,
        drift_um_h=(float(drift[0]), float(drift[1]), float(drift[2])),
    )


def promised_and_true(one: Bench, folder: Path) -> tuple[Reach, float]:
    """Return what is promised, and the true rms after the exported tables are loaded, over the
    whole volume, in um."""
    result = solve(one.survey(), chain=one.chain, assumed=IDEAL)
    written = export(
        result,
        "siemens",
        None,
        step_mm=25.0,
        accept=("slope-steep",),
        out_dir=folder,
        today=date(2026, 1, 1),
    )
    middles = (np.arange(INSIDE) + 0.5) / INSIDE
    points = np.stack(np.meshgrid(middles, middles, middles), axis=-1).reshape(
        -1, 3
    ) * np.asarray(one.size_mm)
    left = without_rigid_motion(
        result.volume,
        points,
        one.machine.error_at(points) + mean_correction_um(written.tables, points),
    )
    return conclude(result, [export_of(written)]).reach, float(
        np.sqrt(np.mean(np.sum(left**2, axis=1)))
    )


def test_the_true_value_after_compensation_lies_in_the_interval_promised(
    tmp_path: Path,
) -> None:
    """Over twelve machines, six in a usual run, all intervals but one hold it: k = 2, in 93 to 99 %
    (58 of 59 in a longer run, benchmarks/HONESTY.md).

    And they are no excuse: the upper end is on average less than twice the lower.
    """
    held, wide = [], []
    for seed in MACHINES:
        reach, left_um = promised_and_true(bench(seed), tmp_path / f"{seed}")
        promise = reach.rms_after
        assert promise is not None
        assert promise.low_um is not None
        assert promise.high_um is not None
        held.append(promise.low_um <= left_um <= promise.high_um)
        wide.append(promise.high_um / promise.low_um)
    assert sum(held) >= len(MACHINES) - 1, held
    assert float(np.mean(wide)) < 2.0
