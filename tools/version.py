"""The version that a wheel carries: the release of pyproject.toml, and the commit that it was built
from."""

import subprocess
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def whole() -> str:
    """Return the release, as a local version with the commit and whether files differ from it (PEP
    440); without git the release alone."""
    release = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"][
        "stepdiag"
    ]["release"]
    commit = _git("rev-parse", "--short=9", "HEAD")
    if not commit or Path(_git("rev-parse", "--show-toplevel")).resolve() != ROOT:
        return release
    return f"{release}+g{commit}" + (
        ".changed" if _git("status", "--porcelain", "--untracked-files=no") else ""
    )


def _git(*arguments: str) -> str:
    try:
        asked = subprocess.run(
            ["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=False
        )
    except FileNotFoundError:
        return ""
    return asked.stdout.strip() if asked.returncode == 0 else ""
