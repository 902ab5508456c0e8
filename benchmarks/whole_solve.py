"""``python -m benchmarks.whole_solve INCREMENTS REPEATS``: one survey, out and back, solved to its
result in a process of its own.

Prints the processor seconds of the solve, the largest memory until then in MB, and, unless the
survey is too large for it, the processor seconds of a dense numpy lstsq of the same readings and
unknowns, all in one thread.
"""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.stand import peak_mb
from benchmarks.table import Row
from stepdiag.base.names import BODY_DIAGONALS, LINEAR_RUNS
from stepdiag.base.readings.readings import Readings
from stepdiag.base.readings.runs import Plan, Run, perfect_readings
from stepdiag.base.volume import Volume
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.model.design import Model, build_design
from stepdiag.solver.model.layout import lay_out

NOISE_UM = 0.3
REVERSAL_UM = 4.0
LARGEST_DENSE = 100
MEMORY_OF_UNIT_MB = 2048
"""``MemoryMax`` of systemd/stepdiag@.service: the daemon has its surveys solved within it."""


def rows() -> list[Row]:
    """Return the rows of the whole solve."""
    ours, memory, theirs = _measured(81, 3)
    _, of_largest, _ = _measured(500, 1)
    what, beside = (
        "solver: n = 81, 3 repeats out and back",
        f"lstsq of the same size: {theirs:.1f} s",
    )
    return [
        Row(
            f"{what}, whole result",
            f"{ours:.1f} s",
            beside,
            f"{ours / theirs:.2f}",
            "at most 1",
            ours <= theirs,
        ),
        Row("the same: memory", f"{memory:.0f} MB", goal="500 MB", met=memory <= 500),
        Row(
            "solver: n = 500 out and back: memory",
            f"{of_largest:.0f} MB",
            goal="half the unit's 2 GB",
            met=of_largest <= MEMORY_OF_UNIT_MB / 2,
        ),
    ]


def _measured(increments: int, repeats: int) -> tuple[float, float, float]:
    one_thread = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "benchmarks.whole_solve", str(increments), str(repeats)]
    ours, memory, theirs = map(
        float,
        subprocess.run(
            command, check=True, capture_output=True, text=True, env=one_thread
        ).stdout.split(),
    )
    return ours, memory, theirs


def survey(increments: int, repeats: int) -> Readings:
    """Return four diagonals and three linear runs in a cube of one metre, each on one unbroken
    count, with noise and backlash."""
    volume = Volume(
        origin_mm=(0.0, 0.0, 0.0), size_mm=(1000.0, 1000.0, 1000.0), increments=increments
    )
    plan = Plan(
        volume=volume,
        runs=tuple(
            Run(setup=name, repeats=repeats) for name in (*BODY_DIAGONALS, *LINEAR_RUNS)
        ),
    )
    readings = perfect_readings(plan, NOISE_UM)
    back = readings.pass_number % 2 == 0
    length_mm = (
        np.where(np.char.startswith(readings.setup, "linear"), 1.0, np.sqrt(3.0))
        * volume.size_mm[0]
    )
    # on one count a return pass begins where the outward pass ended, short of what reversal has
    # lost
    counted_mm = readings.reading_mm + np.where(back, length_mm - 1e-3 * REVERSAL_UM, 0.0)
    noise_mm = 1e-3 * NOISE_UM * np.random.default_rng(0).standard_normal(len(readings))
    return replace(
        readings,
        reading_mm=counted_mm + noise_mm,
        zero=np.ones(len(readings), dtype=np.int64),
    )


def processor_s(work: Callable[[], object]) -> float:
    """Return the processor time of one call."""
    start = time.process_time()
    work()
    return time.process_time() - start


def main() -> None:
    """Solve, then the dense system, and print the figures."""
    increments, repeats = map(int, sys.argv[1:])
    readings = survey(increments, repeats)
    ours = processor_s(lambda: solve(readings))
    memory = peak_mb()
    theirs = 0.0
    if increments <= LARGEST_DENSE:
        layout = lay_out(readings)
        dense = build_design(layout, "FXYZ", Model(reversal=True, play=True)).rows.dense()
        theirs = processor_s(lambda: np.linalg.lstsq(dense, layout.deviation_um, rcond=None))
    sys.stdout.write(f"{ours} {memory} {theirs}\n")


if __name__ == "__main__":
    main()
