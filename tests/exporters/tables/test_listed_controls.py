"""Mitsubishi and Fagor, whose tables are keyed in: the places of the numbers, scales, the reading
of a list."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from stepdiag.base.errors import DataError, SafetyError
from stepdiag.exporters.fagor.control import FAGOR
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.mitsubishi.control import Mitsubishi
from stepdiag.exporters.tables.curves import curves_of
from stepdiag.exporters.tables.tables import correction_um
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME, made_result

EXAMPLE = [4.0, 1.0, 0.0, -2.0, -5.0]
"""controllers.md 12: e of X at -200 .. 200 mm in um, zero at the reference."""


def profile(controller, direction="mean", reference_at=2, **options):
    plain = profile_of(controller, VOLUME, reference_at=reference_at, direction=direction)
    return replace(plain, options=msgspec.structs.replace(plain.options, **options))


def listed(controller, which, values, names=("EXX",), **more):
    plan = controller.plan(curves_of(made_result(values, **more), names), which)
    return plan, controller.render(plan.tables, which)


class TestMitsubishi:
    def parameters(self, files):
        lines = [
            line.split()
            for line in files[0].data.decode().splitlines()
            if not line.startswith(";")
        ]
        return {int(number[1:]): value for number, value in lines}

    def test_places_of_the_increments(self):
        """C64 p. 280: above the reference n holds n-1 to n, below it n to n+1; both are the rise of
        what is added.

        A = -4 -1 0 +2 +5 µm, in units of 0.5 µm: sections +6 +2 | +4 +6, the reference number
        itself is empty.
        """
        _, files = listed(Mitsubishi(), profile("mitsubishi"), {"EXX": EXAMPLE})
        parameters = self.parameters(files)
        assert [parameters[number] for number in range(4101, 4106)] == [
            "6",
            "2",
            "0",
            "4",
            "6",
        ]
        assert [parameters[number] for number in range(4000, 4008)] == [
            "1",
            "AX1",
            "AX1",
            "4103",
            "4101",
            "4105",
            "1",
            "100.0",
        ]

    def test_absolute_data(self):
        """#4000 = 0: the amounts themselves."""
        _, files = listed(
            Mitsubishi(), profile("mitsubishi", data="absolute"), {"EXX": EXAMPLE}
        )
        parameters = self.parameters(files)
        assert [parameters[number] for number in range(4101, 4106)] == [
            "-8",
            "-2",
            "0",
            "4",
            "10",
        ]
        assert parameters[4000] == "0"

    @pytest.mark.parametrize("data", ["incremental", "absolute"])
    def test_the_smallest_scale_that_fits(self, data):
        """Data are -128 to 127: 150 µm in one section needs 300 units of 0.5 µm, so a scale of 3;
        the far end is right to half a unit."""
        which = profile("mitsubishi", data=data)
        plan, files = listed(Mitsubishi(), which, {"EXX": [-151.0, 0.0, 0.0, 100.0, 150.0]})
        (table,) = Mitsubishi().parse(files, which)
        assert table.place["scale"] == 3
        assert correction_um(table, np.array([-200.0, 200.0])) == pytest.approx(
            [151.0, -150.0], abs=0.75
        )
        assert Mitsubishi().readable(plan.tables[0], which)[1:4] == (
            "#4001 AX1",
            "#4002 AX1",
            "#4003 4103",
        )

    def test_the_largest_scale_is_written_and_read(self):
        """Data -128 to 127, scale 1 to 99: 6280 µm are 12,560 units of 0.5 µm, 126.9 of 99 and
        128.2 of 98."""
        which = profile("mitsubishi", data="absolute")
        _, files = listed(Mitsubishi(), which, {"EXX": [0.0, 0.0, 0.0, 0.0, -6280.0]})
        (table,) = Mitsubishi().parse(files, which)
        assert table.place["scale"] == 99
        assert correction_um(table, np.array([200.0])) == pytest.approx(6280.0, abs=25.0)

    def test_each_pair_of_axes_has_its_own_numbers(self):
        """The second pair stands 10 higher, its data follow those of the first; base and
        compensated axis may differ."""
        which = profile("mitsubishi")
        _, files = listed(
            Mitsubishi(),
            which,
            {"EXX": EXAMPLE, "EXY": [0.0, 2.0, 4.0, 2.0, 0.0]},
            ("EXX", "EXY"),
        )
        parameters = self.parameters(files)
        assert [parameters[number] for number in (4011, 4012, 4013, 4014)] == [
            "AX2",
            "AX1",
            "4108",
            "4106",
        ]
        assert [table.name for table in Mitsubishi().parse(files, which)] == ["EXX", "EXY"]

    def test_limits_of_the_control_are_refused(self):
        """A reference between two points, more data than there are numbers, a curve beyond every
        scale."""
        which = profile("mitsubishi")
        off = replace(
            which,
            axes={
                **which.axes,
                "X": msgspec.structs.replace(which.axes["X"], reference_mm=10.0),
            },
        )
        for bad, values, code in (
            (off, {"EXX": EXAMPLE}, "reference-unfit.between"),
            (
                profile("mitsubishi", first_data=5122),
                {"EXX": EXAMPLE},
                "control-full.numbers",
            ),
            (which, {"EXX": [0.0, 90000.0, 0.0, 0.0, 0.0]}, "field-too-narrow.value"),
        ):
            with pytest.raises(SafetyError) as refused:
                listed(Mitsubishi(), bad, values)
            assert refused.value.code == code

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            (("#4006 1\r\n", ""), r"expected #4006 sc, found nothing"),
            (("#4104 4\r\n", ""), r"expected #4101 to #4105, found no #4104"),
            (("#4000 1", "#4000 0"), r"expected the value of #4000 for incremental data"),
            (("#4102 2", "#4102 2.5"), r"expected a whole number, found '2\.5'"),
            (
                ("#4003 4103", "#4003 4199"),
                r"expected 4101 <= lowest number <= number of the reference <= highest number",
            ),
            (("#4002 AX1", "4002=AX1"), r"expected #number value"),
            (
                ("#4006 1", "#4006 0"),
                r"scale 1 to 99, interval above 0, found 4101 4103 4105, scale 0",
            ),
        ],
    )
    def test_a_damaged_list_is_named(self, change, message):
        """By line or parameter number."""
        which = profile("mitsubishi")
        _, files = listed(Mitsubishi(), which, {"EXX": EXAMPLE})
        with pytest.raises(DataError, match=message):
            Mitsubishi().parse(
                [
                    replace(
                        files[0],
                        data=files[0].data.replace(*[text.encode() for text in change]),
                    )
                ],
                which,
            )


class TestFagor:
    def test_rows(self):
        """8055i p. 328: position, amount of error in +, amount in -; zeros in - mean that + counts
        for both."""
        _, files = listed(FAGOR, profile("fagor"), {"EXX": EXAMPLE})
        assert files[0].data.decode().split("\r\n")[1:5] == [
            "AXIS AX1",
            "POSITION;ERROR +;ERROR -",
            "-200.0000;0.0040;0.0000",
            "-100.0000;0.0010;0.0000",
        ]
        (table,) = FAGOR.parse(files, profile("fagor"))
        assert table.direction == 0

    def test_both_directions(self):
        """The reversal of 6 µm stands between the columns."""
        which = profile("fagor", direction="both")
        _, files = listed(FAGOR, which, {"EXX": EXAMPLE}, reversal={"EXX": [-6.0] * 5})
        forward, reverse = FAGOR.parse(files, which)
        np.testing.assert_allclose(reverse.value_um - forward.value_um, 6.0, atol=1e-9)

    def test_a_reverse_column_of_zeros_cannot_be_told_from_none(self):
        """Error only in +: the control would use the + column in both directions."""
        which = profile("fagor", direction="both")
        values, reversal = (
            {"EXX": [5.0, 4.0, 0.0, 2.0, 1.0]},
            {"EXX": [10.0, 8.0, 0.0, 4.0, 2.0]},
        )
        with pytest.raises(SafetyError) as refused:
            listed(FAGOR, which, values, reversal=reversal)
        assert refused.value.code == "direction-unfit.column"

    def test_straightness_is_said_to_stay(self):
        """No cross table is described: only positioning errors are listed."""
        plan, files = listed(
            FAGOR, profile("fagor"), {"EYX": [0.0, 3.0, 6.0, 3.0, 0.0]}, ("EXX", "EYX")
        )
        assert [file.name for file in files] == ["fagor_AX1.csv"]
        assert "stay in the machine (largest values): EYX 6.0 µm" in next(
            f.text for f in plan.findings if f.key == "function-left-out.no-table"
        )

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ((b"AXIS AX1", b"AX1"), r"expected AXIS"),
            ((b"-100.0000;", b"-300.0000;"), r"rising positions"),
            ((b"0.0010;0.0000", b"0.0010"), r"rows of three numbers"),
            ((b"0.0010;0.0000", b"inf;0.0000"), r"line 5: expected a number, found 'inf'"),
        ],
    )
    def test_a_damaged_list_is_named(self, change, message):
        """By file and line."""
        which = profile("fagor")
        _, files = listed(FAGOR, which, {"EXX": EXAMPLE})
        with pytest.raises(DataError, match=message):
            FAGOR.parse(
                [ControlFile(name=files[0].name, data=files[0].data.replace(*change))], which
            )
