"""What a control holds is compared with the export: on a SINUMERIK that runs both programs, and on
files of the others."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from stepdiag.base.errors import DataError
from stepdiag.exporters.export.export import export
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.sets import read_set
from stepdiag.exporters.profiles.registry import CONTROLLERS, controller_named
from stepdiag.exporters.safety.read_back import STEPS, compare, differences
from stepdiag.exporters.siemens import read_back
from stepdiag.exporters.tables.fit import fitted
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME, made_result
from testkit.exact.sinumerik import Sinumerik

RESULT = made_result(
    {
        "EXX": [0.0, 5.0, 12.0, 9.0, 3.0],
        "EYX": [0.0, 3.0, 5.0, 3.0, 0.0],
        "EZY": [0.0, -2.0, -4.0, 1.0, 0.0],
    },
    squareness={"C0Y": 20.0},
)
SIEMENS = controller_named("siemens")
PROFILE = profile_of("siemens", VOLUME)
MACHINE_DATA = {
    "$MN_SCALING_SYSTEM_IS_METRIC": "1",
    "$MA_CEC_SCALING_SYSTEM_METRIC": "1",
    "$MA_MM_ENC_COMP_MAX_POINTS": "30",
    "$MN_MM_CEC_MAX_POINTS": "30",
    "$MA_CEC_MAX_SUM": "1",
    "$MA_ENC_COMP_ENABLE": "0",
}


def planned():
    tables = SIEMENS.plan(fitted(RESULT).curves, PROFILE).tables
    files = SIEMENS.render(tables, PROFILE)
    programs = [file for file in files if file.role == "program"]
    return tables, files, programs


def control(programs: list[ControlFile], **state: int | None) -> Sinumerik:
    machine = Sinumerik(machine=MACHINE_DATA, **state)
    for file in programs:
        machine.run(file.data.decode("ascii"))
    machine.stop_after = None
    return machine


def held(machine: Sinumerik) -> ControlFile:
    """Run the program that reads out, and return what it wrote, as the control names it."""
    machine.run(read_back.program(planned()[0], PROFILE).data.decode("ascii"))
    return ControlFile(name="STEPDIAG_BACK.MPF", data=machine.read_out().encode("ascii"))


def written_as(value: str, back: ControlFile) -> ControlFile:
    """Return what was read out with one switch in other words."""
    switch = b"$MA_CEC_ENABLE[AX2]="
    assert back.data.count(switch + b"1") >= 1
    return replace(
        back, data=back.data.replace(switch + b"1", switch + value.encode("ascii"))
    )


def differs(machine: Sinumerik) -> dict[str, str]:
    _, files, _ = planned()
    return {
        found.key: found.text
        for found in compare(SIEMENS, files, [held(machine)], PROFILE).findings
    }


class TestSinumerik:
    def test_a_whole_loading_reads_back_as_written(self) -> None:
        tables, files, programs = planned()
        found = compare(SIEMENS, files, [held(control(programs))], PROFILE)
        assert found.findings == ()
        assert found.numbers == sum(len(table.value_um) for table in tables)
        assert found.switches == 3 + 2 * 6 + 3

    @pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.7, 0.9, 0.98])
    def test_a_loading_that_ended_half_way_shows(self, share: float) -> None:
        _, _, programs = planned()
        lines = sum(len(file.data.splitlines()) for file in programs[1:])
        assert differs(control(programs[1:], stop_after=int(share * lines)))

    @pytest.mark.parametrize(
        "switch",
        [
            "$SN_CEC_TABLE_ENABLE[1]",
            "$MA_CEC_ENABLE[AX2]",
            "$MA_ENC_COMP_ENABLE[0,AX1]",
            "$SN_CEC_TABLE_WEIGHT[0]",
        ],
    )
    def test_one_forgotten_switch_or_weight_is_named(self, switch: str) -> None:
        _, _, programs = planned()
        machine = control(programs)
        machine.held[switch] = "0"
        found = differs(machine)
        assert list(found) == ["read-back-differs.switch"]
        assert found["read-back-differs.switch"].startswith(f"{switch[1:]} is 0")

    @pytest.mark.parametrize(
        ("value", "found"), [("TRUE", []), ("FALSE", ["read-back-differs.switch"])]
    )
    def test_a_switch_may_be_written_as_a_logical_value(
        self, value: str, found: list[str]
    ) -> None:
        _, files, programs = planned()
        back = written_as(value, held(control(programs)))
        told = compare(SIEMENS, files, [back], PROFILE).findings
        assert [each.key for each in told] == found

    def test_a_switch_that_is_no_number_is_refused_by_its_name(self) -> None:
        _, files, programs = planned()
        back = written_as("YES", held(control(programs)))
        with pytest.raises(DataError, match=r"MA_CEC_ENABLE\[AX2\]: expected a number"):
            compare(SIEMENS, files, [back], PROFILE)

    def test_one_number_that_is_another_is_named_with_its_place(self) -> None:
        """One unit of the last digit: 0.1 um."""
        _, _, programs = planned()
        machine = control(programs)
        name = "$AA_ENC_COMP[0,2,AX1]"
        machine.held[name] = f"{float(machine.held[name]) + 1e-4:.4f}"
        (text,) = differs(machine).values()
        assert (
            "1 numbers in the control differ from the written numbers. "
            "The first difference is at X 0 mm" in text
        )

    def test_another_grid_and_an_exchanged_axis_show(self) -> None:
        _, _, programs = planned()
        for name, value in (
            ("$AN_CEC_STEP[0]", "50"),
            ("$AN_CEC_OUTPUT_AXIS[0]", "(AX3)"),
            ("$AN_CEC_DIRECTION[0]", "1"),
        ):
            machine = control(programs)
            machine.held[name] = value
            assert differs(machine), name

    def test_a_file_that_is_full_stops_the_reading_with_its_remedy(self) -> None:
        machine = control(planned()[2], largest_lines=20)
        machine.run(read_back.program(planned()[0], PROFILE).data.decode("ascii"))
        assert machine.shown[-1] == "THE FILE IS FULL: RAISE MD11420, RUN AGAIN"

    def test_restore_takes_switches_and_weights_from_what_was_read_out(self) -> None:
        """The old tables were off, and weighed 0.5: neither the profile nor anybody says it."""
        tables, _, programs = planned()
        machine = control(programs)
        machine.held |= {
            "$SN_CEC_TABLE_WEIGHT[0]": "0.5",
            "$SN_CEC_TABLE_ENABLE[0]": "0",
            "$MA_ENC_COMP_ENABLE[0,AX1]": "0",
        }
        options = msgspec.structs.replace(PROFILE.options, old_enabled=None, old_weight=None)
        old = replace(held(machine), name="STEPDIAG_BACK.INI")
        restored = control(programs)
        for file in SIEMENS.restore(
            tables, replace(PROFILE, existing=(old,), options=options)
        ):
            if file.role == "program":
                restored.run(file.data.decode("ascii"))
        watched = (
            "$SN_CEC_TABLE_WEIGHT[0]",
            "$SN_CEC_TABLE_ENABLE[0]",
            "$MA_ENC_COMP_ENABLE[0,AX1]",
            "$SN_CEC_TABLE_ENABLE[1]",
        )
        assert {name: float(restored.held[name]) for name in watched} == dict(
            zip(watched, (0.5, 0.0, 0.0, 1.0), strict=True)
        )


def test_an_export_brings_the_program_and_the_steps(tmp_path) -> None:
    export(
        RESULT,
        "siemens",
        PROFILE,
        accept=("change-large", "slope-steep"),
        out_dir=tmp_path / "out",
    )
    files = {file.name: file for file in read_set(tmp_path / "out")}
    assert b"WRITE(FAULT,BACK" in files[read_back.NAME].data
    assert b"--read-back FILE" in files["EXPORT_REPORT.txt"].data


@pytest.mark.parametrize("name", sorted(set(CONTROLLERS) - {"neutral"}))
def test_what_any_control_holds_is_compared_with_what_was_written(name: str) -> None:
    """The same files read out again differ in nothing; of another survey in every table that
    moved."""
    controller = controller_named(name)
    profile = profile_of(name, VOLUME)
    sets = []
    for result in (RESULT, made_result({"EXX": [0.0, -7.0, 1.0, 4.0, 8.0]})):
        plan = controller.plan(
            fitted(result, profile.machine.functions, profile.machine.squareness_into).curves,
            profile,
        )
        settled = replace(profile, options=plan.options or profile.options)
        sets.append(
            [file for file in controller.render(plan.tables, settled) if file.role == "data"]
        )
    new, old = sets
    same = compare(controller, new, new, settled)
    assert {found.key for found in same.findings} <= {"read-back-differs.unread"}
    assert same.numbers > 10
    other = compare(controller, new, old, settled)
    assert {"read-back-differs", "read-back-differs.absent"} & {
        found.key for found in other.findings
    }
    assert name in STEPS
    assert np.isfinite(same.numbers)


@pytest.mark.parametrize(
    ("what", "key"),
    [("value_um", "read-back-differs"), ("position_mm", "read-back-differs.grid")],
)
def test_a_number_that_is_no_number_differs(what: str, key: str) -> None:
    table = planned()[0][0]
    spoilt = np.array(getattr(table, what))
    spoilt[1] = np.nan
    held = replace(table, **{what: spoilt})
    assert [each.key for each in differences([table], [held])] == [key]


class Punching:
    """A FANUC as far as read-in and punch-out see it: numbers by their line, parameters and pitch
    data alike; switches are bits of them."""

    def __init__(self, *files: ControlFile) -> None:
        self.names = [file.name for file in files]
        self.files = {file.name: file.data.split(b"\n\r\r") for file in files}

    def read_in(self, file: ControlFile, *, stop_after: int | None = None) -> None:
        """Take numbers over up to a line: a transfer that breaks off leaves the others as they
        were."""
        new = file.data.split(b"\n\r\r")
        self.files[file.name] = [
            *new[:stop_after],
            *self.files[file.name][len(new) if stop_after is None else stop_after :],
        ]

    def put(self, number: int, value: bytes) -> None:
        """Key one parameter in."""
        for lines in self.files.values():
            for at, line in enumerate(lines):
                if line.startswith(b"N%05d" % number):
                    lines[at] = (
                        line[: line.index(b"P") + 1]
                        + value
                        + line[line.index(b"P") + 1 + len(value) :]
                    )

    def punched(self) -> list[ControlFile]:
        return [
            ControlFile(name=name, data=b"\n\r\r".join(lines))
            for name, lines in self.files.items()
        ]


FANUC_OWN = b"\n\r\r".join(
    [
        b"%",
        b"(CNCID=0)",
        b"N03605Q1A1P00000000A2P00000000A3P00000000",
        b"N08135Q1L1P00000000",
        b"N03620Q1A1P100A2P300A3P500",
    ]
    + [b"N0%dQ1A1P0A2P0A3P0" % number for number in (3621, 3622)]
    + [
        b"N03623Q1A1P1A2P1A3P1",
        b"N03624Q1A1P0.0A2P0.0A3P0.0",
        *(b"N1%04dQ0P0" % point for point in range(700)),
        b"%",
        b"",
    ]
)


class TestFanuc:
    """What is read in is punched out: numbers, and the bits that switch them."""

    def loaded(
        self, stop_after: int | None = None
    ) -> tuple[Punching, list[ControlFile], object]:
        base = profile_of("fanuc", VOLUME)
        own = ControlFile(name="PITCH.TXT", data=FANUC_OWN)
        options = msgspec.structs.replace(base.options, experimental_bidirectional=False)
        profile = replace(base, existing=(own,), options=options)
        control = controller_named("fanuc")
        plan = control.plan(fitted(RESULT, ("EXX",)).curves, profile)
        settled = replace(profile, options=plan.options)
        files = list(control.render(plan.tables, settled))
        machine = Punching(own)
        machine.read_in(files[0], stop_after=stop_after)
        return machine, files, settled

    def test_what_was_read_in_is_punched_out_with_its_switches(self) -> None:
        machine, files, profile = self.loaded()
        found = compare(controller_named("fanuc"), files, machine.punched(), profile)
        assert found.findings == ()
        assert found.switches == 2

    def test_a_broken_transfer_shows(self) -> None:
        machine, files, profile = self.loaded(stop_after=111)
        assert compare(controller_named("fanuc"), files, machine.punched(), profile).findings

    @pytest.mark.parametrize(("number", "name"), [(8135, "8135#0"), (3605, "3605#0 A1")])
    def test_a_switch_in_the_other_state_is_named(self, number: int, name: str) -> None:
        """Also where no table can be read beside it: with 3605#0 the control looks for a second
        block, which is not there."""
        machine, files, profile = self.loaded()
        machine.put(number, b"00000001")
        found = compare(controller_named("fanuc"), files, machine.punched(), profile).findings
        (switch,) = [each.text for each in found if each.key == "read-back-differs.switch"]
        assert switch.startswith(f"{name} is 1")


class TestFolders:
    """Controls whose tables are files: a folder that holds them, with the line or parameter that
    switches them."""

    def test_a_heidenhain_whose_assignment_calls_no_table_shows(self) -> None:
        files, profile, control = written("heidenhain")
        assert compare(control, files, files, profile).findings == ()
        off = [
            replace(file, data=file.data.replace(b"*", b" "))
            if file.name.endswith(".CMA")
            else file
            for file in files
        ]
        assert off != files
        assert compare(control, files, off, profile).findings
        half = [file for file in files if not file.name.startswith("AXIS_AX2")]
        assert len(half) == len(files) - 1
        assert compare(control, files, half, profile).findings

    def test_a_beckhoff_axis_list_is_read_with_its_switch(self) -> None:
        files, profile, control = written(
            "beckhoff",
            way="lists",
            axis_numbers={"X": 1, "Y": 2, "Z": 3},
            cross_sense="as-error",
        )
        for state, keys in (
            ("1", []),
            ("0", ["read-back-differs.switch"] * 3),
            (None, ["read-back-differs.unread"] * 3),
        ):
            line = b"" if state is None else f"lr_param.ssfk {state}\r\n".encode()
            held = [replace(file, data=file.data + line) for file in files]
            assert [
                each.key for each in compare(control, files, held, profile).findings
            ] == keys


def written(name: str, **options: object) -> tuple[list[ControlFile], object, object]:
    """Return the data files of an export for a control, its profile and the control."""
    control, profile = controller_named(name), profile_of(name, VOLUME)
    if options:
        profile = replace(
            profile, options=msgspec.structs.replace(profile.options, **options)
        )
    result = made_result(
        {
            "EXX": [0.0, 5.0, 12.0, 9.0, 3.0],
            "EYY": [0.0, 4.0, 2.0, 1.0, 3.0],
            "EZZ": [0.0, -4.0, 2.0, 6.0, 3.0],
        }
    )
    plan = control.plan(fitted(result, ("EXX", "EYY", "EZZ")).curves, profile)
    settled = replace(profile, options=plan.options or profile.options)
    return (
        [file for file in control.render(plan.tables, settled) if file.role == "data"],
        settled,
        control,
    )
