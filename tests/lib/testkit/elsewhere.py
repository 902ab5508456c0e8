"""stepdiag as on Windows, as far as Linux can play it: ``python -m testkit.elsewhere`` runs the
calls that come as JSON on standard input.

What Windows has not is taken away after the libraries are loaded, for they have releases of their
own for Windows. What Windows does otherwise with an open file (no removal, no renaming) is not
played.
"""

import importlib.abc
import json
import os
import select
import shutil
import signal
import socket
import sys
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

# the libraries, before anything is taken away from them
import numpy as np  # noqa: F401

MODULES = ("fcntl", "grp", "pty", "pwd", "resource", "syslog", "termios", "tty")
NAMES: dict[Any, tuple[str, ...]] = {
    os: (
        "O_CLOEXEC",
        "O_DIRECTORY",
        "O_DSYNC",
        "O_NOCTTY",
        "O_NOFOLLOW",
        "O_NONBLOCK",
        "O_PATH",
        "O_SYNC",
        "O_TMPFILE",
        "chown",
        "fchmod",
        "fchown",
        "fdatasync",
        "fork",
        "getegid",
        "geteuid",
        "getgid",
        "getpgid",
        "getpriority",
        "getuid",
        "killpg",
        "mkfifo",
        "nice",
        "openpty",
        "posix_fallocate",
        "pread",
        "pwrite",
        "sched_getaffinity",
        "sched_setaffinity",
        "setpriority",
        "setsid",
        "statvfs",
        "sync",
        "sysconf",
        "ttyname",
        "uname",
    ),
    signal: (
        "SIGALRM",
        "SIGCHLD",
        "SIGHUP",
        "SIGKILL",
        "SIGPIPE",
        "SIGUSR1",
        "SIGUSR2",
        "pthread_sigmask",
        "setitimer",
    ),
    select: ("poll", "epoll"),
    socket: ("AF_UNIX", "SO_PEERCRED"),
}


class _None(importlib.abc.MetaPathFinder):
    def find_spec(self, name: str, path: object, target: object = None) -> None:
        del path, target
        if name in MODULES:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def take_away() -> None:
    """Take away what Windows has not; folders are not opened, and the platform is another."""
    for module in MODULES:
        sys.modules.pop(module, None)
    sys.meta_path.insert(0, _None())
    for holder, names in NAMES.items():
        for name in names:
            vars(holder).pop(name, None)
    os.open = _opened(os.open)
    vars(shutil)["_use_fd_functions"] = False
    sys.platform = "win32"
    import stepdiag.base.disk.system  # noqa: F401

    sys.platform = "linux"


def _opened(was: Callable[..., int]) -> Callable[..., int]:
    def opened(path: Any, flags: int, mode: int = 0o777, **kept: Any) -> int:
        if kept.get("dir_fd") is not None:
            raise NotImplementedError("dir_fd unavailable on this platform")
        if Path(path).is_dir():
            raise PermissionError(13, "Permission denied", str(path))
        return was(path, flags, mode)

    return opened


def contents(folder: Path) -> dict[Path, bytes]:
    """Return the files of a folder, each by its place in it."""
    return {
        path.relative_to(folder): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def put_back(folder: Path, files: dict[Path, bytes]) -> None:
    """Bring a folder back to the files that it held."""
    for path in folder.iterdir():
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    for path, data in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(data)


def digests(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of every file of a folder."""
    return {str(path): sha256(data).hexdigest() for path, data in contents(folder).items()}


def main() -> None:
    """Run each call in the working folder, which is brought back to what it held; print end, answer
    and files of each."""
    take_away()
    from testkit.cli import stepdiag

    folder = Path.cwd()
    held = contents(folder)
    ends = {}
    for name, call in json.load(sys.stdin).items():
        ended = stepdiag(*call)
        ends[name] = [*ended, digests(folder)]
        put_back(folder, held)
    json.dump(ends, sys.stdout)


if __name__ == "__main__":
    main()
