"""The lines of LinuxCNC's INI file that activate files, and notes with the lines to add and to
remove.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import ascii_lines
from stepdiag.exporters.files.naming import plain_name
from stepdiag.exporters.files.numbers import shortest
from stepdiag.exporters.tables import lattice

NAME = "ini_lines.txt"
COMPONENT_HAL = "stepdiagkins.hal"
_CHANGE = (
    "# Lines with '-' go out of the INI file, lines with '+' into it, each in its section."
)
_BACK = (
    "# Back to where the control was.",
    _CHANGE,
    "# A joint without COMP_FILE uses its BACKLASH again, as before.",
)
UNLESS_NAMED = (
    "The compensation was off while measuring: a COMP_FILE that the INI file did not name "
    "neither goes out nor comes back."
)
_AS_BEFORE = ("[KINS]", "KINEMATICS = as it was before")
_SCREW_NAME = re.compile(r"(?:^|[^a-z])(?P<axis>[xyz])(?:\Z|[^a-z])|(?P<last>[xyz])\Z")
Joints = Mapping[str, Sequence[int]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Naming:
    """Names in an INI file: the COMP_FILE of each joint, the kinematics module with its arguments,
    and the HAL file of an export.

    ``limits`` contains the software limits of each joint in the machine's unit, if an export
    changes them.
    """

    comp: Mapping[int, str] = field(default_factory=dict)
    kinematics: str = ""
    hal: str = ""
    limits: Mapping[int, tuple[float, float]] = field(default_factory=dict)

    def lines(self) -> list[tuple[str, str]]:
        comp = [
            (f"[JOINT_{joint}]", line)
            for joint, name in sorted(self.comp.items())
            for line in (f"COMP_FILE = {name}", "COMP_FILE_TYPE = 0")
        ]
        kins = [
            ("[KINS]", f"KINEMATICS = {self.kinematics}"),
            ("[HAL]", f"HALFILE = {self.hal}"),
        ]
        limits = [
            (f"[JOINT_{joint}]", f"{end}_LIMIT = {shortest(limit)}")
            for joint, ends in sorted(self.limits.items())
            for end, limit in zip(("MIN", "MAX"), ends, strict=True)
        ]
        return comp + limits + (kins if self.kinematics else [])


def axis_in(name: str) -> str | None:
    """Return the axis in a file name such as ``screw_x.comp`` or ``screwcompX.dat``; None for a
    name without an axis.
    """
    match = _SCREW_NAME.search(name.rpartition(".")[0].lower())
    return (match["axis"] or match["last"]).upper() if match else None


def coordinates(joints: Joints, source: str) -> str:
    """Return the axis letters of the joints in order, such as ``XYYZ``. Raises ``UsageError`` if a
    joint has no letter or two letters.
    """
    letters = {joint: letter for letter, each in joints.items() for joint in each}
    numbers = sorted(joint for each in joints.values() for joint in each)
    if numbers != list(range(len(numbers))) or not all(
        joints.get(letter) for letter in "XYZ"
    ):
        raise UsageError(
            f"{source}: linuxcnc.joints",
            expected=message("joints-all"),
            found=str({letter: list(each) for letter, each in joints.items()}),
        )
    return "".join(letters[number] for number in numbers)


def named_by(
    files: Iterable[ControlFile],
    joints: Joints,
    *,
    inch: bool,
    source: str,
    over: Naming | None = None,
) -> Naming:
    """Return the names in the INI file that activate ``files``. The names ``over``, which the INI
    file has already, are kept, unless ``files`` contain a lattice.

    Raises ``UsageError`` for an axis without joints in the profile.
    """
    named = over or Naming()
    for file in files:
        name = plain_name(file.name)
        if lattice.recognises(file):
            vertices = lattice.parse(file).vectors_um[..., 0].size
            unit = " inch=1" if inch else ""
            words = (
                f"stepdiagkins coordinates={coordinates(joints, source)} lattice={name} "
                f"vertices={vertices}{unit}"
            )
            return Naming(kinematics=words, hal=COMPONENT_HAL)
        if b"setp matrixkins." in file.data:
            named = Naming(comp=named.comp, kinematics="matrixkins", hal=name)
        elif (letter := axis_in(name)) is not None:
            if letter not in joints:
                raise UsageError(
                    f"{source}: linuxcnc.joints",
                    expected=message("joints-of", letter=letter),
                    found=str(dict(joints)),
                )
            named = Naming(
                comp={**named.comp, **dict.fromkeys(joints[letter], name)},
                kinematics=named.kinematics,
                hal=named.hal,
            )
    return named


def change(before: Naming, after: Naming, notes: Sequence[str] = ()) -> ControlFile:
    """Return a note with the lines that change an INI file from the names ``before`` to ``after``.
    If no line has to be removed, the note contains only the new lines.
    """
    old, new = before.lines(), after.lines()
    rows = (
        [_CHANGE, *_changed(before, after)]
        if any(line not in new for line in old)
        else list(_sections(new))
    )
    return ControlFile(
        name=NAME, data=ascii_lines([*(f"# {note}" for note in notes), *rows]), role="note"
    )


def back(before: Naming, after: Naming, notes: Sequence[str] = ()) -> ControlFile:
    rows = [*_BACK, *(f"# {note}" for note in notes), *_changed(after, before)]
    return ControlFile(name=NAME, data=ascii_lines(rows), role="note")


def unless_named(before: Naming, measured_with: str) -> tuple[str, ...]:
    """Return a remark if the machine's own COMP_FILEs were inactive during the measurement: the INI
    file then need not contain their names.
    """
    return (UNLESS_NAMED,) if before.comp and measured_with == "off" else ()


def _changed(before: Naming, after: Naming) -> Iterator[str]:
    """Yield the lines to remove and to add, section by section. If the INI file named kinematics of
    another program, a line asks the user to restore the old entry.
    """
    old, new = before.lines(), after.lines()
    new += [_AS_BEFORE] if before.kinematics and not after.kinematics else []
    signed = [(section, f"- {line}") for section, line in old if (section, line) not in new]
    signed += [(section, f"+ {line}") for section, line in new if (section, line) not in old]
    return _sections(signed)


def _sections(lines: Iterable[tuple[str, str]]) -> Iterator[str]:
    by_section: dict[str, list[str]] = {}
    for section, line in lines:
        by_section.setdefault(section, []).append(line)
    for section, of_section in by_section.items():
        yield from (section, *of_section)
