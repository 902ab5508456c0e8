"""A root file system of a test, and the command that makes a service of the survey in it."""

from pathlib import Path

from testkit.cli import stepdiag

SURVEY = """
[survey]
name = "mill"
machine = "m"
directory = "/var/lib/stepdiag"
[volume]
size_mm = [500, 400, 300]
increments = 10
[laser]
format = "umd"
port = "/dev/ttyUSB0"
[plc]
host = "192.168.4.20"
"""


def root_with(folder: Path, survey: str) -> Path:
    """Return a root file system with a survey file in its place."""
    (folder / "etc/stepdiag").mkdir(parents=True)
    (folder / "etc/stepdiag/mill.toml").write_text(survey, encoding="utf-8")
    return folder


def service(action: str, root: Path, *options: str, name: str = "mill") -> str:
    """Run the command; return what it says."""
    return str(
        stepdiag(
            "service", action, root / f"etc/stepdiag/{name}.toml", "--root", root, *options
        ).out
    )


def written(root: Path) -> dict[str, tuple[str, int]]:
    """Return every file below the root with its text and its time."""
    return {
        str(path.relative_to(root)): (path.read_text(), path.stat().st_mtime_ns)
        for path in sorted(root.rglob("*"))
        if path.is_file()
    }
