"""A permanent filter of system calls that a process sets on itself (seccomp(2), kernel 3.5), for
rights that Landlock does not cover.

Before every call, the kernel runs a small program of classic BPF. The program reads the number of
the call, the architecture and the arguments, but no memory to which an argument points. This
program

    ends the process at a call of another architecture, whose numbers differ
    answers ENOSYS to calls newer than `_NEWEST`: the C library uses older calls instead
    answers ENOSYS to clone3 and openat2, whose flags are in memory: the C library uses clone
        and openat instead, whose flags are arguments
    answers EPERM to every call of `_NETWORK`, `_PROCESSES`, `_FILES`
    answers EPERM to calls of `_BY_BITS` whose argument has a bit of the mask, or lacks it:
        opening for writing, a process instead of a thread, sending with a connection
        (MSG_FASTOPEN), a limit of another process
    permits all other calls.

One instruction is 8 bytes: code, jump if true, jump if false, constant (struct sock_filter). The
data (struct seccomp_data) contain the number at 0, the architecture at 4, argument k at 16 + 8k,
with its lower half first on both architectures. A process that has set no_new_privs may set the
filter. The flag TSYNC sets the filter on all threads. Files and sockets that are already open stay
usable: reading, accepting and answering continue.
"""

import ctypes
import errno
import platform
import struct
from collections.abc import Mapping

_NEWEST = 450
_MACHINES = {"x86_64": (0, 0xC000003E, 317), "aarch64": (1, 0xC00000B7, 277)}
"""For each processor: the index of its call numbers in the tables below, the audit architecture,
and the number of the call seccomp(2)."""
_NONE = -1

_NETWORK = {
    "socket": (41, 198),
    "socketpair": (53, 199),
    "connect": (42, 203),
    "bind": (49, 200),
    "sendmmsg": (307, 269),
}
_RINGS = {
    "io_uring_setup": (425, 425),
    "io_uring_enter": (426, 426),
    "io_uring_register": (427, 427),
}
_PROCESSES = {
    "kill": (62, 129),
    "tkill": (200, 130),
    "tgkill": (234, 131),
    "rt_sigqueueinfo": (129, 138),
    "rt_tgsigqueueinfo": (297, 240),
    "pidfd_open": (434, 434),
    "pidfd_send_signal": (424, 424),
    "pidfd_getfd": (438, 438),
    "process_madvise": (440, 440),
    "process_mrelease": (448, 448),
    "ptrace": (101, 117),
    "process_vm_readv": (310, 270),
    "process_vm_writev": (311, 271),
    "kcmp": (312, 272),
    "fork": (57, _NONE),
    "vfork": (58, _NONE),
    "execve": (59, 221),
    "execveat": (322, 281),
    "setpriority": (141, 140),
    "ioprio_set": (251, 30),
    "sched_setscheduler": (144, 119),
    "sched_setparam": (142, 118),
    "sched_setattr": (314, 274),
    "sched_setaffinity": (203, 122),
    "migrate_pages": (256, 238),
    "move_pages": (279, 239),
    "unshare": (272, 97),
    "setns": (308, 268),
    "bpf": (321, 280),
    "perf_event_open": (298, 241),
    "userfaultfd": (323, 282),
    "keyctl": (250, 219),
    "add_key": (248, 217),
    "request_key": (249, 218),
    "shmget": (29, 194),
    "shmat": (30, 196),
    "shmctl": (31, 195),
    "semget": (64, 190),
    "semctl": (66, 191),
    "semop": (65, 193),
    "semtimedop": (220, 192),
    "msgget": (68, 186),
    "msgctl": (71, 187),
    "msgsnd": (69, 189),
    "mq_open": (240, 180),
    "mq_unlink": (241, 181),
}
_FILES = {
    "truncate": (76, 45),
    "ftruncate": (77, 46),
    "fallocate": (285, 47),
    "creat": (85, _NONE),
    "rename": (82, _NONE),
    "renameat": (264, 38),
    "renameat2": (316, 276),
    "link": (86, _NONE),
    "linkat": (265, 37),
    "symlink": (88, _NONE),
    "symlinkat": (266, 36),
    "unlink": (87, _NONE),
    "unlinkat": (263, 35),
    "mkdir": (83, _NONE),
    "mkdirat": (258, 34),
    "rmdir": (84, _NONE),
    "mknod": (133, _NONE),
    "mknodat": (259, 33),
    "chmod": (90, _NONE),
    "fchmod": (91, 52),
    "fchmodat": (268, 53),
    "chown": (92, _NONE),
    "lchown": (94, _NONE),
    "fchown": (93, 55),
    "fchownat": (260, 54),
    "setxattr": (188, 5),
    "lsetxattr": (189, 6),
    "fsetxattr": (190, 7),
    "removexattr": (197, 14),
    "lremovexattr": (198, 15),
    "fremovexattr": (199, 16),
    "utime": (132, _NONE),
    "utimes": (235, _NONE),
    "futimesat": (261, _NONE),
    "utimensat": (280, 88),
    "open_by_handle_at": (304, 265),
    "mount": (165, 40),
    "umount2": (166, 39),
    "chroot": (161, 51),
    "pivot_root": (155, 41),
    "move_mount": (429, 429),
    "open_tree": (428, 428),
    "fsopen": (430, 430),
}
_ABSENT = {"clone3": (435, 435), "openat2": (437, 437)}
_FOR_WRITING, _FASTOPEN, _THREAD, _ANY_BIT = 0o1103, 0x20000000, 0x10000, 0xFFFFFFFF
"""Bits of arguments that decide whether a call is permitted. `_FOR_WRITING` is O_WRONLY, O_RDWR,
O_CREAT or O_TRUNC, `_FASTOPEN` is MSG_FASTOPEN, and `_THREAD` is CLONE_THREAD. `_ANY_BIT` is any
bit of a process number, which is 0 for the process itself."""
_BY_BITS = {
    "open": ((2, _NONE), 1, _FOR_WRITING, False),
    "openat": ((257, 56), 2, _FOR_WRITING, False),
    "clone": ((56, 220), 0, _THREAD, True),
    "sendto": ((44, 206), 3, _FASTOPEN, False),
    "sendmsg": ((46, 211), 2, _FASTOPEN, False),
    "prlimit64": ((302, 261), 0, _ANY_BIT, False),
}
"""Calls that are decided by the bits of an argument: their numbers, the place of the argument, the
mask, and whether a set bit permits or refuses the call."""

_LOAD, _EQUAL, _ABOVE, _BITS, _RETURN = 0x20, 0x15, 0x25, 0x45, 0x06
_ALLOW, _ERROR, _KILL = 0x7FFF0000, 0x00050000, 0x80000000
_SET_FILTER, _ON_ALL_THREADS = 1, 1


def shut_calls(*, network: bool = False) -> bool:
    """Set the filter on every thread of this process; return whether the kernel accepted it. The
    process must have set no_new_privs (prctl(2)).

    With ``network``, new sockets and connections stay possible.
    """
    machine = _MACHINES.get(platform.machine())
    if machine is None:
        return False
    column, architecture, seccomp = machine
    program = _program(
        column, architecture, _PROCESSES | _FILES | (_RINGS if network else _RINGS | _NETWORK)
    )
    code = ctypes.create_string_buffer(program, len(program))
    filter_ = struct.pack("HxxxxxxP", len(program) // 8, ctypes.addressof(code))
    return (
        int(
            ctypes.CDLL(None, use_errno=True).syscall(
                seccomp, _SET_FILTER, _ON_ALL_THREADS, filter_
            )
        )
        == 0
    )


def _program(column: int, architecture: int, refused: Mapping[str, tuple[int, int]]) -> bytes:
    refuse, absent = _ERROR | errno.EPERM, _ERROR | errno.ENOSYS
    lines = [
        (_LOAD, 0, 0, 4),
        (_EQUAL, 1, 0, architecture),
        (_RETURN, 0, 0, _KILL),
        (_LOAD, 0, 0, 0),
    ]
    lines += [(_ABOVE, 0, 1, _NEWEST), (_RETURN, 0, 0, absent)]
    for answer, calls in ((absent, _ABSENT), (refuse, refused)):
        for numbers in calls.values():
            if numbers[column] != _NONE:
                lines += [(_EQUAL, 0, 1, numbers[column]), (_RETURN, 0, 0, answer)]
    for numbers, argument, mask, allows in _BY_BITS.values():
        if numbers[column] != _NONE:
            answers = (_ALLOW, refuse) if allows else (refuse, _ALLOW)
            lines += [
                (_EQUAL, 0, 4, numbers[column]),
                (_LOAD, 0, 0, 16 + 8 * argument),
                (_BITS, 0, 1, mask),
            ]
            lines += [(_RETURN, 0, 0, answer) for answer in answers]
    lines.append((_RETURN, 0, 0, _ALLOW))
    return b"".join(struct.pack("=HBBI", *line) for line in lines)
