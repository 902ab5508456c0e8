"""What a control holds is compared with the export: on a SINUMERIK that runs both programs, and on files of the others."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from stepdiag.exporters.export.export import export
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.sets import read_set
from stepdiag.exporters.profiles.registry import CONTROLLERS, controller_named
from stepdiag.exporters.safety.read_back import STEPS, compare
from stepdiag.exporters.siemens import read_back
from stepdiag.exporters.tables.fit import fitted
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME, made_result
from testkit.exact.sinumerik import Sinumerik

RESULT = made_result(
    {"EXX": [0.0, 5.0, 12.0, 9.0, 3.0], "EYX": [0.0, 3.0, 5.0, 3.0, 0.0], "EZY": [0.0, -2.0, -4.0, 1.0, 0.0]}, squareness={"C0Y": 20.0}
)
SIEMENS = controller_named("siemens")
PROFILE = profile_of("siemens", VOLUME)
MACHINE_DATA = {
    "$MN_SCALING_SYSTEM_IS_METRIC": "1", "$MA_CEC_SCALING_SYSTEM_METRIC": "1", "$MA_MM_ENC_COMP_MAX_POINTS": "30",
    "$MN_MM_CEC_MAX_POINTS": "30", "$MA_CEC_MAX_SUM": "1", "$MA_ENC_COMP_ENABLE": "0",
}  # fmt: skip


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


def differs(machine: Sinumerik) -> dict[str, str]:
    _, files, _ = planned()
    return {found.key: found.text for found in compare(SIEMENS, files, [held(machine)], PROFILE).findings}


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
        "switch", ["$SN_CEC_TABLE_ENABLE[1]", "$MA_CEC_ENABLE[AX2]", "$MA_ENC_COMP_ENABLE[0,AX1]", "$SN_CEC_TABLE_WEIGHT[0]"]
    )
    def test_one_forgotten_switch_or_weight_is_named(self, switch: str) -> None:
        _, _, programs = planned()
        machine = control(programs)
        machine.held[switch] = "0"
        found = differs(machine)
        assert list(found) == ["read-back-differs.switch"]
        assert found["read-back-differs.switch"].startswith(f"{switch[1:]} is 0")

    def test_one_number_that_is_another_is_named_with_its_place(self) -> None:
        """One unit of the last digit: 0.1 um."""
        _, _, programs = planned()
        machine = control(programs)
        name = "$AA_ENC_COMP[0,2,AX1]"
        machine.held[name] = f"{float(machine.held[name]) + 1e-4:.4f}"
        (text,) = differs(machine).values()
        assert "1 numbers in the control are not as written, the first at X 0 mm" in text

    def test_another_grid_and_an_exchanged_axis_show(self) -> None:
        _, _, programs = planned()
        for name, value in (("$AN_CEC_STEP[0]", "50"), ("$AN_CEC_OUTPUT_AXIS[0]", "(AX3)"), ("$AN_CEC_DIRECTION[0]", "1")):
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
        machine.held |= {"$SN_CEC_TABLE_WEIGHT[0]": "0.5", "$SN_CEC_TABLE_ENABLE[0]": "0", "$MA_ENC_COMP_ENABLE[0,AX1]": "0"}
        options = msgspec.structs.replace(PROFILE.options, old_enabled=None, old_weight=None)
        old = replace(held(machine), name="STEPDIAG_BACK.INI")
        restored = control(programs)
        for file in SIEMENS.restore(tables, replace(PROFILE, existing=(old,), options=options)):
            if file.role == "program":
                restored.run(file.data.decode("ascii"))
        watched = ("$SN_CEC_TABLE_WEIGHT[0]", "$SN_CEC_TABLE_ENABLE[0]", "$MA_ENC_COMP_ENABLE[0,AX1]", "$SN_CEC_TABLE_ENABLE[1]")
        assert {name: float(restored.held[name]) for name in watched} == dict(zip(watched, (0.5, 0.0, 0.0, 1.0), strict=True))


def test_an_export_brings_the_program_and_the_steps(tmp_path) -> None:
    export(RESULT, "siemens", PROFILE, accept=("change-large", "slope-steep"), out_dir=tmp_path / "out")
    files = {file.name: file for file in read_set(tmp_path / "out")}
    assert b"WRITE(FAULT,BACK" in files[read_back.NAME].data
    assert b"--read-back FILE" in files["EXPORT_REPORT.txt"].data


@pytest.mark.parametrize("name", sorted(set(CONTROLLERS) - {"neutral"}))
def test_what_any_control_holds_is_compared_with_what_was_written(name: str) -> None:
    """The same files read out again differ in nothing; of another survey in every table that moved."""
    controller = controller_named(name)
    profile = profile_of(name, VOLUME)
    sets = []
    for result in (RESULT, made_result({"EXX": [0.0, -7.0, 1.0, 4.0, 8.0]})):
        plan = controller.plan(fitted(result, profile.machine.functions, profile.machine.squareness_into).curves, profile)
        settled = replace(profile, options=plan.options or profile.options)
        sets.append([file for file in controller.render(plan.tables, settled) if file.role == "data"])
    new, old = sets
    same = compare(controller, new, new, settled)
    assert {found.key for found in same.findings} <= {"read-back-differs.unread"}
    assert same.numbers > 10
    other = compare(controller, new, old, settled)
    assert {"read-back-differs", "read-back-differs.absent"} & {found.key for found in other.findings}
    assert name in STEPS
    assert np.isfinite(same.numbers)
