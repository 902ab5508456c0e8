"""The lines of LinuxCNC's INI file that make files act: what an export puts in and takes out, and the way back."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import ascii_lines
from stepdiag.exporters.files.naming import plain_name
from stepdiag.exporters.tables import lattice
from stepdiag.solver.errors import UsageError

NAME = "ini_lines.txt"
TYPE = "COMP_FILE_TYPE = 0"
_OUT = "# Lines with '-' go out of the INI file, lines with '+' into it, each in its section."
_BACK = "# Back to where the control was."
_BACKLASH = "# A joint without COMP_FILE uses its BACKLASH again."
_AS_BEFORE = "KINEMATICS = as it was before"


@dataclass(frozen=True, slots=True, kw_only=True)
class Naming:
    """What an INI file names: the COMP_FILE of each joint, the kinematics with its arguments, the HAL file that belongs to it."""

    comp: Mapping[int, str]
    kinematics: str = ""
    hal: str = ""

    def lines(self) -> list[tuple[str, str]]:
        """Return section and line, in the order of the file."""
        comp = [(f"[JOINT_{joint}]", line) for joint, name in self.comp.items() for line in (f"COMP_FILE = {name}", TYPE)]
        kins = [("[KINS]", f"KINEMATICS = {self.kinematics}")] if self.kinematics else []
        return comp + kins + ([("[HAL]", f"HALFILE = {self.hal}")] if self.hal else [])


def named_by(files: Sequence[ControlFile], joints: Mapping[str, Sequence[int]], axis_of: Mapping[str, str], source: str) -> Naming:
    """Return what the INI file has to name for ``files`` to act; ``axis_of`` gives the axis of each COMP_FILE by its name.

    Raises ``UsageError`` for an axis whose joints nobody has said.
    """
    comp: dict[int, str] = {}
    kinematics = hal = ""
    for file in files:
        name = plain_name(file.name)
        if b"setp matrixkins." in file.data:
            kinematics, hal = "matrixkins", name
        elif lattice.recognises(file):
            kinematics, hal = f"stepdiagkins .. lattice={name} ..", "stepdiagkins.hal"
        elif name in axis_of:
            letter = axis_of[name]
            if letter not in joints:
                raise UsageError(f"{source}: linuxcnc.joints", expected=f"the joints of {letter}", found=str(dict(joints)))
            comp |= dict.fromkeys(joints[letter], name)
    return Naming(comp=dict(sorted(comp.items())), kinematics=kinematics, hal=hal)


def change(before: Naming, after: Naming, notes: Sequence[str] = ()) -> ControlFile:
    """Return the lines that bring an INI file from one naming to another: plain lines where nothing has to go out of it."""
    old, new = before.lines(), after.lines()
    if not [line for line in old if line not in new]:
        rows = list(_sections((section, line) for section, line in new if (section, line) not in old))
    else:
        rows = [_OUT, *_changed(before, after)]
    return ControlFile(name=NAME, data=ascii_lines([*(f"# {note}" for note in notes), *rows]), role="note")


def back(before: Naming, after: Naming) -> ControlFile:
    """Return the lines that bring the INI file back from ``after`` to ``before``."""
    return ControlFile(name=NAME, data=ascii_lines([_BACK, _OUT, _BACKLASH, *_changed(after, before)]), role="note")


def _changed(before: Naming, after: Naming) -> Iterator[str]:
    """Yield what goes out and what comes in, by section; a kinematics that was there before ours comes back by its own words."""
    old, new = before.lines(), after.lines()
    if before.kinematics and not after.kinematics:
        new.append(("[KINS]", _AS_BEFORE))
    signed = [(section, f"- {line}") for section, line in old if (section, line) not in new]
    signed += [(section, f"+ {line}") for section, line in new if (section, line) not in old]
    return _sections(sorted(signed, key=lambda item: item[0] == "[HAL]" and 3 or item[0] == "[KINS]" and 2 or 1))


def _sections(lines: "Iterator[tuple[str, str]] | list[tuple[str, str]]") -> Iterator[str]:
    by_section: dict[str, list[str]] = {}
    for section, line in lines:
        by_section.setdefault(section, []).append(line)
    for section, of_section in by_section.items():
        yield section
        yield from of_section
