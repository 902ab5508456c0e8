# ruff: noqa: PTH101, PTH102, PTH104, PTH108, PTH211  # the calls as the kernel has them, one
# a line
"""Code inside a process behind its walls: tries all that would harm the recorder, by the C library,
and prints what succeeded.

    python attack.py page|opcua|mqtt|unit VERSION PID PORT FOLDER SECRET

VERSION masks the kernel's Landlock. ``unit`` sets up no walls of its own: those of the unit it runs
in stand alone. PID is the recorder, PORT a listener of TCP and UDP, FOLDER holds 0001.mcap, SECRET
is a file elsewhere.
"""

import contextlib
import ctypes
import errno
import json
import os
import platform
import resource
import signal
import socket
import struct
import sys
import threading
from pathlib import Path

from stepdiag.walls import confine

LIBC = ctypes.CDLL(None, use_errno=True)
NUMBERS = {
    "x86_64": {
        "truncate": 76,
        "clone3": 435,
        "pidfd_open": 434,
        "pidfd_send_signal": 424,
        "io_uring_setup": 425,
        "openat2": 437,
        "vmread": 310,
    },
    "aarch64": {
        "truncate": 45,
        "clone3": 435,
        "pidfd_open": 434,
        "pidfd_send_signal": 424,
        "io_uring_setup": 425,
        "openat2": 437,
        "vmread": 270,
    },
}[platform.machine()]
PRIO_PROCESS, SCHED_IDLE, PTRACE_ATTACH, PTRACE_SEIZE, CREATE_VERSION = 0, 5, 16, 0x4206, 1
FASTOPEN, NEWEST = 0x20000000, 99


def mask(version):
    """Have the kernel state no newer Landlock than this."""
    real = confine._call

    def masked(function, *arguments):
        found = real(function, *arguments)
        return (
            min(found, version)
            if arguments[:2] == (confine._LANDLOCK_CREATE, None)
            else found
        )

    if version < NEWEST:
        confine._call = masked


def attacks(pid, port, folder, secret):
    """Return every attack by name: a function that raises, or returns a negative number, where it
    is refused."""
    log, address = str(folder / "0001.mcap").encode(), ("127.0.0.1", port)
    limit = struct.pack("QQ", 0, 0)

    def sent(kind, data=b"\x00\x01", **how):
        with socket.socket(*kind) as one:
            one.settimeout(2)
            return (
                one.sendto(data, how.get("flags", 0), address)
                if "flags" in how or kind[1] == socket.SOCK_DGRAM
                else one.connect(address)
            )

    def opened(path, flags):
        os.close(os.open(path, flags, 0o600))

    def forked():
        child = os.fork()
        if not child:
            os._exit(0)
        os.waitpid(child, 0)

    def refused_as_a_call():
        """A file that is not there, so that a filter that lets the call through does not end this
        process: ENOENT is no refusal."""
        LIBC.execv(b"/nowhere", (ctypes.c_char_p * 2)(b"x", None))
        return -1 if ctypes.get_errno() == errno.EPERM else 0

    def by_descriptor():
        found = LIBC.syscall(NUMBERS["pidfd_open"], pid, 0)
        return (
            LIBC.syscall(NUMBERS["pidfd_send_signal"], found, signal.SIGUSR1, None, 0)
            if found > 0
            else -1
        )

    def descriptor(number, *arguments):
        found = LIBC.syscall(NUMBERS[number], *arguments)
        if found > 0:
            os.close(found)
        return found

    return {
        "kill 0": lambda: LIBC.kill(pid, 0),
        "SIGSTOP": lambda: LIBC.kill(pid, signal.SIGSTOP),
        "SIGKILL": lambda: LIBC.kill(pid, signal.SIGKILL),
        "a signal to all": lambda: LIBC.kill(-1, 0),
        "a queued signal": lambda: LIBC.sigqueue(pid, signal.SIGUSR1, None),
        "tgkill": lambda: LIBC.tgkill(pid, pid, signal.SIGUSR1),
        "a signal by pidfd": by_descriptor,
        "its size of files": lambda: LIBC.prlimit(pid, resource.RLIMIT_FSIZE, limit, None),
        "its limits read": lambda: LIBC.prlimit(
            pid, resource.RLIMIT_FSIZE, None, ctypes.create_string_buffer(16)
        ),
        "its priority": lambda: LIBC.setpriority(PRIO_PROCESS, pid, 19),
        "its processors": lambda: os.sched_setaffinity(pid, {0}),
        "its scheduling": lambda: os.sched_setscheduler(pid, SCHED_IDLE, os.sched_param(0)),
        "its disk priority": lambda: LIBC.syscall(
            {"x86_64": 251, "aarch64": 30}[platform.machine()], 1, pid, 3 << 13
        ),
        "ptrace attach": lambda: LIBC.ptrace(PTRACE_ATTACH, pid, None, None),
        "ptrace seize": lambda: LIBC.ptrace(PTRACE_SEIZE, pid, None, None),
        "its memory": lambda: descriptor(
            "vmread",
            pid,
            ctypes.create_string_buffer(16),
            1,
            ctypes.create_string_buffer(16),
            1,
            0,
        ),
        "its memory as a file": lambda: opened(f"/proc/{pid}/mem", os.O_RDONLY),
        "truncate": lambda: LIBC.truncate(log, 0),
        "truncate by number": lambda: LIBC.syscall(NUMBERS["truncate"], log, 0),
        "open for writing": lambda: opened(log, os.O_WRONLY),
        "open for appending": lambda: opened(log, os.O_WRONLY | os.O_APPEND),
        "open and cut off": lambda: opened(log, os.O_RDONLY | os.O_TRUNC),
        "a new file": lambda: opened(folder / "new", os.O_CREAT | os.O_WRONLY),
        "unlink": lambda: os.unlink(log),
        "rename": lambda: os.rename(log, log + b"2"),
        "link": lambda: os.link(log, log + b"2"),
        "symlink": lambda: os.symlink("/etc", folder / "etc"),
        "mkdir": lambda: os.mkdir(folder / "new"),
        "chmod": lambda: os.chmod(log, 0),
        "chown": lambda: os.chown(log, 12345, 12345),
        "the time of a file": lambda: os.utime(log, (0, 0)),
        "an attribute": lambda: os.setxattr(log, "user.x", b"x"),
        "a pipe with a name": lambda: os.mkfifo(folder / "pipe"),
        "fork": forked,
        "a process by clone3": lambda: LIBC.syscall(
            NUMBERS["clone3"], struct.pack("11Q", *[0] * 11), 88
        ),
        "exec": refused_as_a_call,
        "spawn": lambda: os.posix_spawn("/bin/true", ["/bin/true"], {}),
        "io_uring": lambda: descriptor("io_uring_setup", 8, ctypes.create_string_buffer(120)),
        "openat2": lambda: descriptor(
            "openat2", -100, log, struct.pack("QQQ", os.O_WRONLY, 0, 0), 24
        ),
        "TCP to the PLC": lambda: sent((socket.AF_INET, socket.SOCK_STREAM)),
        "UDP to the PLC": lambda: sent((socket.AF_INET, socket.SOCK_DGRAM)),
        "TCP in one packet": lambda: sent(
            (socket.AF_INET, socket.SOCK_STREAM), flags=FASTOPEN
        ),
        "a listening port": lambda: socket.create_server(("127.0.0.1", 0)).close(),
        "a raw socket": lambda: socket.socket(socket.AF_INET, socket.SOCK_RAW, 1).close(),
        "a packet socket": lambda: socket.socket(socket.AF_PACKET, socket.SOCK_RAW).close(),
        "a unix socket": lambda: socket.socket(socket.AF_UNIX).close(),
        "a netlink socket": lambda: socket.socket(socket.AF_NETLINK, socket.SOCK_RAW).close(),
        "a vsock": lambda: socket.socket(40, socket.SOCK_STREAM).close(),
        "reads the log": lambda: opened(log, os.O_RDONLY),
        "reads a secret": lambda: opened(secret, os.O_RDONLY),
        "reads /etc/passwd": lambda: opened("/etc/passwd", os.O_RDONLY),
    }


def succeeded(tried):
    """Return the names of the attacks that were not refused."""
    found = []
    for name, attack in tried.items():
        with contextlib.suppress(OSError):
            outcome = attack()
            if not isinstance(outcome, int) or outcome >= 0:
                found.append(name)
    return found


def main(walls, version, pid, port, folder, secret):
    """Set up the walls, attack from a second thread too, and print."""
    mask(int(version))
    libraries = [Path(place) for place in (*sys.path, sys.prefix, "/usr", "/lib") if place]
    readable = (Path(folder), *libraries)
    threading.Thread(target=threading.Event().wait, daemon=True).start()
    match walls:
        case "page":
            still_open = confine.confine(readable)
        case "unit":
            still_open = ()
        case "opcua":
            still_open = confine.confine_publisher(readable)
        case _:
            still_open = confine.confine_publisher(readable, calls=1883)
    tried, found = attacks(int(pid), int(port), Path(folder), Path(secret)), []
    thread = threading.Thread(target=lambda: found.append(succeeded(tried)))
    thread.start()  # threads are allowed, and have the same walls
    thread.join()
    print(
        json.dumps(
            {
                "tried": len(tried),
                "succeeded": sorted({*found[0], *succeeded(tried)}),
                "open": list(still_open),
            }
        )
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
