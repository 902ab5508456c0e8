"""What each form of table reaches on exact machines: surveyed with noise and leaning mirrors,
solved with angles that are known to 1 urad.

The goals are those of the issue that asks for the fit: 1.6, 1.6 and 1.4 µm rms for nine tables;
with products as much as the whole field on the same points, about 1.0 um.
"""

from dataclasses import dataclass, replace
from functools import cache

import msgspec
import numpy as np
import pytest

from stepdiag.base.result.field import without_rigid_motion
from stepdiag.base.result.result import Result
from stepdiag.base.volume import Vector, Volume, grid_points_mm
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.tables import lattice
from stepdiag.exporters.tables.curves import curves_of
from stepdiag.exporters.tables.fit import Fitted, fitted
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import mean_correction_um
from stepdiag.solver.methods.solve import solve
from stepdiag.virtual.control.beckhoff import load_volumetric
from stepdiag.virtual.control.heidenhain import load_tables
from stepdiag.virtual.control.siemens import SiemensControl
from testkit.exact.machines import profile_of
from testkit.exact.surveys import IDEAL, Bench

GOALS_UM = {0: 1.6, 1: 1.6, 3: 1.4}
"""By the seed of the machine, rms over the volume without rigid motion."""
WITH_LEVERS_UM = {0: 1.10, 1: 1.09, 3: 1.07}
"""What the whole field of the result leaves there is 1.08, 1.08 and 1.04 um."""
SECTIONS = 20


@dataclass(frozen=True)
class Case:
    """One machine and what a survey found of it."""

    result: Result
    fit: Fitted
    volume: Volume
    points_mm: Vector
    true_um: Vector

    def left_um(self, moved_um: Vector) -> float:
        left = without_rigid_motion(self.volume, self.points_mm, self.true_um + moved_um)
        return float(np.sqrt(np.mean(np.sum(left**2, axis=1))))

    def profile(self, name: str, **options: object) -> Profile:
        made = profile_of(name, self.volume, sections=SECTIONS)
        return replace(made, options=msgspec.structs.replace(made.options, **options))

    def files(self, name: str, **options: object) -> tuple[ControlFile, ...]:
        control, of = controller_named(name), self.profile(name, **options)
        fitted_into = getattr(control, "plan_products", None)
        plan = (
            fitted_into(self.fit.curves, self.fit.products, of)
            if fitted_into
            else control.plan(self.fit.curves, of)
        )
        return control.render(plan.tables, replace(of, options=plan.options or of.options))


@cache
def surveyed(seed: int) -> Case:
    bench = Bench(seed=seed, angle_urad=10.0)
    volume = Volume(
        origin_mm=bench.origin_mm, size_mm=bench.size_mm, increments=bench.increments
    )
    points = grid_points_mm(volume, 9)
    result = solve(bench.survey(), angles=bench.angles(1.0), assumed=IDEAL)
    return Case(result, fitted(result), volume, points, bench.machine.error_at(points))


def virtual_um(name: str, files: tuple[ControlFile, ...], points_mm: Vector) -> Vector:
    """What the control of the manual makes of the files."""
    texts = {file.name: file.data.decode("ascii") for file in files}
    still = np.zeros(points_mm.shape)
    if name == "siemens":
        control = SiemensControl()
        for text in texts.values():
            control.load(text)
        return 1e3 * sum(
            (table.correction_mm(points_mm, still) for table in control.tables()), still
        )
    if name == "beckhoff":
        return 1e3 * load_volumetric(texts["volumetric_errors.csv"]).correction_mm(
            points_mm, still
        )
    tables = {file[5:8]: text for file, text in texts.items() if file.endswith(".COM")}
    names = {"AX1": "X", "AX2": "Y", "AX3": "Z"}
    return 1e3 * load_tables(
        tables, texts.get("kinematics_comp_lines.txt", ""), axis_names=names
    ).correction_mm(points_mm, still)


@pytest.mark.parametrize("seed", GOALS_UM)
class TestReached:
    @pytest.mark.parametrize(
        ("name", "options"),
        [("siemens", {}), ("beckhoff", {}), ("heidenhain", {"generation": "itnc530"})],
    )
    def test_nine_tables_reach_the_goal_on_the_control_of_the_manual(
        self, seed, name, options
    ):
        case = surveyed(seed)
        moved = virtual_um(name, case.files(name, **options), case.points_mm)
        corner = (
            controller_named("siemens")
            .plan(curves_of(case.result), case.profile("siemens"))
            .tables
        )
        assert case.left_um(moved) < GOALS_UM[seed]
        assert case.left_um(moved) < 0.9 * case.left_um(
            mean_correction_um(corner, case.points_mm)
        )

    @pytest.mark.parametrize("name", ["mitsubishi", "neutral"])
    def test_and_by_the_stated_law_of_the_others(self, seed, name):
        case, control = surveyed(seed), controller_named(name)
        read = control.parse(
            [file for file in case.files(name) if file.role == "data"], case.profile(name)
        )
        assert case.left_um(mean_correction_um(read, case.points_mm)) < GOALS_UM[seed]

    @pytest.mark.parametrize(
        ("name", "options"),
        [
            ("siemens", {"products": True}),
            ("beckhoff", {"chain": "FXYZ"}),
            ("heidenhain", {"generation": "itnc530", "chain": "FXYZ"}),
        ],
    )
    def test_levers_are_worth_a_lattice(self, seed, name, options):
        case = surveyed(seed)
        moved = virtual_um(name, case.files(name, **options), case.points_mm)
        of = case.profile(name, **options)
        whole = lattice.lattice_on(
            case.result, (of.grid_mm("X"), of.grid_mm("Y"), of.grid_mm("Z"))
        ).correction_um(case.points_mm)
        assert case.left_um(moved) < WITH_LEVERS_UM[seed]
        assert case.left_um(moved) < 1.02 * case.left_um(whole)
