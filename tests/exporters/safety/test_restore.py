"""Restore restores: after the restore files the control does what it did before the export,
whatever it held then."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from stepdiag.base.errors import SafetyError, UsageError
from stepdiag.base.volume import grid_points_mm
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.naming import plain_name
from stepdiag.exporters.profiles.registry import CONTROLLERS, controller_named
from stepdiag.exporters.safety.restore import restore_files
from stepdiag.exporters.tables.curves import curves_of
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import total_correction_um
from stepdiag.virtual.control.siemens import SiemensControl
from testkit.exact.machines import MACHINES, profile_of
from testkit.exact.results import VOLUME, made_result

FIRST = made_result(
    {"EXX": [0, 3, 8, 12, 20], "EYX": [0, 1.5, 2, 1, 0], "EZX": [0, 1, 1, 2, 0]},
    squareness={"C0Y": 20.0, "A0Z": -15.0},
)
SECOND = made_result(
    {
        "EXX": [0, -3, -1, 2, 9],
        "EYY": [0, 4, 5, 7, 9],
        "EXY": [0, 2, -1, 1, 0],
        "EXZ": [0, -3, 2, 1, 0],
    },
    squareness={"B0Z": 18.0},
)
POINTS = grid_points_mm(VOLUME, 5)


def planned(name: str, result, profile: Profile):
    """Tables and files of an export without its door."""
    controller = controller_named(name)
    plan = controller.plan(
        curves_of(result, profile.machine.functions, profile.machine.squareness_into), profile
    )
    settled = replace(profile, options=plan.options or profile.options)
    return plan.tables, settled, controller.render(plan.tables, settled)


def siemens(functions: tuple[str, ...]) -> Profile:
    profile = profile_of("siemens", VOLUME)

    return replace(
        profile, machine=msgspec.structs.replace(profile.machine, functions=list(functions))
    )


OLD = {
    "nothing": (),
    "EEC alone": ("EXX", "EYY"),
    "CEC alone": ("EYX", "EXY"),
    "both": ("EXX", "EYX", "EZX"),
    "everything": tuple(FIRST.errors)[:9],
}


class TestSiemens:
    @pytest.mark.parametrize("ending", ["INI", "MPF"])
    @pytest.mark.parametrize("old", OLD)
    @pytest.mark.parametrize(
        "new", [("EXX", "EYY", "EZZ"), ("EYX", "EXY", "EXZ"), tuple(FIRST.errors)[:9]]
    )
    def test_the_virtual_control_stands_where_it_stood(self, ending, old, new):
        """Old tables, then the export, then the restore files, in a control that keeps what nobody
        overwrites."""
        before = list(planned("siemens", FIRST, siemens(OLD[old]))[2]) if OLD[old] else []
        own = tuple(file for file in before if file.name.endswith("INI"))
        control = SiemensControl()
        for file in before:
            control.load(file.data.decode("ascii"))
        stood = self.moved_um(control)
        tables, profile, files = planned(
            "siemens", SECOND, replace(siemens(new), existing=own)
        )
        for file in files:
            control.load(file.data.decode("ascii"))
        assert np.max(np.abs(self.moved_um(control) - stood)) > 5.0
        restore = restore_files(controller_named("siemens"), tables, profile)
        for file in [*restore, *restore]:  # a person may not remember having done it
            if file.name.endswith(ending):
                control.load(file.data.decode("ascii"))
        np.testing.assert_allclose(self.moved_um(control), stood, atol=1e-6)
        assert {plain_name(file.name): file.data for file in restore}.items() >= {
            file.name: file.data for file in own
        }.items()

    @pytest.mark.parametrize("asked", ["files", "profile"])
    @pytest.mark.parametrize(("enabled", "weight"), [(False, 1.0), (True, 0.5), (False, 0.5)])
    def test_switches_and_weights_come_back(self, asked, enabled, weight):
        """Tables that were off stay off, half a weight stays half: as the backup holds it, else as
        the profile states it."""
        functions = ("EXX", "EYX", "EXY")
        before = list(planned("siemens", FIRST, siemens(functions))[2])
        control = SiemensControl()
        for file in before:
            control.load(file.data.decode("ascii"))
        switched = [
            "$MA_ENC_COMP_ENABLE[0,AX1]=1",
            *(f"$SN_CEC_TABLE_ENABLE[{index}]={str(enabled).upper()}" for index in (0, 1)),
            *(f"$SN_CEC_TABLE_WEIGHT[{index}]={weight:g}" for index in (0, 1)),
            *(f"$MA_CEC_ENABLE[{axis}]={str(enabled).upper()}" for axis in ("AX1", "AX2")),
        ]
        if not enabled:
            switched[0] = "$MA_ENC_COMP_ENABLE[0,AX1]=0"
        control.load("\n".join(["CHANDATA(1)", *switched, "M17", ""]))
        stood = self.moved_um(control)
        own = tuple(file for file in before if file.name.endswith("INI"))
        profile = replace(siemens(functions), existing=own)
        options = msgspec.structs.replace(
            profile.options, old_enabled=enabled, old_weight=weight
        )
        if asked == "files":
            options = msgspec.structs.replace(
                profile.options, old_enabled=None, old_weight=None
            )
            own = tuple(
                replace(
                    file,
                    data=file.data.replace(b"M17", "\n".join([*switched, "M17"]).encode()),
                )
                for file in own
            )
        tables, settled, files = planned(
            "siemens", SECOND, replace(profile, options=options, existing=own)
        )
        for file in files:
            control.load(file.data.decode("ascii"))
        assert np.max(np.abs(self.moved_um(control) - stood)) > 5.0
        for file in restore_files(controller_named("siemens"), tables, settled):
            if file.name.endswith("MPF"):
                control.load(file.data.decode("ascii"))
        np.testing.assert_allclose(self.moved_um(control), stood, atol=1e-6)

    @pytest.mark.parametrize(
        ("key", "functions"),
        [("old_enabled", ("EXX",)), ("old_enabled", ("EYX",)), ("old_weight", ("EYX",))],
    )
    def test_unanswered_switches_refuse_the_export(self, key, functions):
        own = tuple(
            file
            for file in planned("siemens", FIRST, siemens(functions))[2]
            if file.name.endswith("INI")
        )
        profile = siemens(functions)
        profile = replace(
            profile,
            existing=own,
            options=msgspec.structs.replace(profile.options, **{key: None}),
        )
        tables, settled, _ = planned("siemens", SECOND, profile)
        with pytest.raises(SafetyError, match=f"siemens.{key}") as refusal:
            restore_files(controller_named("siemens"), tables, settled)
        assert refusal.value.code == "profile-incomplete.switches"

    def test_tables_that_acted_while_measuring_had_weight_one(self):
        """What they did is part of the measurement, and it is read at weight 1."""
        own = tuple(
            file
            for file in planned("siemens", FIRST, siemens(("EYX",)))[2]
            if file.name.endswith("INI")
        )
        profile = siemens(("EYX",))
        machine = msgspec.structs.replace(profile.machine, measured_with="on")
        options = msgspec.structs.replace(profile.options, old_weight=0.5)
        tables, settled, _ = planned(
            "siemens",
            SECOND,
            replace(profile, existing=own, machine=machine, options=options),
        )
        with pytest.raises(UsageError, match="weight 1"):
            restore_files(controller_named("siemens"), tables, settled)

    def test_what_was_not_there_is_switched_off(self):
        """The loader leaves tables that never were disabled, and an axis without any table too."""
        tables, profile, _ = planned("siemens", SECOND, siemens(("EXX", "EXY")))
        programs = {
            file.name: file.data.decode()
            for file in restore_files(controller_named("siemens"), tables, profile)
        }
        assert "$MA_ENC_COMP_ENABLE[0,AX1]=1" not in programs["LOAD_EEC_RESTORE.MPF"]
        assert "$SN_CEC_TABLE_ENABLE[0]=TRUE" not in programs["LOAD_CEC_RESTORE.MPF"]
        assert "$MA_CEC_ENABLE[AX1]=TRUE" not in programs["LOAD_CEC_RESTORE.MPF"]

    @staticmethod
    def moved_um(control: SiemensControl) -> np.ndarray:
        """What the control does to the tool, in both directions of travel."""
        ways = [np.full(POINTS.shape, way) for way in (1, -1)]
        return 1000.0 * np.array(
            [
                sum(
                    (table.correction_mm(POINTS, way) for table in control.tables()),
                    np.zeros(POINTS.shape),
                )
                for way in ways
            ]
        )


def loaded(files: list[ControlFile], more: list[ControlFile]) -> list[ControlFile]:
    """A control that knows its files by their names: a newer one takes the place of an older
    one."""
    held = {plain_name(file.name).upper(): file for file in files}
    held |= {plain_name(file.name).upper(): file for file in more}
    return list(held.values())


@pytest.mark.parametrize(
    "name", sorted(set(CONTROLLERS) - {"siemens", "neutral", "mitsubishi"})
)
@pytest.mark.parametrize("old", ["nothing", "X alone", "all"])
def test_every_other_control_does_what_it_did(name, old):
    """By the control's own law on its own files: to the table's resolution, both directions."""
    controller, profile = controller_named(name), profile_of(name, VOLUME)
    masters = [
        ControlFile(name=file, data=data) for file, data in MACHINES[name].files.items()
    ]
    _, settled, first = planned(name, FIRST, profile)
    own = [
        file
        for file in first
        if file.role == "data"
        and (old == "all" or "_x" in file.name.lower() or name in ("fanuc", "beckhoff"))
    ]
    own = masters if old == "nothing" else own
    before = (
        total_correction_um(controller.parse(own, settled), POINTS)
        if own
        else np.zeros(POINTS.shape)
    )
    tables, settled, second = planned(name, SECOND, replace(settled, existing=tuple(own)))
    held = loaded(own, [file for file in second if file.role == "data"])
    restored = loaded(
        held,
        [file for file in restore_files(controller, tables, settled) if file.role == "data"],
    )
    if name == "linuxcnc":
        restored = named_in_ini(
            own, second, restore_files(controller, tables, settled), restored
        )
    after = (
        total_correction_um(controller.parse(restored, settled), POINTS)
        if restored
        else np.zeros(POINTS.shape)
    )
    np.testing.assert_allclose(after, before, atol=1e-6)


def named_in_ini(
    own: list[ControlFile],
    second: list[ControlFile],
    restore: list[ControlFile],
    held: list[ControlFile],
) -> list[ControlFile]:
    """The files that a LinuxCNC reads after its INI file was changed as the notes of export and
    restore say."""
    ini = [
        f"{word} = {file.name}"
        for file in own
        for word in ["HALFILE" if file.name.endswith("hal") else "COMP_FILE"]
    ]
    added = next(file.data.decode() for file in second if file.role == "note").splitlines()
    ini = list(
        dict.fromkeys(
            [*ini, *(line for line in added if line.startswith(("COMP_FILE ", "HALFILE")))]
        )
    )
    for line in next(
        file.data.decode() for file in restore if file.role == "note"
    ).splitlines():
        if line.startswith("- ") and line[2:] in ini:
            ini.remove(line[2:])
        if line.startswith("+ "):
            ini.append(line[2:])
    named = {line.partition(" = ")[2] for line in ini}
    return [file for file in held if plain_name(file.name) in named]


def test_linuxcnc_without_a_table_takes_its_lines_out():
    """A COMP_FILE of zeros would go on switching BACKLASH off."""
    tables, profile, _ = planned("linuxcnc", SECOND, profile_of("linuxcnc", VOLUME))
    (note,) = restore_files(controller_named("linuxcnc"), tables, profile)
    assert note.name == "ini_lines_RESTORE.txt"
    assert b"[JOINT_1]\n- COMP_FILE = screw_y.comp\n- COMP_FILE_TYPE = 0\n" in note.data


class TestMitsubishi:
    def test_own_pairs_come_back_and_new_ones_are_zeros(self):
        own, profile = self.own_list(first_data=4101)
        controller = controller_named("mitsubishi")
        before = total_correction_um(controller.parse(own, profile), POINTS)
        tables, settled, second = planned(
            "mitsubishi", SECOND, self.later(profile, own, first_data=4300)
        )
        keyed_in = self.key_in([*own, *second, *restore_files(controller, tables, settled)])
        np.testing.assert_allclose(
            total_correction_um(controller.parse([keyed_in], settled), POINTS),
            before,
            atol=1e-6,
        )

    def test_data_that_would_act_for_two_pairs_are_refused(self):
        own, profile = self.own_list(first_data=4106)
        tables, settled, _ = planned(
            "mitsubishi", SECOND, self.later(profile, own, first_data=4101)
        )
        with pytest.raises(SafetyError) as refusal:
            restore_files(controller_named("mitsubishi"), tables, settled)
        assert (refusal.value.code, refusal.value.remedy) == (
            "points-overlap.restore",
            "first_data = 4111",
        )

    def own_list(self, first_data: int) -> tuple[list[ControlFile], Profile]:

        profile = profile_of("mitsubishi", VOLUME)
        profile = replace(
            profile, machine=msgspec.structs.replace(profile.machine, functions=["EXX"])
        )
        profile = replace(
            profile, options=msgspec.structs.replace(profile.options, first_data=first_data)
        )
        return list(planned("mitsubishi", FIRST, profile)[2]), profile

    @staticmethod
    def later(profile: Profile, own: list[ControlFile], first_data: int) -> Profile:

        options = msgspec.structs.replace(profile.options, first_data=first_data)
        machine = msgspec.structs.replace(profile.machine, functions=["EXX", "EYY", "EXY"])
        return replace(profile, machine=machine, options=options, existing=tuple(own))

    @staticmethod
    def key_in(files: list[ControlFile]) -> ControlFile:
        """The control's parameters after a person has keyed the lists in, one after the other."""
        values: dict[str, str] = {}
        for file in files:
            values |= dict(
                line.partition(";")[0].split()
                for line in file.data.decode().splitlines()
                if line.startswith("#")
            )
        return ControlFile(
            name="all.txt",
            data="".join(f"{number} {value}\n" for number, value in values.items()).encode(),
        )
