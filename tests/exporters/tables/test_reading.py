"""Files of a machine as they come: given twice, cut off, switched off. What would act otherwise
than it reads is refused."""

from dataclasses import replace

import numpy as np
import pytest

from stepdiag.base.errors import DataError, SafetyError, UsageError
from stepdiag.base.volume import grid_points_mm
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.profiles.registry import CONTROLLERS, controller_named
from stepdiag.exporters.safety.verify import verify_files
from stepdiag.exporters.tables.curves import curves_of
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.reading import tables_in
from stepdiag.exporters.tables.tables import total_correction_um
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME, made_result

RESULT = made_result(
    {"EXX": [0, 3, 8, 12, 20], "EYX": [0, 1.5, 2, 1, 0], "EZX": [0, 1, 1, 2, 0]},
    squareness={"C0Y": 20.0, "A0Z": -15.0},
)
POINTS = grid_points_mm(VOLUME, 5)


def written(name: str) -> tuple[list[ControlFile], Profile]:
    control, profile = controller_named(name), profile_of(name, VOLUME)
    plan = control.plan(
        curves_of(RESULT, profile.machine.functions, profile.machine.squareness_into), profile
    )
    settled = replace(profile, options=plan.options or profile.options)
    return [
        file for file in control.render(plan.tables, settled) if file.role == "data"
    ], settled


def moved_um(name: str, files: list[ControlFile], profile: Profile) -> np.ndarray:
    return total_correction_um(tables_in(controller_named(name), files, profile), POINTS)


@pytest.mark.parametrize("name", sorted(CONTROLLERS))
class TestEveryControl:
    @pytest.mark.parametrize("copied", ["COPY_", ""])
    def test_a_file_and_its_copy_never_count_twice(self, name, copied):
        """Refused, or the same as once; `verify` and the merging of active tables go through the
        same door."""
        files, profile = written(name)
        twice = [*files, *(replace(file, name=copied + file.name) for file in files)]
        try:
            both = moved_um(name, twice, profile)
        except DataError:
            with pytest.raises(DataError):
                verify_files(RESULT, twice, profile)
            return
        np.testing.assert_allclose(both, moved_um(name, files, profile))

    def test_what_is_cut_off_anywhere_is_refused_or_says_the_same(self, name):
        """At the end of a block too, where nothing in the line tells it. A COMP_FILE ends for the
        control itself where it is cut."""
        if name == "linuxcnc":
            return
        files, profile = written(name)
        whole, lines = moved_um(name, files, profile), files[0].data.splitlines(keepends=True)
        for count in sorted(
            {*range(1, len(lines), max(1, len(lines) // 30)), len(lines) - 1}
        ):
            cut = replace(files[0], data=b"".join(lines[:count]))
            try:
                left = moved_um(name, [cut, *files[1:]], profile)
            except (DataError, UsageError, SafetyError):
                continue
            np.testing.assert_allclose(
                left, whole, atol=0.05, err_msg=f"{count} of {len(lines)} lines"
            )


@pytest.mark.parametrize(
    ("changed", "found"),
    [
        (b"$SN_CEC_TABLE_WEIGHT[2]=0.5", "weight 1, found"),
        (b"$SN_CEC_TABLE_ENABLE[2]=FALSE", "switched on at the end, found"),
        (b"$MA_CEC_ENABLE[AX1]=0", "switched on at the end, found"),
        (b"$MA_ENC_COMP_ENABLE[0,AX1]=0", "switched on at the end, found"),
    ],
)
def test_a_part_program_that_weighs_or_switches_off_is_no_source_of_active_tables(
    changed, found
):
    control, profile = controller_named("siemens"), profile_of("siemens", VOLUME)
    plan = control.plan(
        curves_of(RESULT, profile.machine.functions, profile.machine.squareness_into), profile
    )
    programs = [
        file for file in control.render(plan.tables, profile) if file.name.endswith(".MPF")
    ]
    kind = b"ENC" if b"ENC" in changed else b"CEC"
    altered = [
        replace(file, data=file.data.replace(b"M30", changed + b"\nM30"))
        for file in programs
        if kind in file.name.encode() or kind == b"ENC"
    ]
    assert any(changed in file.data for file in altered)
    with pytest.raises(DataError, match=found):
        tables_in(control, altered, profile)
    assert tables_in(control, programs, profile)


def test_two_tables_of_one_name_are_two_versions_of_it():
    files, profile = written("heidenhain")
    com = [file for file in files if file.name.endswith(".COM")]
    with pytest.raises(DataError, match="each table once"):
        tables_in(
            controller_named("heidenhain"),
            [*com, replace(com[0], data=com[0].data.replace(b"+0.0030", b"+0.0031"))],
            profile,
        )
