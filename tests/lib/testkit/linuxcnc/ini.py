"""An INI file of LinuxCNC as a person changes it by the lines that an export wrote."""

from collections.abc import Mapping, Sequence

from stepdiag.exporters.linuxcnc.ini import UNLESS_NAMED

Ini = Mapping[str, Sequence[str]]
"""Lines by section."""


def changed(
    ini: Ini,
    lines: str,
    kinematics_before: str = "KINEMATICS = trivkins coordinates=XYZ",
    *,
    unnamed: Sequence[str] = (),
) -> dict[str, list[str]]:
    """Return the file after the change: - goes out, + and plain lines come in; one KINEMATICS line
    stands, the last that came.

    ``unnamed`` are COMP_FILE lines that the INI file did not hold before the export; a note may
    leave them out of both changes. Raises ValueError for a line that has to go out and is not
    there.
    """
    found, section = {name: list(each) for name, each in ini.items()}, ""
    left = set(unnamed) if f"# {UNLESS_NAMED}" in lines.splitlines() else set()
    for line in lines.splitlines():
        if line[2:] in left:
            continue
        if line.startswith("["):
            section = line
        elif line.startswith("- "):
            found[section].remove(line[2:])
        elif not line.startswith("#"):
            _put(found.setdefault(section, []), line.removeprefix("+ "), kinematics_before)
    return found


def _put(section: list[str], line: str, kinematics_before: str) -> None:
    line = kinematics_before if line == "KINEMATICS = as it was before" else line
    if line.startswith("KINEMATICS"):
        section[:] = [each for each in section if not each.startswith("KINEMATICS")]
    if line not in section:
        section.append(line)
