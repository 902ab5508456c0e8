"""The unit of a program whose Python does not come with the system: in somebody's home, reached
through links, as uv and pyenv place it."""

import pytest

from stepdiag.virtual.base.reserved import reserved_port
from testkit.running.boot import as_root, booted, built_wheel, debian_root, write

pytestmark = pytest.mark.system

UNIT = "stepdiag@alone.service"
SURVEY = """
[survey]
name = "alone"
directory = "/var/lib/stepdiag"
machine = "M1"
[volume]
size_mm = [300.0, 200.0, 100.0]
increments = 2
[laser]
format = "umd"
port = "/dev/ttyUSB0"
[plc]
host = "127.0.0.1"
[page]
port = {page}
"""
"""The container shares the network: the usual port may be another test's."""
PROGRAM = "/root/tools/stepdiag"
PYTHON = "/root/share/python-3.11.0"


def install_in_a_home(folder):
    """Install a copy of Python, a link to it, an environment made through the link and the wheel,
    all below /root; return the root."""
    root = debian_root()
    as_root(
        "rm",
        "-rf",
        *(
            root / each
            for each in (
                "root/tools",
                "root/share",
                "etc/stepdiag",
                "var/lib/private/stepdiag",
            )
        ),
    )
    as_root(
        "sh",
        "-c",
        f"rm -rf {root}/etc/systemd/system/*/stepdiag@* {root}/etc/systemd/system/stepdiag@*",
    )  # of a test before
    as_root("mkdir", "-p", f"{root}{PYTHON}/bin", f"{root}{PYTHON}/lib", root / "root/tools")
    as_root("chmod", "700", root / "root", root / "root/share")
    as_root("chroot", root, "cp", "-r", "/usr/lib/python3.11", f"{PYTHON}/lib/")
    as_root("chroot", root, "cp", "/usr/bin/python3.11", f"{PYTHON}/bin/")
    as_root("ln", "-s", "python-3.11.0", root / "root/share/python-3.11")
    as_root("chroot", root, "/root/share/python-3.11/bin/python3.11", "-m", "venv", PROGRAM)
    wheel = built_wheel(folder)
    as_root("cp", wheel, root / "root" / wheel.name)
    as_root(
        "chroot",
        root,
        f"{PROGRAM}/bin/pip",
        "install",
        "--quiet",
        "--no-index",
        "--no-deps",
        f"/root/{wheel.name}",
    )
    write(f"{root}{PROGRAM}/lib/python3.11/site-packages/libraries.pth", "/opt/libraries\n")
    write(root / "etc/stepdiag/alone.toml", SURVEY.format(page=reserved_port()))
    write(
        root / f"etc/systemd/system/{UNIT}.d/test.conf",
        "[Service]\nBindReadOnlyPaths=/opt/libraries\n",
    )
    return root


@pytest.mark.timeout(600)
def test_a_python_in_a_home_runs_and_nothing_else_of_it_is_seen(tmp_path):
    root = install_in_a_home(tmp_path)
    with booted(root, "stepdiag-home") as system:
        install = (
            f"{PROGRAM}/bin/stepdiag",
            "service",
            "install",
            "/etc/stepdiag/alone.toml",
        )

        system.run("chmod", "o-rx", PYTHON)
        refused = system.run("sh", "-c", f"{' '.join(install)} 2>&1; echo exit code $?")
        assert f"chmod -R o+rX {PYTHON}" in " ".join(refused.split())
        assert "exit code 2" in refused
        system.run("chmod", "o+rx", PYTHON)

        system.run(*install)
        system.run("systemctl", "daemon-reload")
        system.run("systemctl", "start", UNIT)
        unit = system.until(UNIT, lambda unit: unit["ActiveState"] == "active")
        seen = f"/proc/{unit['MainPID']}/root"
        assert system.run("readlink", f"/proc/{unit['MainPID']}/exe").startswith(
            "/root/share/python-3.11"
        )
        assert set(system.run("ls", f"{seen}/root", f"{seen}/root/tools").split()) == {
            f"{seen}/root:",
            "share",
            "tools",
            f"{seen}/root/tools:",
            "stepdiag",
        }
        exposed = system.run("systemd-analyze", "security", "--threshold=14", UNIT)
        assert "OK" in exposed.splitlines()[-1], exposed.splitlines()[-1]
    as_root(
        "rm",
        "-rf",
        *(
            root / each
            for each in ("root/tools", "root/share", f"etc/systemd/system/{UNIT}.d")
        ),
    )
