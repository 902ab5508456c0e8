"""What each form of compensation reaches on the demo's machine, by files that virtual controls
load: the table of `stepdiag demo`."""

from pathlib import Path

import numpy as np
import pytest

from stepdiag.base.result.result import DISPLACEMENTS, Result
from stepdiag.base.volume import Volume
from stepdiag.demo.demo import Figures, verify
from stepdiag.demo.files import (
    INCREMENTS,
    SIZE_MM,
    U_ANGLE_URAD,
    write_angles,
    write_bench,
    write_profiles,
)
from stepdiag.demo.reach import FORMS, exported
from stepdiag.exporters.export.export import export
from stepdiag.exporters.profiles.file import load_profile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.solver.model.angles import parse_angles
from stepdiag.virtual.bench.building import build_machine
from stepdiag.virtual.bench.config import read_config
from testkit.exact.results import made_result

VOLUME = Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=SIZE_MM, increments=INCREMENTS)


def surveyed(folder: Path, bench: Path) -> Result:
    """Return what a good survey finds: the truth at the stops, and the angles of the demo's
    autocollimator."""
    truth = build_machine(read_config(bench)).truth(INCREMENTS)
    angles = {
        name: known.value_urad
        for name, known in parse_angles(
            (folder / "angles.csv").read_text(encoding="utf-8")
        ).items()
    }
    errors = {name: truth.errors[name] for name in DISPLACEMENTS}
    return made_result(errors, squareness=truth.squareness_urad, angles=angles, volume=VOLUME)


@pytest.fixture(scope="module", params=[1, 2])
def reached(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Figures]:
    folder = tmp_path_factory.mktemp("demo")
    bench = write_bench(folder, request.param)
    write_angles(folder, bench, request.param)
    write_profiles(folder)
    result = surveyed(folder, bench)
    found = {"nothing": verify(bench, None, ())}
    for name in ("siemens", "fanuc"):
        report = export(
            result,
            name,
            load_profile(folder / f"{name}.toml", controller_named(name), VOLUME),
            out_dir=folder / name,
        )
        acting = [
            folder / name / each
            for each in report.files
            if "_RESTORE" not in each and each.endswith((".INI", ".TXT"))
        ]
        found[name] = verify(bench, name, acting)
    return found | {
        form.name: verify(bench, form.control, files)
        for form, files in exported(folder / "reach", result)
    }


def test_each_form_reaches_what_it_can_hold(reached: dict[str, Figures]) -> None:
    """From nothing over pitch tables, straightness lines, nine fitted tables and eight with
    products to the whole field."""
    pitch, straight, few, products, *columns, whole = (
        reached[form.name].rms_um for form in FORMS
    )
    nine, nothing = reached["siemens"].rms_um, reached["nothing"].rms_um
    assert nothing > pitch > straight > nine > products
    assert few < pitch
    assert max(products, *columns) < 1.3 * whole
    assert nine < 0.35 * nothing
    assert whole < 0.18 * nothing


def test_pitch_error_is_the_same_on_every_control(reached: dict[str, Figures]) -> None:
    """Stepped in whole micrometres or linear in tenths: the same three curves."""
    assert reached["fanuc"].rms_um == pytest.approx(reached[FORMS[0].name].rms_um, rel=0.1)


def test_the_autocollimator_of_the_demo_is_as_good_as_it_says(tmp_path: Path) -> None:
    bench = write_bench(tmp_path, 1)
    write_angles(tmp_path, bench, 1)
    truth = build_machine(read_config(bench)).truth(INCREMENTS)
    known = parse_angles((tmp_path / "angles.csv").read_text(encoding="utf-8"))
    off = np.concatenate([one.value_urad - truth.errors[name] for name, one in known.items()])
    assert 0.7 * U_ANGLE_URAD < np.std(off) < 2.0 * U_ANGLE_URAD
