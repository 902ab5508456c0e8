"""The Debian packages: what is in them, bare Debians 12 and 13 that install, use and remove them,
and arm64 under qemu."""

import os
import re
import shutil
import struct
import subprocess
from pathlib import Path

import pytest

from stepdiag.virtual.base.reserved import reserved_port
from testkit.exact.surveys import DATA
from testkit.installing import SURVEY
from testkit.running.boot import CHECKOUT, as_root, booted, built_wheel, debian_root, write

pytestmark = [pytest.mark.system, pytest.mark.timeout(600)]

ACCOUNTS = ("stepdiag", "stepdiag-page", "stepdiag-publish")
MACHINES = {"amd64": 62, "arm64": 183}
"""``e_machine`` of an ELF file (elf.h): EM_X86_64, EM_AARCH64."""


PYTHONS = {"bookworm": "3.11", "trixie": "3.13"}
HOST = subprocess.run(
    ["dpkg", "--print-architecture"], capture_output=True, text=True, check=True
).stdout.strip()
EVERY = [("amd64", "bookworm"), ("arm64", "bookworm"), ("amd64", "trixie")]
INSTALLED = [(HOST, "bookworm"), (HOST, "trixie")]
"""Each of them is booted or used by one of two tests: the scripts of the package are the same."""


@pytest.fixture(scope="module")
def package(request, tmp_path_factory):
    """A package, built as `make deb` builds it by a user whose files everybody may write:
    architecture, system and file."""
    folder = tmp_path_factory.mktemp("-".join(request.param))
    architecture, suite = request.param
    made = ["tools/deb", built_wheel(folder), architecture, folder, suite]
    done = subprocess.run(
        [*map(str, made)],
        cwd=CHECKOUT,
        capture_output=True,
        text=True,
        timeout=500,
        check=False,
        umask=0,
    )
    assert done.returncode == 0, done.stderr
    return architecture, suite, Path(done.stdout.strip())


@pytest.fixture(scope="module")
def held(package, tmp_path_factory):
    """What a package installs, unpacked once; no test writes to it."""
    folder = tmp_path_factory.mktemp("held")
    subprocess.run(["dpkg-deb", "--extract", package[2], folder], check=True)
    return folder


def fields(file):
    said = subprocess.run(
        ["dpkg-deb", "--field", file], capture_output=True, text=True, check=True
    ).stdout
    return dict(line.split(": ", 1) for line in said.splitlines() if not line.startswith(" "))


def readme_lines():
    """Return what the README says: how this package is installed, what is done with readings from
    elsewhere, and the same from Python."""
    text = (CHECKOUT / "README.md").read_text(encoding="utf-8")
    install = (
        re.search(r"`(apt install [^`]+)\+deb12_amd64\.deb`", text)[1] + f"+deb*_{HOST}.deb"
    )
    section = text.partition("## Data from elsewhere")[2].partition("## ")[0]
    shell, python = (
        re.findall(r"(?m)^    (.+)$", part)
        for part in section.split("The same steps in Python:")
    )
    assert all(line.startswith(".venv/bin/stepdiag ") for line in shell)
    return install, [line.removeprefix(".venv/bin/") for line in shell], "\n".join(python)


@pytest.mark.parametrize("package", EVERY, indirect=True)
def test_a_package_says_what_it_is_and_holds_it(package, held):
    """Every library of native code is of the package's architecture and Python; nothing of the
    builder's folders is in it."""
    architecture, suite, file = package
    python = f"python{PYTHONS[suite]}"
    said = fields(file)
    assert (said["Package"], said["Architecture"]) == ("stepdiag", architecture)
    assert said["Depends"].startswith(f"{python},")
    packages = held / f"opt/stepdiag/lib/{python}/site-packages"
    native = [path for path in packages.rglob("*.so*") if path.is_file()]
    machines = {struct.unpack("<H", path.read_bytes()[18:20])[0] for path in native}
    assert machines == {MACHINES[architecture]}
    assert {"stepdiag", "numpy", "pymodbus", "mcap"} <= {
        path.name for path in packages.iterdir()
    }
    tags = {
        found[1] for path in native if (found := re.search(r"\.(cpython-3\d+)-", path.name))
    }
    assert tags == {python.replace("python", "cpython-").replace(".", "")}
    assert list(packages.rglob("*.pyc")) == [], "the system's own Python compiles it"
    assert (held / "opt/stepdiag/share/stepdiag/systemd/stepdiag@.service").exists()
    assert "Apache" in (held / "usr/share/doc/stepdiag/copyright").read_text(encoding="utf-8")
    texts = [
        path
        for folder in ("bin", "share")
        for path in (held / "opt/stepdiag" / folder).rglob("*")
        if path.is_file()
    ]
    assert not [
        path
        for path in texts
        if not path.is_symlink() and str(CHECKOUT).encode() in path.read_bytes()
    ]


@pytest.mark.parametrize("package", EVERY, indirect=True)
def test_nobody_but_root_may_write_what_a_package_installs(package):
    """And no lock of who built it is in it; the sums beside it name it."""
    *_, file = package
    listed = subprocess.run(
        ["dpkg-deb", "--contents", file], capture_output=True, text=True, check=True
    ).stdout.splitlines()
    rows = [
        (mode, owner, path)
        for mode, owner, _, _, _, path in (line.split(maxsplit=5) for line in listed)
    ]
    assert [
        row for row in rows if row[0][0] != "l" and (row[0][5], row[0][8]) != ("-", "-")
    ] == [], "writable by others"
    assert {row[1] for row in rows} == {"root/root"}
    assert [path for *_, path in rows if path.endswith(".lock")] == []
    assert file.name in (file.parent / "SHA256SUMS").read_text()


@pytest.mark.parametrize("package", INSTALLED[1:], indirect=True)
def test_a_bare_debian_installs_it_uses_it_and_is_rid_of_it(package):
    """By the README's own lines: installed, from readings to files and report, from Python; Tab
    completion, the files of a service.

    Afterwards nothing is left but what was measured.
    """
    _, suite, file = package
    root = debian_root(suite)

    def inside(*command, check=True):
        return as_root("chroot", root, *command, check=check)

    readme = root / "tmp/readme"
    as_root("rm", "-rf", readme)
    as_root("install", "-d", readme / "release")
    as_root("cp", file, readme / "release")
    as_root("cp", DATA / "golden_stepdiag_rigidbody_FXYZ.csv", readme / "readings.csv")
    left = [
        path
        for name in ("system/stepdiag@*", "system/*.wants/stepdiag@*")
        for path in (root / "etc/systemd").glob(name)
    ]
    as_root(
        "rm", "-rf", root / "opt/stepdiag", *left, root / "etc/udev/rules.d/90-stepdiag.rules"
    )  # what the test of the boot has left
    install, elsewhere, python = readme_lines()
    inside("sh", "-ec", f"cd /tmp/readme; {install}")
    try:
        before = set(inside("find", "/opt/stepdiag", "-name", "*.pyc").split())
        assert inside("stepdiag", "--version").startswith("stepdiag ")
        for line in elsewhere:
            inside("sh", "-ec", f"cd /tmp/readme; {line}")
        assert "C0Y" in (readme / "report.html").read_text(encoding="utf-8")
        assert (readme / "files/SHA256SUMS").is_file()
        inside("sh", "-ec", f"cd /tmp/readme; /opt/stepdiag/bin/python -c '{python}'")
        assert (readme / "python-files/SHA256SUMS").is_file()
        inside("mkdir", "--parents", "/etc/stepdiag")
        inside("stepdiag", "init", "/etc/stepdiag/deb-test.toml")
        unit = inside(
            "stepdiag", "service", "install", "/etc/stepdiag/deb-test.toml", "--dry-run"
        )
        assert "stepdiag@deb-test.service.d" in unit
        assert "ExecStart=/opt/stepdiag/bin/stepdiag" in inside(
            "cat", "/usr/lib/systemd/system/stepdiag@.service"
        )
        completion = "/usr/share/bash-completion/completions/stepdiag"
        shell = (
            f". {completion}; COMP_WORDS=(stepdiag exp); COMP_CWORD=1; _stepdiag; echo "
            f"${{COMPREPLY[@]}}"
        )
        assert inside("bash", "-c", shell).split() == ["export"]
        assert set(inside("find", "/opt/stepdiag", "-name", "*.pyc").split()) == before, (
            "everything was compiled already"
        )
    finally:
        inside("dpkg", "--remove", "stepdiag")
        as_root("rm", "-rf", readme, root / "etc/stepdiag/deb-test.toml")
    assert not (root / "opt/stepdiag").exists()
    assert not (root / "usr/bin/stepdiag").is_symlink()


@pytest.mark.parametrize("package", INSTALLED[:1], indirect=True)
def test_a_package_is_not_exchanged_under_a_recorder_and_leaves_what_was_measured(package):
    """Under a real systemd: installed, used, upgraded while a recorder runs (refused) and after it,
    removed, purged."""
    _, suite, file = package
    root = debian_root(suite)
    survey, log = (
        root / "etc/stepdiag/mill.toml",
        root / "var/lib/private/stepdiag/mill/0001/0001.mcap",
    )
    old = root / "etc/systemd/system/stepdiag@.service"
    for each in (
        *root.glob("etc/systemd/system/stepdiag*"),
        *root.glob("etc/systemd/system/*.wants/stepdiag*"),
    ):
        as_root("rm", "-rf", each)  # what the test of the boot has left
    as_root(
        "rm",
        "-rf",
        root / "opt/stepdiag",
        root / "etc/stepdiag",
        root / "var/lib/private/stepdiag",
    )
    as_root(
        "install", "-d", root / "opt"
    )  # a package that is removed takes an empty one with it
    as_root("cp", file, root / "opt/stepdiag.deb")
    as_root("cp", DATA / "golden_stepdiag_rigidbody_FXYZ.csv", root / "opt/readings.csv")
    try:
        with booted(root, "stepdiag-deb-test") as system:
            install = ("dpkg", "--install", "/opt/stepdiag.deb")
            system.run(*install)
            assert [system.run("id", "-un", name).strip() for name in ACCOUNTS] == list(
                ACCOUNTS
            )
            assert "C0Y" in system.run("stepdiag", "solve", "/opt/readings.csv")
            # the usual one may be that of another test's page
            text = f"{SURVEY}\n[page]\nport = {reserved_port()}\n"
            write(survey, text)
            write(old, "a copy of an older version\n")
            system.run("stepdiag", "service", "install", "/etc/stepdiag/mill.toml")
            assert not old.exists(), "it would hide the package's unit for ever"
            written = {path.name for path in root.glob("etc/systemd/system/stepdiag*")}
            assert written == {
                "stepdiag@mill.service.d",
                "stepdiag-page@mill.service.d",
                "stepdiag-page@mill.socket.d",
            }
            system.run("systemctl", "daemon-reload")
            system.run("systemctl", "enable", "--now", "stepdiag-page@mill.socket")
            for extra in (
                "snap7",
                "pyLSV2",
                "aiomqtt",
                "asyncua",
                "pyarrow",
                "distributed",
                "signxml",
            ):
                system.run("/opt/stepdiag/bin/python", "-c", f"import {extra}")

            system.run(
                "systemctl", "start", "stepdiag@mill.service"
            )  # without its instruments: that is a state, no failure
            refused = system.run(*install, check=False)
            assert (
                system.run("systemctl", "is-active", "stepdiag@mill.service").strip()
                == "active"
            )
            assert (
                system.run("dpkg-query", "--show", "--showformat=${Status}", "stepdiag")
                == "install ok installed"
            ), refused
            system.run("systemctl", "stop", "stepdiag@mill.service")
            system.run(*install)

            write(log, "measured")
            system.run("dpkg", "--remove", "stepdiag")
            assert (
                system.run(
                    "systemctl", "is-active", "stepdiag-page@mill.socket", check=False
                ).strip()
                == "inactive"
            )
            assert list(root.glob("etc/systemd/system/*.wants/stepdiag*")) == []
            told = system.run("dpkg", "--purge", "stepdiag")
            assert "/var/lib/private/stepdiag stays" in told
            assert list(root.glob("etc/systemd/system/stepdiag*")) == []
            assert (log.read_text(), survey.read_text()) == ("measured", text)
    finally:
        as_root(
            "rm",
            "-rf",
            root / "opt/stepdiag.deb",
            root / "etc/stepdiag",
            root / "var/lib/private/stepdiag",
        )


@pytest.mark.parametrize("package", [("arm64", "bookworm")], indirect=True)
def test_a_package_for_arm64_starts_under_qemu(held, tmp_path):
    """Its own code on Debian's Python for arm64: every library of native code is loaded, and a
    survey file written."""
    root, survey = debian_root("arm64"), tmp_path / "survey.toml"
    packages = held / "opt/stepdiag/lib/python3.11/site-packages"
    command = ["qemu-aarch64-static", "-L", root, root / "usr/bin/python3.11"]
    libraries = (
        "numpy, pyarrow, zstandard, lz4.frame, msgspec, re2, cryptography.hazmat.bindings._rust, "
        "lxml.etree, psutil"
    )
    imports = f"import platform, {libraries}; print(platform.machine())"
    for arguments, words in (
        (("-c", imports), "aarch64"),
        ((held / "opt/stepdiag/bin/stepdiag", "init", survey), ""),
    ):
        done = subprocess.run(
            [*map(str, (*command, *arguments))],
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
            env=os.environ | {"PYTHONPATH": str(packages), "OPENBLAS_NUM_THREADS": "1"},
        )
        assert done.returncode == 0, done.stderr
        assert words in done.stdout
    assert survey.is_file()


def test_the_wheel_is_a_tool_of_its_own(tmp_path):
    """`uv tool install`: a folder and a command, nothing else of the computer is touched."""
    uv = CHECKOUT / ".tools" / "bin" / "uv"
    uv = uv if uv.exists() else shutil.which("uv")
    environment = {
        "UV_TOOL_DIR": str(tmp_path / "tools"),
        "UV_TOOL_BIN_DIR": str(tmp_path / "bin"),
    }

    command = [
        uv,
        "tool",
        "install",
        "--quiet",
        "--python",
        "python3.11",
        built_wheel(tmp_path),
    ]
    done = subprocess.run(
        list(map(str, command)),
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env=os.environ | environment,
    )
    assert done.returncode == 0, done.stderr
    said = subprocess.run(
        [tmp_path / "bin/stepdiag", "--version"],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    ).stdout
    assert said.startswith("stepdiag ")
