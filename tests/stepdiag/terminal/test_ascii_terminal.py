"""A terminal that has ASCII alone: what a command has to say is said as UTF-8, which loses nothing,
or refused in words; no traceback."""

import os
import sys
import traceback
from pathlib import Path

import pytest

from stepdiag.cli.app import main as command_line
from testkit.examples import spread
from testkit.hostile.door import Door
from testkit.hostile.doors import doors

FOREIGN = "Fräse 7 \u4e09\u8ef8 \u2713"
"""A machine's name, as a person may write it."""
COMMANDS = {
    "init": ("init", "new.toml"),
    "profile": ("profile", "siemens", "--out", "p.toml"),
    "publish": ("publish", "--schema"),
    "help": ("--help",),
    "help of a command": ("solve", "--help"),
    "what there is not": ("solve", "\u4e09.csv"),
} | {
    f"{command[0]} help": (*command, "--help")
    for command in (("check",), ("setup",), ("fleet",), ("trend",), ("demo",), ("begin",))
}
DOORS = {
    " ".join(word for word in door.command[:2] if word.isalpha()): door
    for door in doors().values()
    if door.reads is None
}
"""One door a command that is given files."""


@pytest.mark.parametrize("name", spread([*DOORS], 2))
def test_a_command_with_files_ends_as_it_does_on_any_terminal(
    name: str, tmp_path: Path
) -> None:
    """With texts in its files that the terminal has no letters for, where there are any."""
    door = DOORS[name]
    text = door.files[door.wrong].replace('machine = "virtual"', f'machine = "{FOREIGN}"')
    code, said = on_ascii(door.with_text(text), tmp_path)
    assert code in {0, 2, 3, 5}, said
    assert b"Traceback" not in said
    assert said.decode("utf-8")


@pytest.mark.parametrize("name", spread([*COMMANDS], 2))
def test_a_command_without_files_too(name: str, tmp_path: Path) -> None:
    code, said = on_ascii(Door(COMMANDS[name], {}, "", lambda text, _: text), tmp_path)
    assert code in {0, 2}, said
    assert b"Traceback" not in said
    assert said.decode("utf-8")


def on_ascii(door: Door, folder: Path, encoding: str = "ascii") -> tuple[int, bytes]:
    """Run a command in a copy of this process whose output takes ASCII alone; return its exit code
    and all that was said."""
    door.place(folder)
    child = os.fork()
    if child == 0:
        code = 70
        try:
            code = _entered(door, folder, encoding)
        finally:
            os._exit(code)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    return code, (folder / "said").read_bytes()


def _entered(door: Door, folder: Path, encoding: str) -> int:
    """Go in where the program begins, with the streams that Python makes for LC_ALL=C: refusals may
    always be written."""
    said = os.open(folder / "said", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(said, 1)
    os.dup2(said, 2)
    sys.stdout = open(1, "w", encoding=encoding, errors="strict", closefd=False)  # noqa: SIM115 - a descriptor, for ever
    sys.stderr = open(2, "w", encoding=encoding, errors="backslashreplace", closefd=False)  # noqa: SIM115
    sys.argv = ["stepdiag", *door.command]
    os.chdir(folder)
    try:
        command_line()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 0
    except BaseException:  # noqa: BLE001 - what the entry lets through
        traceback.print_exc()
        return 70
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
    return 0


@pytest.mark.parametrize("encoding", ["ascii", "iso8859-2", "koi8-r"])
def test_a_terminal_without_the_micrometre_sign_shows_um(
    encoding: str, tmp_path: Path
) -> None:
    door = Door(("fourdof", "calibrate", "--help"), {}, "", lambda text, _: text)
    code, shown = on_ascii(door, tmp_path, encoding)
    assert code == 0, shown
    assert b"(um or arc-seconds)" in b" ".join(shown.split())
    _, shown = on_ascii(door, tmp_path, "utf-8")
    assert "(µm or arc-seconds)" in " ".join(shown.decode().split())
