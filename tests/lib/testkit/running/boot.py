"""A Debian with a real systemd, booted in a container of the host's kernel, for the tests of the
unit.

Needs the rights of root: as root, or through sudo.
"""

import json
import os
import signal
import subprocess
import sys
import sysconfig
import time
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

CHECKOUT = Path(__file__).parents[4]
ROOT = CHECKOUT / ".setup" / "systemd-root"
LIBRARIES = "[Service]\nBindReadOnlyPaths=/opt/libraries\n"
ELEVATED = () if os.geteuid() == 0 else ("sudo", "-n")


def as_root(*command, text="", check=True):
    """Run a command with the rights of root; return its standard output."""
    done = subprocess.run(
        [*ELEVATED, *map(str, command)],
        input=text,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0 or not check, f"{command}: {done.stderr or done.stdout}"
    return done.stdout


def write(path, text):
    """Write a file of the root file system."""
    as_root("install", "-D", "-m", "644", "/dev/stdin", path, text=text)


def debian_root(what="bookworm"):
    """Return the root file system, made where it is not there yet; ``what`` as tools/debian-root
    takes it."""
    done = subprocess.run(
        ["tools/debian-root", what],
        cwd=CHECKOUT,
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return Path(done.stdout.strip())


def install_wheel(root, folder):
    """Install stepdiag's wheel into /opt/stepdiag as docs/install.md says; its libraries are those
    of the tests, seen through a mount."""
    as_root("rm", "-rf", root / "opt/stepdiag")
    as_root("chroot", root, "python3", "-m", "venv", "/opt/stepdiag")
    wheel = built_wheel(folder)
    as_root("cp", wheel, root / "opt" / wheel.name)
    as_root(
        "chroot",
        root,
        "/opt/stepdiag/bin/pip",
        "install",
        "--quiet",
        "--no-index",
        "--no-deps",
        f"/opt/{wheel.name}",
    )
    write(
        root / "opt/stepdiag/lib/python3.11/site-packages/libraries.pth", "/opt/libraries\n"
    )


def forget_surveys(root):
    """Remove surveys, what was recorded of them, and the journal."""
    as_root(
        "rm",
        "-rf",
        root / "var/lib/private/stepdiag",
        root / "etc/stepdiag",
        root / "var/log/journal",
    )


def built_wheel(folder):
    """Return the wheel that is being tested; from a checkout without one, build it."""
    if Path(sys.prefix).name == ".venv-test":
        return next((CHECKOUT / "dist").glob("stepdiag-*.whl"))
    uv = CHECKOUT / ".tools" / "bin" / "uv"
    subprocess.run(
        [
            uv if uv.exists() else "uv",
            "build",
            "--quiet",
            "--wheel",
            "--out-dir",
            folder,
            CHECKOUT,
        ],
        check=True,
        timeout=120,
    )
    return next(folder.glob("stepdiag-*.whl"))


def install_units(root, instance, drop_in):
    """Copy what the wheel brought for systemd to its places, and enable an instance."""
    came = root / "opt/stepdiag/share/stepdiag/systemd"
    for unit in (
        "stepdiag@.service",
        "stepdiag-page@.service",
        "stepdiag-page@.socket",
        "stepdiag-publish@.service",
    ):
        write(root / "etc/systemd/system" / unit, (came / unit).read_text())
    write(root / "etc/systemd/system/stepdiag@.service.d/test.conf", drop_in)
    for name in ("page", "publish"):
        write(root / f"etc/systemd/system/stepdiag-{name}@.service.d/test.conf", LIBRARIES)
    write(
        root / "etc/sysusers.d/stepdiag.conf", (came / "stepdiag.sysusers.conf").read_text()
    )
    as_root("systemd-sysusers", f"--root={root}")
    write(
        root / "etc/udev/rules.d/90-stepdiag.rules", (came / "90-stepdiag.rules").read_text()
    )
    write(
        root / "etc/modules-load.d/stepdiag.conf",
        (came / "stepdiag.modules.conf").read_text(),
    )
    as_root("systemctl", "--quiet", f"--root={root}", "enable", f"stepdiag@{instance}")


@dataclass
class Booted:
    """A system that runs; ``pid`` is its process 1 as the host sees it."""

    root: Path
    pid: int

    def run(self, *command, check=True):
        """Run a command inside; return its standard output."""
        return as_root(
            "nsenter",
            "-t",
            self.pid,
            "-m",
            "-u",
            "-i",
            "-n",
            "-p",
            "-C",
            *command,
            check=check,
        )

    def show(self, unit):
        """Return the properties of a unit."""
        lines = self.run("systemctl", "show", unit).splitlines()
        return dict(line.split("=", 1) for line in lines if "=" in line)

    def until(self, unit, wanted, *, timeout_s=120.0):
        """Return the properties of a unit once ``wanted`` says that they are right."""
        end = time.monotonic() + timeout_s
        while not wanted(seen := self.show(unit)):
            assert time.monotonic() < end, {
                key: seen.get(key)
                for key in ("ActiveState", "StatusText", "NRestarts", "Result")
            } | {"journal": self.journal(unit)[-5:]}
            time.sleep(0.2)
        return seen

    def journal(self, unit):
        """Return what a unit has said so far, one object a line."""
        lines = self.run(
            "journalctl", "--unit", unit, "--output", "cat", "--no-pager"
        ).splitlines()
        return [json.loads(line) for line in lines if line.startswith("{")]


@contextmanager
def booted(root, name, *binds):
    """Boot a root file system; power it off at the end."""
    mounts = [
        f"--bind-ro={sysconfig.get_path('purelib')}:/opt/libraries",
        *(f"--bind={bind}" for bind in binds),
    ]
    command = [
        "systemd-nspawn",
        "-D",
        root,
        "--boot",
        "--register=no",
        "--keep-unit",
        f"--machine={name}",
        "--console=pipe",
        *mounts,
    ]
    container = subprocess.Popen(
        [*ELEVATED, *map(str, command)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
    with container.stdout:
        try:
            system = Booted(root, _first_process(container))
        except BaseException:
            for pid in (*_descendants(container.pid), container.pid):
                as_root("kill", f"-{signal.SIGKILL}", pid, check=False)
            container.wait(timeout=60)
            raise
        try:
            yield system
        finally:
            system.run("systemctl", "poweroff", check=False)
            try:
                container.communicate(timeout=60)
            except subprocess.TimeoutExpired:
                as_root("kill", f"-{signal.SIGKILL}", system.pid)
                container.communicate(timeout=60)


def _first_process(container):
    """Return the id of the container's process 1 once its manager has started everything, or what
    it could."""
    end = time.monotonic() + 120
    said = ""
    while time.monotonic() < end:
        for pid in _descendants(container.pid):
            if _name_of(pid) != "systemd":
                continue
            said = as_root(
                "nsenter",
                "-t",
                pid,
                "-m",
                "-p",
                "-C",
                "systemctl",
                "is-system-running",
                check=False,
            ).strip()
            if said in {"running", "degraded"}:
                return pid
        assert container.poll() is None, container.stdout.read()
        time.sleep(0.1)
    raise AssertionError(f"the system did not come up: {said}")


def _name_of(pid):
    """Return what a process calls itself; empty where it has ended, which it may do while it is
    asked."""
    try:
        return Path(f"/proc/{pid}/comm").read_text().strip()
    except OSError:
        return ""


def _descendants(pid):
    try:
        children = [
            int(child)
            for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        ]
    except OSError:
        return []
    return children + [each for child in children for each in _descendants(child)]
