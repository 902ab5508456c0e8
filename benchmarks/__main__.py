"""``python -m benchmarks [--quick] [PART...]``: one table of everything that has to be fast, each
figure beside its floor or peer of the same run.
"""

import argparse
import compileall
import os
import platform
import sys
import sysconfig
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks import (
    bench_daemon,
    bench_fleet,
    bench_ingest,
    bench_latency,
    bench_memory,
    bench_replay,
    bench_solver,
    whole_solve,
)
from benchmarks.table import Row, render

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("solver", "exporters", "daq", "stepdiag", "benchmarks")


def parts(*, quick: bool) -> dict[str, Callable[[], list[Row]]]:
    """Return the parts of the table in order, at full length or at about a tenth of it."""
    return {
        "ingest": lambda: bench_ingest.rows(6.0 if quick else 60.0),
        "daemon": lambda: bench_daemon.rows(6.0 if quick else 30.0),
        "latency": bench_latency.rows,
        "replay": lambda: bench_replay.rows(0.4 if quick else 4.0),
        "memory": lambda: bench_memory.rows(2.0 if quick else 24.0),
        "solver": bench_solver.rows,
        "whole-solve": whole_solve.rows,
        "fleet": lambda: bench_fleet.rows(800 if quick else bench_fleet.RESULTS),
    }


def main() -> int:
    """Measure, print the table, return 1 where a goal was missed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks")
    parser.add_argument(
        "--quick",
        action="store_true",
        help="a tenth of the time: less sure, and the long rows are shorter than asked for",
    )
    parser.add_argument(
        "part", nargs="*", help=f"measure only these: {', '.join(parts(quick=True))}"
    )
    options = parser.parse_args()
    chosen = parts(quick=options.quick)
    if unknown := set(options.part) - set(chosen):
        parser.error(f"no part {', '.join(sorted(unknown))}")
    compile_all()
    print(f"{machine()}\n")
    rows, began = [], time.monotonic()
    for name in options.part or chosen:
        rows += chosen[name]()
        sys.stderr.write(f"{name}: {time.monotonic() - began:.0f} s\n")
    print(render(rows))
    return int(any(row.met is False for row in rows))


def compile_all() -> None:
    """Compile what is measured, as an installation does: a source without its bytecode would be
    compiled anew at every start."""
    for folder in (*(ROOT / name for name in PACKAGES), Path(sysconfig.get_path("purelib"))):
        compileall.compile_dir(folder, quiet=2)


def machine() -> str:
    """Return what this ran on, and how busy it was with other things."""
    cpu = (
        Path("/proc/cpuinfo")
        .read_text()
        .partition("model name")[2]
        .partition("\n")[0]
        .strip(" \t:")
    )
    load = ", ".join(f"{value:.1f}" for value in os.getloadavg())
    system = f"Linux {platform.release()}, Python {platform.python_version()}"
    return (
        f"{os.cpu_count()} cores of {cpu or platform.machine()}, {system}, load before {load}"
    )


if __name__ == "__main__":
    sys.exit(main())
