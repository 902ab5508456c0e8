"""Restrictions (walls) that the page's process and the publishing process set on themselves before
they accept their first client.

A process has two walls, because each wall has gaps that the second wall closes. A filter of system
calls (`stepdiag.walls.seccomp`), which every supported kernel has, forbids kinds of calls: signals,
limits and priorities of other processes, new sockets, new processes, writing. Landlock
(landlock(7)) limits the files that a process can read, and in later versions also TCP, devices,
signals and abstract sockets. Limits on the process itself (setrlimit(2)) close the remaining gaps.
The process reports every wall that the kernel refuses.
"""

import ctypes
import os
import resource
import signal
import struct
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from stepdiag.walls.seccomp import shut_calls

MOST_DESCRIPTORS = 1024
"""Largest number of open descriptors: three for each admitted connection
(`stepdiag.page.connections`), and a reserve."""
MOST_MEMORY = 2**30
"""Largest address space of the process in bytes, most of which is never used."""

PROGRAM = Path(__file__).parents[1]

_LANDLOCK_CREATE, _LANDLOCK_ADD, _LANDLOCK_RESTRICT = 444, 445, 446
_PR_SET_PDEATHSIG, _PR_SET_NO_NEW_PRIVS = 1, 38
_CREATE_VERSION = 1
_RULE_BENEATH, _RULE_PORT = 1, 2
_READ_FILE, _READ_DIR = 1 << 2, 1 << 3
_ALL_OF_THE_DISK = (1 << 13) - 1
"""The rights that the first version of Landlock controls: execute, write, read, list, remove,
make."""
_MORE_OF_THE_DISK = {2: 1 << 13, 3: 1 << 14, 5: 1 << 15}
"""The rights that later versions of Landlock control: moving files between folders, truncating
files, commands to devices."""
_BIND, _CONNECT = 1, 2
"""The rights to bind and to connect by TCP, which Landlock controls since version 4; sockets that
are already bound stay usable."""
_SCOPES = 0b11
"""Restriction of abstract sockets of other processes and of signals to other processes, since
version 6 of Landlock."""


def die_with_parent() -> None:
    """Let the kernel end this process together with its parent: an orphan would keep the address of
    the page."""
    _call("prctl", _PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() == 1:
        os._exit(0)


def readable_by_program(folder: Path) -> Sequence[Path]:
    """Return the paths that the process reads: the program, its libraries, and the present or
    future folder of a survey."""
    libraries = [
        Path(place)
        for place in (
            *sys.path,
            sys.prefix,
            sys.base_prefix,
            "/usr",
            "/lib",
            "/etc/localtime",
        )
        if place
    ]
    return (
        next(each for each in (folder, *folder.parents) if each.exists()),
        PROGRAM,
        *libraries,
    )


def confine(readable: Iterable[Path]) -> Sequence[str]:
    """Permanently remove all rights except reading below ``readable`` and the use of open files;
    return the rights that could not be removed."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    return _walled(readable)


def confine_publisher(readable: Iterable[Path], *, calls: int = 0) -> Sequence[str]:
    """Remove the same rights as `confine`, but set no limit for the size of written files and for
    the memory. With a port in ``calls``, TCP to this port and the look-up of host names stay
    possible."""
    return _walled(readable, calls)


def _walled(readable: Iterable[Path], calls: int = 0) -> Sequence[str]:
    resource.setrlimit(resource.RLIMIT_NOFILE, (MOST_DESCRIPTORS, MOST_DESCRIPTORS))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    _call("prctl", _PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)
    version = _shut_in(readable, calls)
    shut = _BY_CALLS - (_NETWORK if calls else set())
    if not shut_calls(network=bool(calls)):
        shut = set()
    return tuple(what for what, since in OPEN.items() if version < since and what not in shut)


OPEN = {
    "reading the disk and the memory of its account": 1,
    "writing the disk": 1,
    "cutting off files": 3,
    "TCP": 4,
    "devices": 5,
    "signals": 6,
    "abstract sockets": 6,
    "UDP and other sockets": 99,
    "limits and priority of other processes": 99,
    "attributes of files": 99,
    "new processes": 99,
}
"""Actions that a process must not be able to do, each with the version of Landlock that prevents
the action. The number 99 means that no version prevents the action."""
_NETWORK = {"TCP", "abstract sockets", "UDP and other sockets"}
_BY_CALLS = OPEN.keys() - {"reading the disk and the memory of its account"}
"""Actions that the filter of system calls prevents. In a process that calls a server, the filter
does not prevent the actions in `_NETWORK`."""


def _shut_in(readable: Iterable[Path], calls: int) -> int:
    version = max(_call("syscall", _LANDLOCK_CREATE, None, 0, _CREATE_VERSION), 0)
    disk = _ALL_OF_THE_DISK | sum(
        right for since, right in _MORE_OF_THE_DISK.items() if version >= since
    )
    known = 1 + (version >= 4) + (version >= 6)
    attributes = struct.pack(f"{known}Q", *(disk, _BIND | _CONNECT, _SCOPES)[:known])
    rules = (
        _call("syscall", _LANDLOCK_CREATE, attributes, len(attributes), 0) if version else -1
    )
    if rules < 0:
        return 0
    try:
        for path in readable:
            _allow(rules, path)
        if calls and version >= 4:
            _call(
                "syscall",
                _LANDLOCK_ADD,
                rules,
                _RULE_PORT,
                struct.pack("=QQ", _CONNECT, calls),
                0,
            )
        return version if _call("syscall", _LANDLOCK_RESTRICT, rules, 0) == 0 else 0
    finally:
        os.close(rules)


def _allow(rules: int, path: Path) -> None:
    try:
        place = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return  # no rule is needed for a path that does not exist
    try:
        rights = _READ_FILE | _READ_DIR if path.is_dir() else _READ_FILE
        _call(
            "syscall",
            _LANDLOCK_ADD,
            rules,
            _RULE_BENEATH,
            struct.pack("=Qi", rights, place),
            0,
        )
    finally:
        os.close(place)


def _call(function: str, *arguments: object) -> int:
    """Call a variadic function of the C library with every number as wide as a register; return -1
    for a refusal by the kernel."""
    wide = [ctypes.c_long(one) if isinstance(one, int) else one for one in arguments]
    return int(getattr(ctypes.CDLL(None, use_errno=True), function)(*wide))
