"""Prediction from bytes: independent readers agree, wrong files are refused, a wrong sense makes
the machine worse."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stepdiag.base.errors import DataError, SafetyError, UsageError
from stepdiag.base.volume import grid_points_mm
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.safety.verify import controller_of, predict, verify_files
from stepdiag.exporters.tables import lattice
from stepdiag.exporters.tables.curves import curves_of
from stepdiag.exporters.tables.tables import total_correction_um
from stepdiag.virtual.control.fanuc import load_fanuc
from stepdiag.virtual.control.siemens import load_siemens
from testkit.exact.machines import new_punch_file, profile_of
from testkit.exact.results import VOLUME, made_result

ERRORS = {"EXX": [0, 3, 8, 12, 20], "EYX": [0, 1.5, 2, 1, 0], "EXZ": [0, -2, 1, 2, 0]}
RESULT = made_result(ERRORS, squareness={"C0Y": 20.0, "B0Z": 8.0, "A0Z": -15.0})


def siemens_files() -> tuple[ControlFile, ...]:
    control, profile = controller_named("siemens"), profile_of("siemens", VOLUME)
    return control.render(control.plan(curves_of(RESULT), profile).tables, profile)


class TestPrediction:
    def test_falls_to_the_rounding_where_tables_can_do_all(self):
        prediction = verify_files(RESULT, siemens_files()).prediction
        before, after = prediction.figures(rigid_motion=True)
        assert before.largest_um > 15
        assert after.largest_um < 0.25
        assert not prediction.worse
        assert 0 < prediction.predicted.as_it_is["after"].largest_um.value_um < 0.25, (
            "between the points of the grid too"
        )

    def test_a_file_with_the_wrong_sense_makes_it_worse(self):
        """The sign test of the program itself: negated values must not pass as an improvement."""
        data = siemens_files()[0].data.replace(b"]=0.0", b"]=-0.0")
        prediction = verify_files(
            RESULT, [ControlFile(name="AX_EEC.INI", data=data)]
        ).prediction
        before, after = prediction.figures(rigid_motion=True)
        assert after.largest_um > 1.5 * before.largest_um
        assert prediction.worse

    def test_a_stretch_in_which_the_files_harm_is_named_though_they_help_on_the_whole(self):
        made = made_result({"EXX": [0, 14, -12, 16, 0.5]}, volume=VOLUME)
        control, profile = controller_named("siemens"), profile_of("siemens", VOLUME)
        spoiled = made_result({"EXX": [0, 14, -12, 16, 24]}, volume=VOLUME)
        files = control.render(control.plan(curves_of(spoiled), profile).tables, profile)
        found = verify_files(made, files)
        assert not found.prediction.clearly_worse
        (one,) = [each for each in found.findings if each.key == "stretch-worse"]
        axis, low, _, high = one.text.split()[:4]
        end = VOLUME.origin_mm[0] + VOLUME.size_mm[0]
        assert (axis, float(high)) == ("X", end)
        assert float(low) == end - VOLUME.step_mm[0]
        clean = verify_files(
            made, control.render(control.plan(curves_of(made), profile).tables, profile)
        )
        assert not [each for each in clean.findings if each.key == "stretch-worse"]

    def test_files_that_do_worse_than_the_tables_that_stand_in_the_control_are_named(self):
        """They were off while measuring, and everything is better than nothing: what counts is what
        the owner has."""
        control, profile = controller_named("siemens"), profile_of("siemens", VOLUME)
        whole, half = (
            control.render(
                control.plan(
                    curves_of(
                        made_result({"EXX": [share * at for at in (0, 6, 16, 24, 40)]})
                    ),
                    profile,
                ).tables,
                profile,
            )
            for share in (1.0, 0.5)
        )
        result = made_result({"EXX": [0, 6, 16, 24, 40]})
        worse, better = (
            [
                each.text
                for each in verify_files(
                    result, new[:1], replace(profile, existing=old[:1])
                ).findings
                if each.key == "worse-after"
            ]
            for new, old in ((half, whole), (whole, half))
        )
        assert len(worse) == 1
        assert "The rms error with the present tables of the control is" in worse[0]
        assert better == []

    def test_waves_that_no_target_shows_are_said_of_their_tables(self):
        fine = replace(VOLUME, increments=10)
        wave = 8.0 * np.sin(2.0 * np.pi * 4.5 * np.arange(11) / 10 + 0.7)
        made = made_result({"EXX": (wave - wave[0]).tolist()}, volume=fine)
        control, profile = controller_named("siemens"), profile_of("siemens", fine)
        found = verify_files(
            made, control.render(control.plan(curves_of(made), profile).tables, profile)
        )
        assert [
            each.text.partition(":")[0]
            for each in found.findings
            if each.key == "increments-coarse.verify"
        ] == ["EXX"]
        assert not [
            each
            for each in verify_files(RESULT, siemens_files()).findings
            if each.key == "increments-coarse.verify"
        ]

    def test_without_rigid_motion_a_squareness_folded_the_other_way_is_no_error(self):
        control, profile = controller_named("siemens"), profile_of("siemens", VOLUME)
        curves = curves_of(RESULT, fold={"C0Y": "EYX", "B0Z": "EZX", "A0Z": "EZY"})
        prediction = predict(RESULT, control.plan(curves, profile).tables)
        assert prediction.figures(rigid_motion=True)[1].largest_um > 3
        assert prediction.figures(rigid_motion=False)[1].largest_um < 0.3

    def test_what_is_refused_is_judged_where_it_is_promised(self):
        """A grid lies on the nodes of the survey, where coarse steps of a control hit the curve:
        between them they are off."""
        made = made_result({"EXX": [0.0, 4.0, 0.0, 4.0, 0.0]}, volume=VOLUME)
        prediction = predict(made, ())
        told = prediction.predicted.without_rigid_motion["before"].rms_um.value_um
        assert prediction.figures(rigid_motion=False)[0].rms_um == pytest.approx(
            told, rel=1e-9
        )

    def test_picture_holds_plain_lists_of_the_grid(self):
        picture = predict(RESULT, (), nodes=3).picture()
        assert [len(picture[key]) for key in ("points_mm", "before_um", "after_um")] == [
            27,
            27,
            27,
        ]
        assert picture["before_um"] == picture["after_um"]


class TestIndependentReader:
    @pytest.mark.parametrize("suffix", ["INI", "MPF"])
    @pytest.mark.parametrize("mode", ["mean", "both"])
    @pytest.mark.parametrize("travel", [1, -1])
    def test_the_virtual_control_moves_as_predicted(self, suffix, mode, travel):
        """A reader that shares no code with ours, from the same manual, does the same with data
        files and programs."""
        control, profile = (
            controller_named("siemens"),
            profile_of("siemens", VOLUME, direction=mode),
        )
        result = replace(
            RESULT, reversal=made_result(reversal={"EXX": [0, 2, 3, 3, 4]}).reversal
        )
        files = control.render(control.plan(curves_of(result), profile).tables, profile)
        points = grid_points_mm(VOLUME, 5)
        texts = [file.data.decode("ascii") for file in files if file.name.endswith(suffix)]
        theirs = sum(
            table.correction_mm(points, np.full(points.shape, travel))
            for text in texts
            for table in load_siemens(text)
        )
        ours = total_correction_um(control.parse(files, profile), points, travel)
        np.testing.assert_allclose(theirs * 1000, ours, atol=1e-6)

    def test_the_virtual_fanuc_moves_as_predicted(self):
        """Stepped, incremental, with magnification: the same from the punch file (reference at the
        machine zero, as it reads it)."""
        volume = replace(VOLUME, origin_mm=(-200.0, -200.0, -100.0))
        result = made_result(
            {"EXX": [0, 3, 8, 12, 20], "EYY": [0, -30, -50, -70, -90]}, volume=volume
        )
        profile = profile_of("fanuc", volume, reference_at=2)
        control = controller_named("fanuc")
        plan = control.plan(curves_of(result, ["EXX", "EYY", "EZZ"]), profile)
        settled = replace(profile, options=plan.options)
        files = control.render(plan.tables, settled)
        points = grid_points_mm(volume, 9)
        theirs = sum(
            table.correction_mm(points, np.ones(points.shape))
            for table in load_fanuc([files[0].data.decode("ascii")])
        )
        ours = total_correction_um(control.parse(files, settled), points)
        np.testing.assert_allclose(theirs * 1000, ours, atol=1e-6)


class TestForeignFiles:
    @pytest.mark.parametrize(
        "data", [b"", b"hello", b"\xff\xfe\x00", b"%\nO0001\nG0 X0\nM30\n%\n"]
    )
    def test_an_unknown_file_is_refused_by_name(self, data):
        with pytest.raises(DataError, match=r"strange\.txt"):
            verify_files(RESULT, [ControlFile(name="strange.txt", data=data)])

    def test_files_of_two_controllers_are_refused(self):
        other, profile = controller_named("neutral"), profile_of("neutral", VOLUME)
        foreign = other.render(other.plan(curves_of(RESULT), profile).tables, profile)
        with pytest.raises(DataError, match="files of one controller"):
            controller_of([*siemens_files(), *foreign])

    def test_a_punch_file_without_a_profile_is_refused(self):
        """It does not say where point 3620 lies: a prediction would be a guess."""
        with pytest.raises(UsageError, match="reference point"):
            verify_files(RESULT, [ControlFile(name="PITCH.TXT", data=new_punch_file(20))])

    def test_no_file_is_refused(self):
        with pytest.raises(DataError):
            verify_files(RESULT, [])


class TestLattice:
    def test_reads_back_what_it_wrote(self):
        made = lattice.lattice_of(RESULT, 100.0)
        read = lattice.parse(lattice.render(made))
        np.testing.assert_allclose(read.vectors_um, made.vectors_um, atol=5e-4)

    @settings(max_examples=30)
    @given(st.floats(-200, 200), st.floats(0, 400), st.floats(-100, 100))
    def test_trilinear_between_the_vertices(self, x, y, z):
        """A field that is linear in every coordinate, products included, is met exactly (A-79351E
        p. 3)."""
        axes = (
            np.array([-200.0, 50.0, 200.0]),
            np.array([0.0, 400.0]),
            np.array([-100.0, 0.0, 100.0]),
        )
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        vectors = (grid[..., 0] * grid[..., 1] + 3 * grid[..., 2] - 5)[..., None] * np.array(
            [1.0, -1.0, 0.5]
        )
        value = lattice.Lattice(axes_mm=axes, vectors_um=vectors).correction_um(
            np.array([[x, y, z]])
        )
        np.testing.assert_allclose(
            value[0], (x * y + 3 * z - 5) * np.array([1.0, -1.0, 0.5]), atol=1e-6
        )

    def test_a_lattice_with_a_hole_is_refused(self):
        file = lattice.render(lattice.lattice_of(RESULT, 100.0))
        lines = file.data.split(b"\n")
        with pytest.raises(DataError, match="complete lattice"):
            lattice.parse(replace(file, data=b"\n".join(lines[:7] + lines[8:])))

    def test_a_step_that_does_not_fit_is_refused(self):
        with pytest.raises(SafetyError, match="divides"):
            lattice.lattice_of(RESULT, 30.0)
