"""Where the process begins: the daemon's start goes past the command line, and says its refusals
all the same."""

import os
import subprocess
import sys
from importlib.metadata import files
from pathlib import Path

import pytest

from testkit.cli import joined

BEGIN = """
import sys
from importlib.metadata import files
from pathlib import Path
from stepdiag.__main__ import main
try:
    main()
finally:
    sys.stderr.write("loaded: " + str("typer" in sys.modules))
"""


def began(*arguments):
    """Run the program in a process; return how it ended, and whether the libraries of the command
    line were loaded."""
    done = subprocess.run(
        [sys.executable, "-c", BEGIN, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    return done.returncode, joined(done.stderr)


@pytest.mark.parametrize(("arguments", "loaded"), [((), False), (("--verbose",), True)])
def test_a_daemon_that_is_refused_leaves_with_the_code_of_the_cause(
    tmp_path, arguments, loaded
):
    """Both ways in: as systemd starts it, and as a person with an option does."""
    code, said = began("run", tmp_path / "none.toml", *arguments)
    assert code == 2
    assert (
        f"stepdiag: {tmp_path / 'none.toml'}: expected a survey file, found No such file or "
        "directory" in said
    )
    assert said.endswith(f"loaded: {loaded}")


def test_everything_else_is_the_command_line(tmp_path):
    code, said = began("info", tmp_path / "none.mcap")
    assert code == 2
    assert "none.mcap" in said
    assert said.endswith("loaded: True")


@pytest.mark.parametrize("name", ["solver", "daq", "exporters"])
def test_a_foreign_package_of_a_generic_name_does_no_harm(tmp_path, name):
    """The names are taken on the public index; one of them on the path must not become ours."""
    (tmp_path / f"{name}.py").write_text(
        "raise ImportError('a foreign package')\n", encoding="utf-8"
    )
    command = [
        sys.executable,
        "-c",
        "from stepdiag.__main__ import main; main()",
        "export",
        "--help",
    ]
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=120, check=False, env=environment
    )
    assert done.returncode == 0, done.stderr
    assert "--controller" in done.stdout


def test_an_installation_takes_no_generic_name():
    """What the wheel put into site-packages: one package (in an editable installation there is no
    list of files to look at)."""
    tops = {Path(file).parts[0] for file in files("stepdiag") or () if file.suffix == ".py"}
    assert tops <= {"stepdiag"} | {name for name in tops if name.startswith("_")}
