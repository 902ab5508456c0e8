"""Reads and checks the profile of a machine, and makes the assumed profile of an export without a
profile.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from stepdiag.base.errors import SafetyError, UsageError
from stepdiag.base.files import (
    LARGEST_SETTINGS_BYTES,
    LARGEST_TABLE_BYTES,
    as_text,
    read_bytes,
)
from stepdiag.base.messages import message
from stepdiag.base.result.result import AXIS_LETTERS
from stepdiag.base.settings import convert, nearest, read_toml, require_answers
from stepdiag.base.volume import Volume
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.programs.settings import SECTION as PROGRAM
from stepdiag.exporters.programs.settings import ProgramSection
from stepdiag.exporters.tables.controller import Controller
from stepdiag.exporters.tables.curves import FUNCTIONS
from stepdiag.exporters.tables.profile import (
    MOST_EXISTING,
    AxisSection,
    LimitsSection,
    MachineSection,
    Profile,
    SignTestRecord,
)


class _Common(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    machine: MachineSection
    axes: dict[Literal["X", "Y", "Z"], AxisSection]
    limits: LimitsSection = LimitsSection()
    sign_test: list[SignTestRecord] = []
    program: ProgramSection = ProgramSection()


def parse_profile(
    text: str,
    source: str,
    controller: Controller,
    volume: Volume | None,
    files: Mapping[str, bytes] | None = None,
) -> Profile:
    """Return the profile in a TOML text. ``files`` contains the bytes of the files in
    ``machine.existing``.

    If an axis has no start or no end, the table extends to this end of the measured ``volume``.
    Without a volume (a sign test before the first survey) the profile must contain start and end.
    Raises ``UsageError`` for a wrong profile.
    """
    tables = read_toml(text, source)
    _refuse_unknown_sections(tables, controller, source)
    require_answers(tables, source)
    section = tables.pop(controller.name, {})
    common = convert(tables, _Common, source)
    _refuse_unknown_kinds(common.sign_test, controller, source)
    return Profile(
        machine=common.machine,
        axes={
            letter: _ends_from(common.axes[letter], volume, index)
            for index, letter in enumerate(AXIS_LETTERS)
            if letter in common.axes
        },
        limits=common.limits,
        sign_tests=tuple(common.sign_test),
        options=convert(section, controller.options, source, controller.name),
        existing=_existing(common.machine, files or {}, source),
        source=source,
    )


def load_profile(path: Path, controller: Controller, volume: Volume | None) -> Profile:
    """Return the profile in the file ``path`` (`parse_profile`). The machine's own files in the
    profile are in the same folder.
    """
    text = read_profile_text(path)
    machine = read_toml(text, path.name).get("machine", {})
    named = machine.get("existing", []) if isinstance(machine, dict) else []
    field = f"{path.name}: machine.existing"
    files = {
        name: read_bytes(
            path.parent / name,
            field,
            largest=LARGEST_TABLE_BYTES,
            expected=message("readable-file-of", name=name),
            blame=UsageError,
        )
        for name in (named[:MOST_EXISTING] if isinstance(named, list) else [])
        if isinstance(name, str)
    }
    return parse_profile(text, path.name, controller, volume, files)


def read_profile_text(path: Path) -> str:
    """Return the text of a profile file. Raises ``UsageError`` for a file that is unreadable, too
    large, or not UTF-8.
    """
    data = read_bytes(
        path,
        largest=LARGEST_SETTINGS_BYTES,
        expected=message("readable-profile"),
        blame=UsageError,
    )
    return as_text(data, str(path), UsageError)


def quick_profile(
    controller: Controller, volume: Volume, step_mm: float | Sequence[float] | None = None
) -> Profile:
    """Return the assumed profile of an export without a profile: axes AX1 AX2 AX3, tables from the
    low to the high end of the volume, reference at the low end.

    ``step_mm`` is one step for all axes, or one per axis; None means the steps of the volume. An
    axis that did not travel has no table.
    """
    steps_mm = np.broadcast_to(
        volume.step_mm if step_mm is None else step_mm, len(AXIS_LETTERS)
    )
    axes = {
        letter: AxisSection(
            name=f"AX{index + 1}",
            step_mm=float(steps_mm[index]),
            reference_mm=volume.origin_mm[index],
            start_mm=volume.origin_mm[index],
            end_mm=volume.origin_mm[index] + volume.size_mm[index],
        )
        for index, letter in enumerate(AXIS_LETTERS)
        if volume.travelled[index]
    }
    functions = [name for name in FUNCTIONS if name[-1] in axes]
    return Profile(
        machine=MachineSection(
            name="machine without a profile",
            controller=controller.name,
            measured_with="off",
            functions=functions,
        ),
        axes=axes,
        limits=LimitsSection(),
        sign_tests=(),
        options=controller.quick_options(),
        assumed=True,
        source="no profile" if step_mm is None else "--step-mm",
    )


def _refuse_unknown_sections(
    tables: dict[str, Any], controller: Controller, source: str
) -> None:
    """Raise UsageError for an unknown section of the profile, with the nearest name. A section of
    another control shows that the profile is for that control.
    """
    machine = tables.get("machine", {})
    named = (
        machine.get("controller", controller.name)
        if isinstance(machine, dict)
        else controller.name
    )
    if named != controller.name:
        raise UsageError(
            f"{source}: machine.controller", expected=controller.name, found=str(named)
        )
    known = ["machine", "axes", "limits", "sign_test", PROGRAM, controller.name]
    for key in tables:
        if key not in known:
            raise UsageError(
                f"{source}: {key}",
                expected=message("known-section"),
                found=key,
                remedy=nearest(key, known),
            )


def _refuse_unknown_kinds(
    records: Sequence[SignTestRecord], controller: Controller, source: str
) -> None:
    """Raise UsageError for a sign test of a kind of table that the control does not have. The sign
    test of an unknown kind would prove nothing.
    """
    for index, record in enumerate(records):
        if record.kind not in controller.kinds:
            expected = " or ".join(controller.kinds)
            raise UsageError(
                f"{source}: sign_test[{index}].kind",
                expected=expected,
                found=f'"{record.kind}"',
                remedy=message("signtest-prints-record"),
            )


def _ends_from(axis: AxisSection, volume: Volume | None, index: int) -> AxisSection:
    if volume is None:
        return axis
    low = volume.origin_mm[index]
    high = low + volume.size_mm[index]
    return msgspec.structs.replace(
        axis,
        start_mm=low if axis.start_mm is None else axis.start_mm,
        end_mm=high if axis.end_mm is None else axis.end_mm,
    )


def _existing(
    machine: MachineSection, files: Mapping[str, bytes], source: str
) -> tuple[ControlFile, ...]:
    missing = [name for name in machine.existing if name not in files]
    if missing:
        raise UsageError(
            f"{source}: machine.existing",
            expected=message("files-readable"),
            found=", ".join(missing),
        )
    if machine.measured_with == "on" and not machine.existing:
        raise SafetyError(
            f"{source}: machine.existing",
            code="active-table-unfit.unknown",
            expected=message("active-files"),
            found=message("nothing"),
            remedy=message("back-up"),
        )
    return tuple(
        ControlFile(name=Path(name).name, data=files[name]) for name in machine.existing
    )
