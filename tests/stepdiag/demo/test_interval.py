"""The demo's machine, surveyed as the demo surveys it: what the result promises holds the true
errors."""

import numpy as np

from stepdiag.base.readings.readings import make_readings
from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.base.volume import anywhere_mm
from stepdiag.demo.demo import promises_of, verify
from stepdiag.demo.files import PASSES, SETUPS, write_angles, write_bench
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.model.angles import parse_angles
from stepdiag.virtual.bench.building import build_box, build_machine
from stepdiag.virtual.bench.config import read_config
from stepdiag.virtual.drive.registers import PositionRegisters
from testkit.ordinary.arrivals import Scatter
from testkit.ordinary.measured import Conditions, simulate_pass


def test_the_interval_of_the_demo_holds_its_own_truth(tmp_path):
    """Before and after ideal tables, anywhere in the volume, of the seed that ``make demo``
    takes."""
    bench = write_bench(tmp_path, 1)
    write_angles(tmp_path, bench, 1)
    config = read_config(bench)
    machine, box = build_machine(config), build_box(config)
    scatter = Scatter(
        arrival_um=(config.machine.repeatability_um,) * 3,
        servo_um=(config.machine.servo_um,) * 3,
    )
    registers = PositionRegisters(
        shows=config.plc.positions,
        scatter_um=config.plc.scatter_um,
        resolution_mm=config.plc.resolution_mm,
    )
    assert (scatter.arrival_um[0], registers.shows, box.decimals) == (0.5, "actual", 3), (
        "an ordinary machine"
    )
    columns = {
        name: [] for name in ("stop", "position_mm", "reading_mm", "beam_mm", "time_s")
    }
    setup, number, start_s = [], [], 0.0
    for name in SETUPS:
        for which in range(1, PASSES + 1):
            taken = Conditions(
                noise_um=0.3,
                seed=len(setup),
                start_s=start_s,
                scatter=scatter,
                registers=registers,
            )
            one = simulate_pass(machine, box, name, which, conditions=taken)
            start_s = float(one.time_s[-1]) + 10.0
            setup += [name] * len(one.stop)
            number += [which] * len(one.stop)
            for column, values in columns.items():
                values.extend(getattr(one, column))
    result = solve(
        make_readings(setup=setup, pass_number=number, **columns),
        angles=parse_angles((tmp_path / "angles.csv").read_text(encoding="utf-8")),
    )
    points = anywhere_mm(result.volume)
    left = without_rigid_motion(
        result.volume, points, machine.error_at(points) - error_field_um(result, points)
    )
    whole_um = float(np.sqrt(np.mean(np.sum(left**2, axis=1))))
    promises = promises_of(result, verify(bench, None, ()).rms_um, whole_um)
    assert [each.kept for each in promises] == [True, True], promises
    assert not any(
        each.kept for each in promises_of(result, 0.5 * promises[0].true_um, 4.0 * whole_um)
    ), "the truth it is asked about"
