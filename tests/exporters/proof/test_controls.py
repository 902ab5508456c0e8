"""A proof run by each control's own law: files loaded into the virtual controls, which share no
code with the product."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from stepdiag.base.readings.readings import make_readings
from stepdiag.base.volume import Volume
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.proof.judge import prove
from stepdiag.exporters.safety.verify import acting_in
from stepdiag.exporters.tables.fit import fitted
from stepdiag.virtual.control.compensation import load_files
from testkit.exact.machines import profile_of
from testkit.exact.results import made_result

VOLUME = Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=(500.0, 400.0, 300.0), increments=10)
NAMES = ("EXX", "EYY", "EZZ")
CONTROLS = ("siemens", "fanuc", "heidenhain", "beckhoff", "linuxcnc")


def driven(values, moved_um, dice):
    """Readings of a diagonal and a line of a machine with positioning errors, with what a control
    adds; the mirror leans anew."""
    rows, size = [], np.array(VOLUME.size_mm)
    for setup in ("ppp", "linear-x"):
        nodes = np.arange(31 if setup == "ppp" else 11)
        counts = (
            [(nodes + 2 - axis) // 3 for axis in range(3)]
            if setup == "ppp"
            else [nodes, 0 * nodes, 0 * nodes]
        )
        out = np.column_stack(counts) * size / 10.0
        along = out[-1] / np.linalg.norm(out[-1])
        lean = 5e-4 * dice.normal(size=3) * (setup == "ppp")
        error = np.column_stack(
            [
                np.interp(out[:, axis], VOLUME.nodes_mm(axis), values[name])
                for axis, name in enumerate(NAMES)
            ]
        )
        for number in (1, 2):
            way = np.tile(np.sign(along) * (1 if number == 1 else -1), (len(out), 1))
            read = out @ (along + lean - (lean @ along) * along) + 1e-3 * (
                (error + moved_um(out, way)) @ along
            )
            read = (read + 2e-4 * dice.normal(size=len(out)))[:: 1 if number == 1 else -1]
            at = out[:: 1 if number == 1 else -1]
            rows += [
                (setup, number, stop, *pair)
                for stop, pair in enumerate(zip(at, read - read[0], strict=True))
            ]
    setup, number, stop, place, value = zip(*rows, strict=True)
    return make_readings(
        setup=setup,
        pass_number=number,
        stop=stop,
        position_mm=np.array(place),
        reading_mm=value,
    )


@pytest.mark.parametrize("name", CONTROLS)
def test_right_files_are_kept_and_turned_or_idle_ones_restored(name: str, tmp_path) -> None:
    dice, along = np.random.default_rng(12), np.linspace(0.0, 1.0, 11)
    values = {
        each: sum(4.0 * dice.normal() * np.sin(np.pi * k * along) for k in (1, 2, 3, 4))
        for each in NAMES
    }
    result = made_result({each: list(value) for each, value in values.items()}, volume=VOLUME)
    control, profile = controller_named(name), profile_of(name, VOLUME, sections=10)
    if name == "heidenhain":  # the generation that the virtual control is of
        profile = replace(
            profile, options=msgspec.structs.replace(profile.options, generation="itnc530")
        )
    plan = control.plan(fitted(result, NAMES).curves, profile)
    settled = replace(profile, options=plan.options or profile.options)
    files = [file for file in control.render(plan.tables, settled) if file.role == "data"]
    for file in files:
        (tmp_path / file.name).write_bytes(file.data)
    loaded = load_files(name, [tmp_path / file.name for file in files])

    def moved_um(points, way):
        return 1e3 * sum(table.correction_mm(points, way) for table in loaded)

    before = driven(values, lambda points, _: 0.0 * points, dice)
    acting, replaced = acting_in(result, control, files, settled)
    for factor, action in (
        (1.0, "keep"),
        (-1.0, "restore"),
        (0.0, "restore"),
        (0.5, "restore"),
    ):
        after = driven(
            values, lambda points, way, by=factor: by * moved_um(points, way), dice
        )
        found = prove(result, before, after, acting, replaced)
        assert found.action == action, (factor, found)
        assert all(abs(each.factor - factor) < 5.0 * each.u + 0.05 for each in found.tables)
