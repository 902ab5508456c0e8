"""What the page's process gives up before it hears the first stranger: writing, most of the disk, calling anybody, outliving the daemon.

Landlock (landlock(7)) and prctl(2) are called by number, as the C library has no functions for the former. Where the kernel is older than
an ability, that one is left out and reported.
"""

import ctypes
import os
import resource
import signal
import struct
from collections.abc import Iterable, Sequence
from pathlib import Path

MOST_DESCRIPTORS = 1024
"""Three for each connection that is let in (`stepdiag.page.connections`), and spare ones."""
MOST_MEMORY = 2**30
"""Address space in bytes, of which most is never touched."""

_LANDLOCK_CREATE, _LANDLOCK_ADD, _LANDLOCK_RESTRICT = 444, 445, 446
_PR_SET_PDEATHSIG, _PR_SET_NO_NEW_PRIVS = 1, 38
_CREATE_VERSION = 1
_RULE_BENEATH = 1
_READ_FILE, _READ_DIR = 1 << 2, 1 << 3
_ALL_OF_THE_DISK = (1 << 13) - 1
"""Every right of the first version of Landlock: execute, write, read, list, remove, make."""
_MORE_OF_THE_DISK = {2: 1 << 13, 3: 1 << 14}
"""Move between folders; cut off."""
_ALL_OF_TCP = 0b11
"""Bind and connect, since version 4. What is already bound goes on."""


def die_with_parent() -> None:
    """Have the kernel end this process with the one that started it: an orphan would hold the page's address."""
    _call("prctl", _PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() == 1:
        os._exit(0)


def confine(readable: Iterable[Path]) -> Sequence[str]:
    """Give up for good everything but reading below ``readable`` and what is open already; return what the kernel could not take."""
    resource.setrlimit(resource.RLIMIT_NOFILE, (MOST_DESCRIPTORS, MOST_DESCRIPTORS))
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    _call("prctl", _PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)
    return _shut_in(readable)


def _shut_in(readable: Iterable[Path]) -> Sequence[str]:
    version = _call("syscall", _LANDLOCK_CREATE, None, 0, _CREATE_VERSION)
    if version < 1:
        return ("the disk", "the network")
    disk = _ALL_OF_THE_DISK | sum(right for since, right in _MORE_OF_THE_DISK.items() if version >= since)
    attributes = struct.pack("QQ", disk, _ALL_OF_TCP) if version >= 4 else struct.pack("Q", disk)
    rules = _call("syscall", _LANDLOCK_CREATE, attributes, len(attributes), 0)
    try:
        for path in readable:
            _allow(rules, path)
        shut = rules >= 0 and _call("syscall", _LANDLOCK_RESTRICT, rules, 0) == 0
    finally:
        if rules >= 0:
            os.close(rules)
    return () if shut and version >= 4 else ("the network",) if shut else ("the disk", "the network")


def _allow(rules: int, path: Path) -> None:
    try:
        place = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return  # what is not there needs no rule
    try:
        rights = _READ_FILE | _READ_DIR if path.is_dir() else _READ_FILE
        _call("syscall", _LANDLOCK_ADD, rules, _RULE_BENEATH, struct.pack("=Qi", rights, place), 0)
    finally:
        os.close(place)


def _call(function: str, *arguments: object) -> int:
    """Call a variadic function of the C library with every number as wide as a register; return -1 where the kernel refuses."""
    wide = [ctypes.c_long(one) if isinstance(one, int) else one for one in arguments]
    return int(getattr(ctypes.CDLL(None, use_errno=True), function)(*wide))
