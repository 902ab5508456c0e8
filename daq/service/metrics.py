"""Counts and measures of the daemon, for the supervision of many daemons."""

import shutil
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from stepdiag.base.messages import Words, message
from stepdiag.daq.records.status import LinkStatus

GB = 1e9
"""Bytes in a gigabyte, as makers of disks count."""


@dataclass(slots=True)
class Tally:
    """Counts of the daemon since its start. ``fed_s`` is the monotonic time in s of the last check
    that found every worker alive.
    """

    stops: int = 0
    findings: dict[str, int] = field(default_factory=Counter)
    samples_before: int = 0
    """Number of samples recorded in earlier surveys."""
    surveys: dict[int, int] = field(default_factory=Counter)
    """Number of finished child processes that solved a survey, by exit code."""
    solve_s: float | None = None
    """Duration of the last solution in s."""
    fed_s: float = field(default_factory=time.monotonic)


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """Figures of the daemon at a moment. ``links`` are the states of the links by name.
    ``disk_free_bytes`` is the free space on the disk of the logs. ``watchdog_age_s`` is the time
    since the last check that found every worker alive.
    """

    tally: Tally
    samples: int
    links: dict[str, LinkStatus]
    recording: bool
    recorder_blocked: bool
    backlog_bytes: int
    lost_events: int
    disk_free_bytes: int
    watchdog_age_s: float


def disk_free_bytes(folder: Path) -> int:
    return shutil.disk_usage(folder).free


def words_on_disk(folder: Path, least_gb: float) -> Words:
    """Return the message about a disk with less free space than ``least_gb``; empty for a disk with
    enough space.
    """
    free_gb = disk_free_bytes(folder) / GB
    return message("disk-left", free_gb=free_gb) if free_gb < least_gb else ""
