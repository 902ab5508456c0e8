"""Products of CEC tables: written, read back, multiplied by a control that was written from the
manual, chosen within its tables."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stepdiag.base.errors import DataError, SafetyError, UsageError
from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.base.result.result import ROTATIONS, Result
from stepdiag.base.volume import Vector, Volume, grid_points_mm
from stepdiag.exporters.export.export import export
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.sets import read_given
from stepdiag.exporters.profiles.file import parse_profile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.safety.sign_test import Bump, bump, verdict
from stepdiag.exporters.safety.verify import verify_files
from stepdiag.exporters.siemens import products
from stepdiag.exporters.siemens.control import Siemens
from stepdiag.exporters.siemens.products import chosen, taken_by
from stepdiag.exporters.tables.fit import fitted
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import total_correction_um
from stepdiag.virtual.control.siemens import SiemensControl
from testkit.exact.machines import profile_text
from testkit.exact.results import made_result

VOLUME = Volume(origin_mm=(-250.0, 0.0, -300.0), size_mm=(500.0, 400.0, 300.0), increments=10)
SIEMENS = Siemens()
POINTS = grid_points_mm(VOLUME, 7)


def profile(
    more: str = "products = true", direction: str = "mean", extra: str = ""
) -> Profile:
    text = profile_text(
        "siemens",
        steps_mm=(25.0, 25.0, 25.0),
        references_mm=(-250.0, 0.0, -300.0),
        direction=direction,
    )
    text = text.replace(
        "[siemens]", f"[limits]\nslope_um_mm = 1.0\n{extra}\n[siemens]"
    ).replace("cec_points = 60\n", f"cec_points = 60\n{more}\n")
    return parse_profile(text, "siemens.toml", controller_named("siemens"), VOLUME, {})


def drawn(seed: int, angle_urad: float = 10.0) -> Result:
    rng = np.random.default_rng(seed)
    along = np.linspace(0.0, 1.0, 11)
    angles = {
        name: angle_urad * (rng.normal() * along + 0.7 * rng.normal() * np.sin(np.pi * along))
        for name in ROTATIONS
    }
    square = {name: float(rng.normal(0.0, 20.0)) for name in ("C0Y", "B0Z", "A0Z")}
    return made_result(
        {"EXX": 20 * along, "EYX": 5 * np.sin(np.pi * along)},
        squareness=square,
        angles=angles,
        volume=VOLUME,
    )


def left_um(result: Result, moved_um: Vector, points: Vector = POINTS) -> float:
    left = without_rigid_motion(VOLUME, points, error_field_um(result, points) + moved_um)
    return float(np.sqrt(np.mean(np.sum(left**2, axis=1))))


def virtual_um(
    files: tuple[ControlFile, ...], points: Vector = POINTS, *, adds_linked: bool = False
) -> Vector:
    """Return what the control of the manual makes of the files."""
    control = SiemensControl(adds_linked=adds_linked)
    for file in files:
        control.load(file.data.decode("ascii"))
    return (
        sum(
            (
                table.correction_mm(points, np.zeros(points.shape))
                for table in control.tables()
            ),
            np.zeros(points.shape),
        )
        * 1e3
    )


def planned(result: Result, of: Profile) -> tuple[ControlFile, ...]:
    fit = fitted(result)
    return SIEMENS.render(SIEMENS.plan_products(fit.curves, fit.products, of).tables, of)


SPOILT = {
    "values": lambda table: replace(table, value_um=table.value_um + 5.0),
    "direction": lambda table: replace(table, direction=1),
    "beyond the ends": lambda table: replace(table, law=replace(table.law, ends="extended")),
    "lever": lambda table: (
        table.multiplier
        and replace(
            table, multiplier=replace(table.multiplier, value=table.multiplier.value[::-1])
        )
    ),
    "left out": lambda table: None,
    "beside": lambda table: replace(table, place={"table": 90}),
}


@pytest.mark.parametrize("what", [*SPOILT, "nothing"])
def test_files_that_hold_another_table_than_planned_are_not_written(
    tmp_path, monkeypatch, what: str
) -> None:
    """The control reads one table of the written files differently; the machine has no own
    files."""
    read = Siemens.parse

    def misread(control, files, of):
        tables = read(control, files, of)
        found = {table.name: table for table in tables}["EYX*Z"]
        rest = [each for each in tables if each is not found or what == "beside"]
        wrong = SPOILT.get(what, lambda table: table)(found)
        return (*rest, *([] if wrong is None else [wrong]))

    monkeypatch.setattr(Siemens, "parse", misread)
    if what == "nothing":
        export(drawn(3), "siemens", profile(), out_dir=tmp_path / "files")
        return
    with pytest.raises(SafetyError) as refused:
        export(drawn(3), "siemens", profile(), out_dir=tmp_path / "files")
    assert refused.value.code in ("file-unsound.read-back", "control-full.points")
    assert not (tmp_path / "files").exists()


class TestFiles:
    @settings(max_examples=5)
    @given(seed=st.integers(0, 10_000))
    def test_the_control_of_the_manual_holds_the_whole_field(self, seed: int) -> None:
        """21 errors on a control without a volumetric option: what is left is the rounding of the
        tables."""
        result = drawn(seed)
        files = planned(result, profile())
        for ending in (".INI", ".MPF"):
            moved = virtual_um(tuple(file for file in files if file.name.endswith(ending)))
            assert left_um(result, moved) < 0.1
            assert left_um(result, -moved) > 1.5 * left_um(result, 0 * moved)

    @settings(max_examples=5)
    @given(seed=st.integers(0, 10_000))
    def test_what_is_read_moves_as_what_was_planned(self, seed: int) -> None:
        fit, of = fitted(drawn(seed)), profile()
        tables = SIEMENS.plan_products(fit.curves, fit.products, of).tables
        read = SIEMENS.parse(SIEMENS.render(tables, of), of)
        assert sorted(table.name for table in read) == sorted(table.name for table in tables)
        np.testing.assert_allclose(
            total_correction_um(read, POINTS),
            total_correction_um(tables, POINTS),
            rtol=0,
            atol=1e-6,
        )
        np.testing.assert_allclose(
            virtual_um(SIEMENS.render(tables, of)[::2]),
            total_correction_um(read, POINTS),
            rtol=0,
            atol=1e-6,
        )

    def test_no_table_holds_more_than_the_sign_test_may_move(self) -> None:
        """On a control that adds linked tables, the axis moves by tenths of a millimetre, not by
        the 1 mm of a factor."""
        files = planned(drawn(1), profile())
        values = [
            abs(float(value))
            for file in files
            for value in re.findall(r"\$AN_CEC\[\d+,\d+\]=(\S+)", file.data.decode())
        ]
        assert max(values) <= 0.5

    def test_levers_are_shared_by_products_of_one_axis(self) -> None:
        result = drawn(2)
        text = planned(result, profile())[2].data.decode()
        assert taken_by(fitted(result).products) < 2 * len(fitted(result).products)
        assert len(set(re.findall(r"\$AN_CEC_STEP\[(\d+)\]", text))) == 6 + taken_by(
            fitted(result).products
        )

    @pytest.mark.parametrize(
        ("number", "found"),
        [("9", "MULT_BY_TABLE 9"), ("1", "MULT_BY_TABLE 1"), ("-1", "-1"), ("1.5", "1.5")],
    )
    def test_a_link_that_leads_nowhere_is_refused(self, number: str, found: str) -> None:
        """To no table, to itself, to no number."""
        data = planned(
            made_result({"EYX": [0, 1, 2, 1, 0, 0, 0, 0, 0, 0, 0]}, volume=VOLUME), profile()
        )[2].data
        broken = data.replace(
            b"$AN_CEC_MULT_BY_TABLE[0]=0", f"$AN_CEC_MULT_BY_TABLE[0]={number}".encode()
        )
        with pytest.raises(DataError, match=found):
            SIEMENS.parse([ControlFile(name="NC_CEC.INI", data=broken)], profile())


class TestExport:
    def test_restoring_takes_the_products_out_again(self, tmp_path) -> None:
        """Exported, loaded, restored: the control moves nothing any more."""
        report = export(drawn(3), "siemens", profile(), out_dir=tmp_path)
        names = [name for name in report.files if name.endswith((".INI", ".MPF"))]
        loaded, restored = (
            [
                file
                for file in read_given([tmp_path / name for name in names])
                if ("RESTORE" in file.name) is back
            ]
            for back in (False, True)
        )
        assert left_um(drawn(3), virtual_um(tuple(loaded))) < 0.1
        assert np.max(np.abs(virtual_um((*loaded, *restored)))) < 1e-9
        assert "EXX*" in report.text or "EYX*" in report.text or "EZX*" in report.text

    def test_verify_reads_them_and_sees_the_same(self, tmp_path) -> None:
        export(drawn(4), "siemens", profile(), out_dir=tmp_path)
        files = [
            file
            for file in read_given(sorted(tmp_path.glob("*.INI")))
            if "RESTORE" not in file.name
        ]
        before, after = verify_files(drawn(4), files, profile()).prediction.figures(
            rigid_motion=False
        )
        assert after.rms_um < 0.02 * before.rms_um

    def test_without_asking_they_are_offered_and_not_written(self, tmp_path) -> None:
        report = export(drawn(5), "siemens", profile(""), out_dir=tmp_path)
        assert "products-possible" in {finding.key for finding in report.findings}
        assert {table.kind for table in report.tables} == {"eec", "cec"}

    def test_without_angles_there_is_nothing_to_multiply(self, tmp_path) -> None:
        result = made_result({"EXX": np.linspace(0, 20, 11)}, volume=VOLUME)
        report = export(result, "siemens", profile(), out_dir=tmp_path)
        assert {table.kind for table in report.tables} == {"eec", "cec"}

    def test_their_sign_is_tested_apart_from_that_of_plain_tables(self, tmp_path) -> None:
        about = (
            'machine = "mill"\ncontrol = "siemens"\nmeasuring_system = "1"\nbump_sha256 = '
            '["b"]\nruns_sha256 = ["a"]'
        )
        tested = "\n".join(
            f'[[sign_test]]\nkind = "{kind}"\ndate = 2026-11-20\nverdict = "as-error"\n{about}'
            for kind in ("eec", "cec")
        )
        from datetime import date

        report = export(
            drawn(6),
            "siemens",
            profile(extra=tested),
            out_dir=tmp_path,
            today=date(2026, 11, 22),
        )
        assert any("UNTESTED" in name for name in report.files)
        assert "cec-product" in next(
            finding.text for finding in report.findings if finding.key == "sign-untested"
        )

    def test_a_second_survey_with_products_on_gives_the_same_tables(self, tmp_path) -> None:
        """Nothing left over, measured with the products active: the new export holds them again, to
        the rounding."""
        first = planned(drawn(7), profile())
        active = [
            table
            for table in SIEMENS.parse(first[:3:2], profile())
            if table.multiplier is not None
        ]
        again = fitted(made_result(volume=VOLUME), active=active)
        ours = {product.name: product for product in fitted(drawn(7)).products}
        for product in again.products:
            at = ours[product.name].position_mm
            spread = (
                np.interp(at, product.position_mm, product.value_um)
                - ours[product.name].value_um
            )
            assert np.max(np.abs(spread)) < 0.05


class TestBudget:
    def curves_and_products(self, seed: int = 11):
        fit = fitted(drawn(seed))
        return (
            fit.curves,
            {curve.name: 0 if curve.name[1] == curve.name[2] else 1 for curve in fit.curves},
            fit.products,
        )

    def test_an_828d_gets_what_is_worth_most(self) -> None:
        """Eight tables: the two best products go in where they are worth more than the straightness
        that makes room for them."""
        curves, tables_of, given = self.curves_and_products()
        budget = chosen(curves, tables_of, given, 8)
        assert len(budget.curves) + taken_by(budget.products) <= 8
        every = {name for name, count in tables_of.items() if count}
        assert set(budget.left_out) == (every - set(budget.curves)) | {
            p.name for p in given if p not in budget.products
        }

    @settings(max_examples=30, deadline=None)
    @given(seed=st.integers(0, 1000), tables=st.integers(1, 20))
    def test_more_tables_never_leave_more(self, seed: int, tables: int) -> None:
        curves, tables_of, given = self.curves_and_products(seed)
        worth = {c.name: products._rms_um(c) ** 2 for c in curves if tables_of[c.name]} | {
            p.name: p.rms_um**2 for p in given
        }
        fewer, more = (
            sum(worth[name] for name in chosen(curves, tables_of, given, count).left_out)
            for count in (tables, tables + 1)
        )
        assert more <= fewer + 1e-9

    def test_a_small_product_does_not_cost_a_large_straightness(self) -> None:
        result = drawn(12, angle_urad=0.01)
        fit = fitted(result)
        budget = chosen(
            fit.curves,
            {c.name: 0 if c.name[1] == c.name[2] else 1 for c in fit.curves},
            fit.products,
            6,
        )
        assert "EYX" in budget.curves

    def test_fewer_tables_than_the_curves_take_refuse_the_export(self, tmp_path) -> None:
        with pytest.raises(SafetyError) as refused:
            export(drawn(13), "siemens", profile("cec_tables_held = 4"), out_dir=tmp_path)
        assert refused.value.code == "control-full.tables"

    def test_what_is_left_out_is_said(self, tmp_path) -> None:
        report = export(
            drawn(13),
            "siemens",
            profile("products = true\ncec_tables_held = 8"),
            out_dir=tmp_path,
        )
        assert "function-left-out.tables" in {finding.key for finding in report.findings}
        placed = {
            int(table.place["table"]) for table in report.tables if "table" in table.place
        }
        assert (
            max(
                placed
                | {
                    int(table.place["times table"])
                    for table in report.tables
                    if "times table" in table.place
                }
            )
            < 8
        )


class TestSignTest:
    def driven(
        self, test: Bump, *, adds_linked: bool = False, sense: float = 1.0
    ) -> tuple[Vector, Vector, Vector]:
        """Return a run along the input axis with the table off and on, the other axis where the
        test wants it."""
        at = np.linspace(-250.0, 250.0, 41)
        points = np.zeros((41, 3))
        points[:, 0] = at
        assert test.lever is not None
        points[:, "XYZ".index(test.lever[0])] = test.lever[1]
        moved = virtual_um(
            tuple(file for file in test.files if file.name.endswith(".INI")),
            points,
            adds_linked=adds_linked,
        )
        return at, np.zeros(41), sense * moved[:, "XYZ".index(test.function[1])]

    def test_a_product_that_acts_as_the_manual_says_passes(self) -> None:
        test = bump(SIEMENS, profile(), "EYX*Z")
        found = verdict(test, *self.driven(test))
        assert (found.kind, found.sense) == ("cec-product", "as-error")

    def test_the_opposite_sense_is_seen(self) -> None:
        test = bump(SIEMENS, profile(), "EZX*Y")
        assert verdict(test, *self.driven(test, sense=-1.0)).sense == "as-compensation"

    def test_a_control_that_adds_linked_tables_is_found_out_without_harm(self) -> None:
        """The other reading of the manual: the axis moves by a tenth of a millimetre, and the
        verdict is that products of tables cannot be used."""
        test = bump(SIEMENS, profile(), "EYX*Z")
        run = self.driven(test, adds_linked=True)
        assert np.max(np.abs(run[2])) < 300.0
        found = verdict(test, *run)
        assert found.sense is None
        assert "products of tables cannot be used" in found.text

    @pytest.mark.parametrize("function", ["EYX*X", "EYX*Q", "EYX*", "EYX**Z", "QQQ*Z"])
    def test_a_product_that_is_none_is_refused(self, function: str) -> None:
        with pytest.raises(UsageError, match="function"):
            bump(SIEMENS, profile(), function)

    def test_a_profile_without_products_is_told_so(self) -> None:
        with pytest.raises(UsageError, match="products = true"):
            bump(SIEMENS, profile(""), "EYX*Z")

    def test_restoring_ends_it(self) -> None:
        test = bump(SIEMENS, profile(), "EYX*Z")
        assert np.max(np.abs(virtual_um((*test.files, *test.restore)))) < 1e-9
