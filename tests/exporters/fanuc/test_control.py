"""FANUC: increments and their law, both generations of punch files, magnification, straightness."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stepdiag.base.errors import DataError, SafetyError
from stepdiag.exporters.export.export import export
from stepdiag.exporters.fanuc.control import Fanuc
from stepdiag.exporters.fanuc.options import AxisPoints, FanucOptions, StraightnessNumbers
from stepdiag.exporters.fanuc.parameters import stored_in
from stepdiag.exporters.fanuc.pitch import KIND, LAW
from stepdiag.exporters.fanuc.punch import read_punch
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.tables.curves import Curve, curves_of
from stepdiag.exporters.tables.merge import merged
from stepdiag.exporters.tables.profile import AxisSection, Profile
from stepdiag.exporters.tables.tables import Table, correction_um
from testkit.exact.machines import EOB, FANUC, new_punch_file, profile_of
from testkit.exact.results import VOLUME, made_result

CONTROL = Fanuc()
EXAMPLE = [4, 1, 0, -2, -5]


def fanuc_profile(
    files: tuple[ControlFile, ...] = (), reference_mm: float = 0.0, **options: object
) -> Profile:
    """X from -200 to 200 mm in steps of 100, point 40 at the reference, limit 7."""
    profile = profile_of("fanuc", VOLUME)
    axes = {
        letter: AxisPoints(number=n, reference_point=40 * n)
        for n, letter in enumerate("XYZ", start=1)
    }
    x_axis = AxisSection(
        name="X", step_mm=100.0, reference_mm=reference_mm, start_mm=-200.0, end_mm=200.0
    )
    given_options = {"detection_unit_um": 1.0, "axes": axes, **options}
    return replace(
        profile,
        axes={**profile.axes, "X": x_axis},
        options=FanucOptions(**given_options),
        existing=files,
    )


def punch(*lines: str) -> ControlFile:
    return ControlFile(
        name="PITCH.TXT", data=EOB.join(line.encode() for line in ("%", *lines, "%")) + EOB
    )


def written(profile: Profile, exx: list[float]) -> dict[str, bytes]:
    plan = CONTROL.plan(curves_of(made_result({"EXX": exx}), ["EXX"]), profile)
    settled = replace(profile, options=plan.options)
    return {file.name: file.data for file in CONTROL.render(plan.tables, settled)}


class TestIncrements:
    def test_printed_example_accumulates_to_the_printed_curve(self):
        """B-63980EN/01 p. 100: increments of points 33 to 49 give the absolute curve of points 32
        to 49 (controllers.md 14)."""
        increments = [0, 2, 1, 1, -2, 0, -1, 0, -1, 2, 1, 0, -1, -1, -2, 0, 1, 2]
        table = Table(
            kind=KIND,
            input_axis="X",
            output_axis="X",
            position_mm=np.arange(32.0, 50.0),
            value_um=np.array(increments, dtype=float),
            quantum_um=1.0,
            law=LAW,
            reference_mm=32.0,
        )
        assert table.absolute_um.tolist() == [
            0,
            2,
            3,
            4,
            2,
            2,
            1,
            1,
            0,
            2,
            3,
            3,
            2,
            1,
            -1,
            -1,
            0,
            2,
        ]

    def test_worked_example_in_the_old_form_byte_for_byte(self):
        """controllers.md 12.1: points 39 to 42 hold +3 +1 +2 +3; every other byte is the
        machine's."""
        master = punch(
            "N10038 P 0",
            "N10039 P 0",
            "N10040 P -1",
            "N10041 P 0",
            "N10042 P 0",
            "N10043 P 5",
        )
        files = written(fanuc_profile((master,)), EXAMPLE)
        expected = punch(
            "N10038 P 0", "N10039 P 3", "N10040 P 1", "N10041 P 2", "N10042 P 3", "N10043 P 5"
        )
        assert files["PITCH.TXT"] == expected.data

    def test_applied_as_the_control_does_it(self):
        """controllers.md 12.1, check: +2 at 100, +5 at 200, -1 at -100, -4 at -200."""
        plan = CONTROL.plan(
            curves_of(made_result({"EXX": EXAMPLE}), ["EXX"]), fanuc_profile()
        )
        assert correction_um(
            plan.tables[0], np.array([-200.0, -100, 0, 100, 200])
        ).tolist() == [
            -4,
            -1,
            0,
            2,
            5,
        ]

    def test_between_the_points_the_value_is_that_of_the_last_point_passed(self):
        """B-63980EN/01 p. 100: output at the position, not interpolated."""
        plan = CONTROL.plan(
            curves_of(made_result({"EXX": EXAMPLE}), ["EXX"]), fanuc_profile()
        )
        assert correction_um(
            plan.tables[0], np.array([99.9, 100.0, 199.9, -0.1])
        ).tolist() == [
            0,
            2,
            2,
            -1,
        ]

    def test_smallest_magnification_that_keeps_the_limit(self):
        """controllers.md 12.1: A = -30 -13 0 +9 +20 µm, limit 7: magnification 3 with data 6 4 3
        4."""
        plan = CONTROL.plan(
            curves_of(made_result({"EXX": [30, 13, 0, -9, -20]}), ["EXX"]), fanuc_profile()
        )
        assert plan.tables[0].quantum_um == 3.0
        assert (plan.tables[0].value_um / 3).tolist() == [0, 6, 4, 3, 4]

    def test_the_largest_magnification_is_tried_and_no_larger_one(self):
        """Magnification is 1 to 100 (parameter 3623): 749 µm in one interval are 7 units of 100 µm,
        751 µm are 8, beyond the limit of 7."""
        plan = CONTROL.plan(
            curves_of(made_result({"EXX": [0, 0, 0, -749, -749]}), ["EXX"]), fanuc_profile()
        )
        assert plan.tables[0].quantum_um == 100.0
        with pytest.raises(SafetyError, match="found 8 at magnification 100"):
            CONTROL.plan(
                curves_of(made_result({"EXX": [0, 0, 0, -751, -751]}), ["EXX"]),
                fanuc_profile(),
            )

    def test_a_slope_that_no_magnification_holds_is_refused(self):
        profile = fanuc_profile()
        axes = {
            **profile.options.axes,
            "X": AxisPoints(number=1, reference_point=40, magnification=1),
        }
        with pytest.raises(SafetyError) as refusal:
            CONTROL.plan(
                curves_of(made_result({"EXX": [30, 13, 0, -9, -20]}), ["EXX"]),
                fanuc_profile(axes=axes),
            )
        assert refusal.value.code == "field-too-narrow.step"

    @settings(max_examples=40)
    @given(st.lists(st.floats(-6, 6), min_size=60, max_size=60))
    def test_rounding_does_not_accumulate(self, slopes):
        """Quantised once on the absolute curve: half a unit at every one of 60 points, the far end
        included."""
        volume = replace(VOLUME, increments=60)
        profile = fanuc_profile()
        x_axis = AxisSection(
            name="X", step_mm=400 / 60, reference_mm=-200.0, start_mm=-200.0, end_mm=200.0
        )
        profile = replace(profile, axes={**profile.axes, "X": x_axis})
        curve = curves_of(
            made_result({"EXX": [0.0, *np.cumsum(slopes)]}, volume=volume), ["EXX"]
        )
        (table,) = CONTROL.plan(curve, profile).tables
        left = curve[0].forward_um + correction_um(table, profile.grid_mm("X"))
        assert np.max(np.abs(left)) <= table.quantum_um / 2 + 1e-6

    def test_a_reference_between_two_points_is_refused(self):
        with pytest.raises(SafetyError) as refusal:
            CONTROL.plan(curves_of(made_result(), ["EXX"]), fanuc_profile(reference_mm=30.0))
        assert refusal.value.code == "reference-unfit.between"


class TestPunchFiles:
    def test_new_generation_keeps_every_byte_but_the_digits(self):
        """Only what stands behind P changes: line ends, prefixes and foreign parameters stay."""
        master = ControlFile(name="ALL.TXT", data=new_punch_file(60))
        new = written(fanuc_profile((master,)), EXAMPLE)["ALL.TXT"]
        changed = [
            (a, b)
            for a, b in zip(master.data.split(EOB), new.split(EOB), strict=True)
            if a != b
        ]
        assert changed == [
            (b"N03620Q1A1P0A2P0A3P0", b"N03620Q1A1P40A2P0A3P0"),
            (b"N03621Q1A1P0A2P0A3P0", b"N03621Q1A1P39A2P0A3P0"),
            (b"N03622Q1A1P0A2P0A3P0", b"N03622Q1A1P42A2P0A3P0"),
            (b"N03624Q1A1P0.0A2P0.0A3P0.0", b"N03624Q1A1P100.0A2P0.0A3P0.0"),
            (b"N10039Q0P0", b"N10039Q0P3"),
            (b"N10040Q0P0", b"N10040Q0P1"),
            (b"N10041Q0P0", b"N10041Q0P2"),
            (b"N10042Q0P0", b"N10042Q0P3"),
        ]

    def test_old_generation_writes_the_interval_in_least_units(self):
        """controllers.md 2.6: old controls take integers in least input units, never a decimal
        point: 1000 times is at stake."""
        master = punch("N03624 A1 P 0 A2 P 0", *(f"N{10000 + n} P 0" for n in range(39, 43)))
        assert (
            b"N03624 A1 P 100000 A2 P 0"
            in written(fanuc_profile((master,)), EXAMPLE)["PITCH.TXT"]
        )

    def test_a_line_with_q1_is_a_parameter_and_never_pitch_data(self):
        """controllers.md 2.6, flag: parameters 10000 to 27603 exist and carry Q1."""
        assert not read_punch(punch("N10039Q1P7")).pitch

    def test_without_a_master_the_file_is_refused(self):
        with pytest.raises(SafetyError) as refusal:
            written(fanuc_profile(), EXAMPLE)
        assert refusal.value.code == "template-missing"

    def test_a_master_without_the_points_is_refused(self):
        with pytest.raises(SafetyError) as refusal:
            written(fanuc_profile((punch("N10001Q0P0"),)), EXAMPLE)
        assert refusal.value.code == "template-missing.points"

    @pytest.mark.parametrize(
        ("data", "found"),
        [
            (b"%\nN10001P0\n%\n", "other line ends"),
            (b"%\r\nN10001P0\r\n%\r\n", "other line ends"),
            (EOB.join([b"%", b"N10001P0", b"%", b"N10002P0", b"%"]) + EOB, "% in 3 lines"),
            (EOB.join([b"%", b"N10001P0"]) + EOB, "% in 1 lines"),
            (EOB.join([b"%", b"N10001P0;", b"%"]) + EOB, "line 2"),
            (EOB.join([b"%", b"N10001P+1", b"%"]) + EOB, "line 2"),
            (EOB.join([b"%", b"n10001p1", b"%"]) + EOB, "line 2"),
        ],
    )
    def test_bytes_that_the_control_would_not_read_are_refused(self, data, found):
        """controllers.md 2.6: 31 dumps: LF CR CR, % first and last only, no ';', '+', lower
        case."""
        with pytest.raises(DataError, match=found):
            read_punch(ControlFile(name="PITCH.TXT", data=data))

    def test_ranges_of_two_axes_that_overlap_are_an_error(self):
        axes = {
            letter: AxisPoints(number=n, reference_point=40)
            for n, letter in enumerate("XYZ", start=1)
        }
        plan = CONTROL.plan(
            curves_of(made_result(), ["EXX", "EYY"]), fanuc_profile(axes=axes)
        )
        (found,) = plan.findings
        assert (found.key, found.severity) == ("points-overlap", "error")
        both = [set(numbers) for numbers in map(stored_in, plan.tables)]
        shared = both[0] & both[1]
        assert (
            f"both use pitch points {min(shared)} to {max(shared)}: give each axis"
            in found.text
        )
        assert min(shared) < max(shared)

    def test_a_pitch_file_alone_suffices_where_nothing_was_compensated(self, tmp_path):
        """The magnification of an empty table does not matter; the chosen one is in the report, to
        be set by hand."""
        master = punch(*(f"N{10000 + n}Q0P0" for n in range(200)))
        profile = fanuc_profile((master,))
        profile = replace(
            profile, machine=msgspec.structs.replace(profile.machine, functions=["EXX"])
        )
        report = export(
            made_result({"EXX": [30, 13, 0, -9, -20]}), "fanuc", profile, out_dir=tmp_path
        )
        assert b"N10039Q0P6" in (tmp_path / "PITCH_UNTESTED_SIGN.TXT").read_bytes()
        assert "parameter 3623 A1 = 3" in report.text

    def test_data_of_unknown_magnification_are_refused(self):
        """Old data without parameter 3623 could mean anything: they are not compared with, nor
        merged."""
        master = punch(*(f"N{10000 + n}Q0P1" for n in range(200)))
        with pytest.raises(
            DataError,
            match=r"parameter 3623 A1: expected a value.*state fanuc\.axes\.X\.magnification as "
            r"in the export report",
        ):
            CONTROL.parse([master], fanuc_profile())


class TestDirections:
    def test_bidirectional_is_refused_unless_asked_for(self):
        profile = fanuc_profile()
        profile = replace(
            profile, machine=msgspec.structs.replace(profile.machine, direction="both")
        )
        with pytest.raises(SafetyError) as refusal:
            CONTROL.plan(
                curves_of(made_result(reversal={"EXX": [0, 1, 1, 1, 1]}), ["EXX"]), profile
            )
        assert refusal.value.code == "direction-unfit.unproven"

    def test_bidirectional_sets_its_bit_and_the_offset_at_the_reference(self):
        """3605#0, 3626 and 3627: the reversal of 6 µm (in - the axis stands 6 µm lower) is an
        offset of +6 for travel in -."""
        profile = profile_of("fanuc", VOLUME, direction="both", reference_at=2)
        result = made_result({"EXX": EXAMPLE}, reversal={"EXX": [6.0] * 5})
        plan = CONTROL.plan(curves_of(result, ["EXX"]), profile)
        text = CONTROL.render(plan.tables, replace(profile, options=plan.options))[0].data
        assert b"N03605Q1A1P00000001A2P00000000" in text
        assert b"N03626Q1A1P160A2" in text
        assert b"N03627Q1A1P6A2" in text

    @pytest.mark.parametrize("active", [False, True])
    def test_an_axis_without_a_reversal_keeps_one_table_beside_those_with_two(
        self, active, tmp_path
    ):
        """3605#0 is each axis' own: Y was read as half of itself, beside an empty table for travel
        in -, and refused."""
        profile = profile_of("fanuc", VOLUME, sections=16, direction="both", reference_at=8)
        own = profile.existing[0]
        if active:
            data = own.data.replace(
                b"N03605Q1A1P00000000A2P00000000", b"N03605Q1A1P00000000A2P00000001"
            )
            profile = replace(profile, existing=(replace(own, data=data),))
        result = made_result(
            {"EXX": EXAMPLE, "EYY": [0, 9, 14, 16, 12]}, reversal={"EXX": [6.0] * 5}, u_um=0.1
        )
        accept = ["slope-steep", "profile-incomplete.reversal"]
        report = export(result, "fanuc", profile, accept=accept, out_dir=tmp_path / "out")
        assert {(table.name, table.direction) for table in report.tables} == {
            ("EXX", 1),
            ("EXX", -1),
            ("EYY", 0),
            ("EZZ", 0),
        }
        assert (
            b"N03605Q1A1P00000001A2P00000000"
            in (tmp_path / "out" / "PITCH_UNTESTED_SIGN.TXT").read_bytes()
        )

    def test_without_its_bit_an_axis_has_a_second_table_where_its_own_second_range_holds_data(
        self,
    ):
        """Where no file holds 3605#0, values in the range of X tell, and those of Y, which begins
        later, do not."""
        profile = profile_of("fanuc", VOLUME, direction="both", reference_at=2)

        def directions(points: dict[int, int]) -> list[tuple[str, int]]:
            lines = ["N03623Q1A1P1A2P1A3P1", "N03627Q1A1P0A2P0A3P0"]
            lines += [f"N1{point:04}Q0P{points.get(point, 0)}" for point in range(700)]
            return [
                (table.name, table.direction)
                for table in CONTROL.parse([punch(*lines)], profile)
            ]

        assert directions({99: 3, 301: 4}) == [("EXX", 0), ("EYY", 0), ("EZZ", 0)]
        assert directions({99: 3, 162: 2}) == [
            ("EXX", 1),
            ("EXX", -1),
            ("EYY", 0),
            ("EZZ", 0),
        ]


class TestStraightLines:
    def test_straightness_without_parameter_numbers_is_in_the_report_only(self):
        """controllers.md 2.4: no source gives the numbers."""
        plan = CONTROL.plan(
            curves_of(made_result({"EYX": [0, 3, 5, 3, 0]}), ["EYX"]), fanuc_profile()
        )
        assert not plan.tables
        assert [table.name for table in plan.listed] == ["EYX"]
        assert [item.key for item in plan.findings] == ["function-left-out.report"]

    def test_straightness_of_three_straight_lines_is_met_to_half_a_unit(self):
        """Four points describe a curve of three straight lines exactly; values are absolute and as
        compensation."""
        master = punch(
            *(
                f"N0{number}Q1L1P0"
                for number in (5711, 5721, 5731, 5732, 5733, 5734, 5761, 5762, 5763, 5764)
            ),
            *(f"N{10000 + n}Q0P0" for n in range(39, 43)),
        )
        numbers = StraightnessNumbers(
            moving=5711,
            compensated=5721,
            points=[5731, 5732, 5733, 5734],
            values=[5761, 5762, 5763, 5764],
        )
        profile = fanuc_profile((master,), straightness={"EYX": numbers})
        curves = curves_of(made_result({"EYX": [-20, -10, 0, 8, 0]}), ["EXX", "EYX"])
        plan = CONTROL.plan(curves, profile)
        settled = replace(profile, options=plan.options)
        read = CONTROL.parse(CONTROL.render(plan.tables, settled), settled)
        table = next(table for table in read if table.name == "EYX")
        np.testing.assert_allclose(
            correction_um(table, np.array([-200.0, -100, 0, 100, 200])),
            [20, 10, 0, -8, 0],
            atol=0.5,
        )

    def test_inclination_takes_the_slope_and_pitch_data_the_rest(self):
        """B-64523EN-1/02: both add up; with 60 µm of slope the increments stay small at
        magnification 1."""
        axes = {
            **fanuc_profile().options.axes,
            "X": AxisPoints(number=1, reference_point=40, inclination=True),
        }
        curves = curves_of(made_result({"EXX": [30, 16, 0, -14, -30]}), ["EXX"])
        plan = CONTROL.plan(curves, fanuc_profile(axes=axes))
        assert [table.kind for table in plan.tables] == ["inclination", "pitch"]
        assert plan.tables[1].quantum_um == 1.0
        at = np.array([-200.0, -100, 0, 100, 200])
        np.testing.assert_allclose(
            sum(correction_um(table, at) for table in plan.tables),
            [-30, -16, 0, 14, 30],
            atol=0.5,
        )

    def test_inclination_beside_pitch_data_of_each_direction(self):
        """The slope is taken off both, also of a machine that stands 6 µm lower in -."""
        profile = profile_of("fanuc", VOLUME, direction="both", reference_at=2)
        axes = {
            **profile.options.axes,
            "X": msgspec.structs.replace(profile.options.axes["X"], inclination=True),
        }
        profile = replace(
            profile, options=msgspec.structs.replace(profile.options, axes=axes)
        )
        errors = made_result({"EXX": [30, 16, 0, -14, -30]}, reversal={"EXX": [6.0] * 5})
        tables = CONTROL.plan(curves_of(errors, ["EXX"]), profile).tables
        assert [(table.kind, table.direction) for table in tables] == [
            ("inclination", 0),
            ("pitch", 1),
            ("pitch", -1),
        ]
        at, wanted = np.array([-200.0, -100, 0, 100, 200]), np.array([-30, -16, 0, 14, 30])
        there, back = (
            sum(correction_um(table, at, way) for table in tables) for way in (1, -1)
        )
        np.testing.assert_allclose(there - there[2], wanted, atol=0.6)
        np.testing.assert_allclose(back - back[2], wanted, atol=0.6)
        assert back[2] - there[2] == pytest.approx(6.0, abs=0.6)

    def test_inclination_without_parameter_lines_is_refused(self):
        """Pitch data that count on an inclination which nobody loads would make the machine
        worse."""
        axes = {
            **fanuc_profile().options.axes,
            "X": AxisPoints(number=1, reference_point=40, inclination=True),
        }
        with pytest.raises(SafetyError) as refusal:
            written(
                fanuc_profile(
                    (punch(*(f"N{10000 + n}Q0P0" for n in range(39, 43))),), axes=axes
                ),
                [30, 16, 0, -14, -30],
            )
        assert refusal.value.code == "template-missing.parameters"


def test_readable_table_has_parameters_and_data():
    """Without any file a person can type the table in."""
    plan = CONTROL.plan(curves_of(made_result({"EXX": EXAMPLE}), ["EXX"]), fanuc_profile())
    rows = "\n".join(CONTROL.readable(plan.tables[0], fanuc_profile()))
    for text in (
        "parameter 3620 A1 = 40",
        "parameter 3621 A1 = 39",
        "parameter 3622 A1 = 42",
        "parameter 3623 A1 = 1",
        "3624 A1 = 100.0",
    ):
        assert text in rows
    assert FANUC.count("reference_point") == 3


class TestIdentity:
    """The machine's own file must be that of the machine in the profile."""

    WELL = (
        "N01020Q1A1P88A2P89A3P90",
        "N03620Q1A1P40A2P80A3P120",
        "N03622Q1A1P42A2P0A3P0",
        "N03605Q1A1P00000000",
    )
    PITCH = tuple(f"N1{point:04}Q0P0" for point in range(38, 43))

    def codes(self, *lines: str, **options: object) -> set[str]:
        profile = fanuc_profile((punch(*self.WELL, *lines, *self.PITCH),), **options)
        plan = CONTROL.plan(curves_of(made_result({"EXX": EXAMPLE}), ["EXX"]), profile)
        return {item.key for item in plan.findings if item.severity != "info"}

    def test_a_file_of_this_machine_passes(self):
        assert (
            self.codes(
                "N01006Q1A1P00000000",
                "N01013Q1A1P00000000",
                "N01001Q1L1P00000000",
                "N08135Q1P00000000",
            )
            == set()
        )

    @pytest.mark.parametrize(
        ("line", "code"),
        [
            ("N01006Q1A1P00001000", "machine-file-differs.diameters"),
            ("N01013Q1A1P00000010", "machine-file-differs.increment"),
            ("N01001Q1P00000001", "units-not-metric.machine"),
            ("N08135Q1P00000001", "machine-file-differs.disabled"),
        ],
    )
    def test_a_unit_or_switch_that_contradicts(self, line, code):
        assert self.codes(line) == {code}

    @pytest.mark.parametrize(("bits", "own_um"), [("01", 10.0), ("00", 1.0), ("10", 0.1)])
    def test_the_least_input_increment_is_that_of_1013(self, bits, own_um):
        """1013#0 is IS-A, #1 IS-C, neither IS-B."""
        for said_um in (10.0, 1.0, 0.1):
            found = self.codes(f"N01013Q1A1P000000{bits}", least_input_um=said_um)
            assert ("machine-file-differs.increment" in found) == (said_um != own_um)

    @pytest.mark.parametrize(
        ("old", "new", "code"),
        [
            ("A1P88A2P89", "A1P89A2P88", "machine-file-differs.axis"),
            ("A1P40", "A1P41", "machine-file-differs.reference"),
            ("Q1A1P88", "Q1A4P88", "machine-file-differs.no-axis"),
            ("Q1A1P40", "Q1A4P40", "machine-file-differs.no-axis"),
            (
                "N03605Q1A1P00000000",
                "N03605Q1A1P00000001",
                "machine-file-differs.bidirectional",
            ),
        ],
    )
    def test_another_machine_or_setting(self, old, new, code, monkeypatch):
        monkeypatch.setattr(
            type(self), "WELL", tuple(line.replace(old, new) for line in self.WELL)
        )
        assert self.codes() == {code}

    def test_an_export_is_refused(self, tmp_path):
        profile = fanuc_profile((punch("N01020Q1A1P89", *self.PITCH),))
        with pytest.raises(SafetyError) as refusal:
            export(made_result({"EXX": EXAMPLE}), "fanuc", profile, out_dir=tmp_path / "out")
        assert refusal.value.code == "machine-file-differs.axis"


def test_merging_takes_the_steps_of_the_old_table_off_where_they_were_measured():
    """A machine that errs along a straight line, old steps of 100 mm, a survey every 40 mm: the sum
    is the straight line again."""
    machine = lambda at: 0.05 * (np.asarray(at) + 200.0)  # noqa: E731
    old = Table(
        kind=KIND,
        input_axis="X",
        output_axis="X",
        position_mm=np.linspace(-200, 200, 5),
        value_um=np.array([0.0, -5, -5, -5, -5]),
        quantum_um=1.0,
        law=LAW,
        reference_mm=-200.0,
    )
    measured = np.linspace(-200, 200, 11)
    residual = Curve(
        name="EXX",
        position_mm=measured,
        forward_um=machine(measured) + correction_um(old, measured),
        u_um=np.zeros(11),
        parts=("EXX",),
    )
    profile = fanuc_profile()
    (bare,) = merged([residual], [old], profile)
    np.testing.assert_allclose(bare.forward_um, machine(bare.position_mm), atol=1e-9)
