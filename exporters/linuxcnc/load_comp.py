#!/usr/bin/python3
"""load_comp: load the COMP_FILEs of this folder into a LinuxCNC configuration, or restore the
earlier ones.

    /usr/bin/python3 load_comp.py MACHINE.ini
    /usr/bin/python3 load_comp.py MACHINE.ini --restore

The script writes nothing unless each COMP_FILE that the INI file names contains the rows of the
machine's own file (_RESTORE in this folder) or of the new file. The first run copies the original
INI file to MACHINE.ini.before. Lines outside [JOINT_n] must be changed by hand. LinuxCNC reads all
these files at its start. The script needs only the control's own Python.
"""

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

KEYS = ("COMP_FILE", "COMP_FILE_TYPE")
NOT_NAMED = "neither goes out nor comes back"
"""Text in ini_lines.txt if the old tables were inactive: the INI file then need not name these
tables.
"""
Rows = list[tuple[float, ...]]
Settings = dict[tuple[str, str], str]
"""Values of an INI file by section and key."""


def rows(path: Path) -> Rows:
    """Return the rows of a COMP_FILE as the control reads them: the first line without three
    numbers ends the file. Return no rows without a file.
    """
    found: Rows = []
    if path.is_file():
        for line in path.read_text(encoding="ascii", errors="replace").splitlines():
            try:
                first, ahead, back = (float(word) for word in line.split()[:3])
            except ValueError:
                break
            found.append((first, ahead, back))
    return found


def restoring(name: str) -> str:
    """Return the name of the file that restores a COMP_FILE."""
    stem, _, ending = name.rpartition(".")
    return f"{stem}_RESTORE.{ending}"


def settings(text: str) -> Iterator[tuple[str, str, str]]:
    """Yield section, key and value of each line of an INI file or of ini_lines.txt, where + or - is
    part of the key.
    """
    section = ""
    for line in (each.strip() for each in text.splitlines()):
        if line.startswith("["):
            section = line.partition("]")[0] + "]"
        elif "=" in line and line[0] not in "#;":
            key, _, value = line.partition("=")
            yield section, key.strip(), value.strip()


def changes(text: str) -> tuple[Settings, Settings]:
    """Return the lines to remove from the INI file and the lines to add, only those in sections of
    joints.
    """
    out: Settings = {}
    into: Settings = {}
    for section, signed, value in settings(text):
        key = signed.lstrip("+- ")
        if key in KEYS and section.startswith("[JOINT_"):
            (out if signed.startswith("-") else into)[section, key] = value
    return out, into


def refusals(ini: Path, folder: Path, text: str) -> Iterator[str]:
    """Yield the reasons not to load: every difference between the configuration and the contents
    that the export assumes.
    """
    if not text:
        yield "no ini_lines.txt in this folder: make the sign test first, then export again"
    held = {(section, key): value for section, key, value in settings(ini.read_text("utf-8"))}
    out, into = changes(text)
    for (section, key), new in into.items():
        if key == "COMP_FILE" and not (folder / new).is_file():
            yield f"{new} is not in this folder"
        if key == "COMP_FILE" and not any(each == section for each, _ in held):
            yield f"{ini.name} has no section {section}"
    named = {section: value for (section, key), value in held.items() if key == "COMP_FILE"}
    for section, name in named.items():
        new = into.get((section, "COMP_FILE"), "")
        there = rows(ini.parent / name)
        own = [rows(folder / restoring(name))] + ([rows(folder / new)] if name == new else [])
        if held.get((section, "COMP_FILE_TYPE"), "0") != "0":
            yield f"{section} has COMP_FILE_TYPE 1: the export takes type 0 for held"
        elif not there or there not in own:
            yield f"{section} names {name}, whose rows are not those of machine.existing"
    for (section, key), new in into.items():
        old = out.get((section, key), new)
        expected = key == "COMP_FILE" and (folder / restoring(old)).is_file()
        if expected and section not in named and NOT_NAMED not in text:
            yield f"{section} names no COMP_FILE, and {old} acted while the machine was measured"


def changed(text: str, out: Settings, into: Settings) -> str:
    """Return the text of an INI file with the settings of its joints changed."""
    lines: list[str] = []
    section = ""
    for line in text.splitlines():
        if line.strip().startswith("["):
            section = line.strip().partition("]")[0] + "]"
            lines.append(line)
            lines += [
                f"{key} = {value}" for (at, key), value in into.items() if at == section
            ]
        elif (section, line.partition("=")[0].strip()) not in {*out, *into}:
            lines.append(line)
    return "\n".join([*lines, ""])


def main(words: list[str]) -> int:
    """Load or restore the COMP_FILEs; return 1 if nothing is written."""
    folder, ini, back = Path(__file__).parent, Path(words[0]), "--restore" in words
    lines = folder / f"ini_lines{'_RESTORE' if back else ''}.txt"
    text = lines.read_text(encoding="ascii") if lines.is_file() else ""
    reasons = [] if back else list(refusals(ini, folder, text))
    for reason in reasons:
        sys.stderr.write(f"{reason}\n")
    if reasons:
        sys.stderr.write("Nothing is written.\n")
        return 1
    kept = ini.with_name(f"{ini.name}.before")
    if not kept.exists():
        shutil.copyfile(ini, kept)
    out, into = changes(text)
    names = {value for (_, key), value in into.items() if key == "COMP_FILE"}
    if back:
        old = {path.name.replace("_RESTORE", "") for path in folder.glob("*_RESTORE.comp")}
        for name in names | old:
            shutil.copyfile(folder / restoring(name), ini.parent / name)
    else:
        for name in names:
            shutil.copyfile(folder / name, ini.parent / name)
    ini.write_text(changed(ini.read_text("utf-8"), out, into), encoding="utf-8")
    sys.stdout.write(f"{ini} is changed: restart LinuxCNC, home all axes.\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
