"""What is released: a wheel that comes out the same each time, and what somebody needs who wants to
check it."""

import hashlib
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

pytestmark = pytest.mark.system

CHECKOUT = Path(__file__).parents[3]


def test_what_builds_the_wheel_is_locked_by_hash():
    """The build backend of pyproject.toml and everything that it pulls in."""
    wanted = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["build-system"][
        "requires"
    ]
    locked = (CHECKOUT / "tools/build.txt").read_text()
    entries = re.findall(
        r"^(\S+==\S+) \\\n((?:    --hash=sha256:[0-9a-f]{64}(?: \\)?\n)+)",
        locked,
        flags=re.MULTILINE,
    )
    assert set(wanted) <= {name for name, _ in entries}
    assert len(entries) == locked.count("==")


def test_nothing_younger_than_two_weeks_is_taken():
    assert (
        tomllib.loads((CHECKOUT / "uv.lock").read_text())["options"]["exclude-newer-span"]
        == "P2W"
    )


def test_the_floors_of_the_dependencies_follow_the_lock():
    """Who installs the wheel without the lock gets no version with an advisory that the lock is
    past."""
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())
    locked = {
        each["name"]: each.get("version")
        for each in tomllib.loads((CHECKOUT / "uv.lock").read_text())["package"]
    }
    groups = [
        project["project"]["dependencies"],
        *project["project"]["optional-dependencies"].values(),
        *project["dependency-groups"].values(),
    ]
    floors = dict(
        re.match(r"([a-z0-9-]+)>=([0-9.]+)", each).groups()
        for group in groups
        for each in group
    )
    assert floors == {name: locked[name] for name in floors}
    assert {"starlette", "pyarrow"} <= floors.keys()


def test_every_file_of_a_release_is_in_its_sums(tmp_path):
    """Whatever came later, too: a package beside the wheel. A signature of the sums is none of
    them."""
    names = {"stepdiag-1.whl", "stepdiag_1_amd64.deb", "a name with blanks", "LICENSE"}
    for name in sorted(names):
        (tmp_path / name).write_text(name)
        subprocess.run([CHECKOUT / "tools/sums", tmp_path], check=True)
    (tmp_path / "SHA256SUMS.asc").write_text("signature")
    (tmp_path / "wheel").mkdir()
    subprocess.run([CHECKOUT / "tools/sums", tmp_path], check=True)
    assert {
        line.split("  ")[1] for line in (tmp_path / "SHA256SUMS").read_text().splitlines()
    } == names
    subprocess.run(
        ["sha256sum", "--check", "--strict", "SHA256SUMS"],
        cwd=tmp_path,
        check=True,
        capture_output=True,
    )


def test_every_library_is_listed_with_its_licence():
    """As the tool writes it now: a library that is new in the lock is new in the list."""
    command = [sys.executable, CHECKOUT / "tools/licences", CHECKOUT / "uv.lock"]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert told in (CHECKOUT / "docs/licences.md").read_text()
    assert "not stated" not in told
    assert "not installed" not in told


@pytest.mark.timeout(600)
def test_a_release_can_be_checked(tmp_path):
    """Wheel (built twice, the same), requirements with hashes, bill of materials, licences, and the
    hash of each."""
    out = tmp_path / "release"
    made = subprocess.run(
        ["make", "-C", CHECKOUT, "release", f"RELEASE={out}"],
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert made.returncode == 0, made.stderr
    hashes = dict(
        reversed(line.split("  ")) for line in (out / "SHA256SUMS").read_text().splitlines()
    )
    assert {
        name: hashlib.sha256((out / name).read_bytes()).hexdigest() for name in hashes
    } == hashes
    assert {path.name for path in out.iterdir()} == {*hashes, "SHA256SUMS"}
    bill = json.loads((out / "sbom.cdx.json").read_text())
    assert bill["bomFormat"] == "CycloneDX"
    listed = {
        line.split(" | ")[0].strip("| ")
        for line in (out / "LICENCES.md").read_text().splitlines()[2:]
    }
    assert listed <= {each["name"] for each in bill["components"]}
    assert all(
        "--hash=sha256:" in part
        for part in re.split(r"\n(?=\S+==)", (out / "requirements.txt").read_text())[1:]
    )
