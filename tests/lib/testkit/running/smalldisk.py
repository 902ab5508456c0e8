"""A disk that a test can fill to the last byte: a small tmpfs in a mount namespace of its own.

Root gets the namespace as root, everybody else through a user namespace (Debian allows it). Nothing
is mounted where others see it.
"""

import os
import subprocess
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

OWN = () if os.geteuid() == 0 else ("--user", "--map-root-user")
ENTER = () if os.geteuid() == 0 else ("--user", "--preserve-credentials")
MOUNT = 'mount -t tmpfs -o size="$1" small "$0" && echo mounted && exec cat'


@dataclass(frozen=True)
class SmallDisk:
    """``inside`` stands before a command that is to see the disk; ``here`` is where this process
    sees it."""

    inside: tuple
    here: Path

    def fill(self):
        """Leave not one byte free."""
        with (self.here / "filler").open("ab", buffering=0) as file:
            while True:
                try:
                    file.write(bytes(4096))
                except OSError:
                    return

    def free(self):
        """Make room again."""
        (self.here / "filler").unlink()


@contextmanager
def small_disk(folder, size):
    """Mount a disk of ``size`` (as mount(8) writes it) on ``folder`` for those who are let in."""
    folder.mkdir(exist_ok=True)
    command = ("unshare", *OWN, "--mount", "--", "sh", "-c", MOUNT, str(folder), size)
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as holder:
        assert holder.stdout.readline() == "mounted\n", (
            "needs root, or user namespaces (kernel.unprivileged_userns_clone=1)"
        )
        inside = (
            "nsenter",
            *ENTER,
            "--mount",
            "--target",
            str(holder.pid),
            f"--wd={Path.cwd()}",
            "--",
        )
        yield SmallDisk(inside, Path(f"/proc/{holder.pid}/root{folder}"))
