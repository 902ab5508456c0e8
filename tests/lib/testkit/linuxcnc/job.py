"""A survey as a job: the daemon records and solves what a real control drives, and a busy computer
has it drive again."""

import json
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from stepdiag.base.volume import Volume
from stepdiag.exporters.programs import Sequence, nc_programs
from stepdiag.virtual.drive.sequence import Box
from stepdiag.virtual.drive.setups import Alignment
from stepdiag.virtual.physics.machine import Machine
from testkit.linuxcnc.comparison import ATTEMPTS, driven_rms_um
from testkit.linuxcnc.files import profile_text
from testkit.linuxcnc.rig import Control
from testkit.linuxcnc.stand import LATENCY_S, Stand

SURVEY = """\
[survey]
name = "control"
machine = "LinuxCNC, simulated axes"
[volume]
origin_mm = {origin}
size_mm = {size}
increments = {increments}
[plan]
setups = {setups}
return_pass = false
feed_mm_min = {feed}
dwell_s = {dwell}
overrun_mm = 5.0
[machine]
{state}
[solver]
angles = "angles.csv"
[laser]
format = "umd"
port = "{laser}"
compensated = true
latency_s = {latency}
[laser.umd]
phase_bits = 16
[plc]
host = "127.0.0.1"
port = {port}
poll_hz = 100.0
[plc.handshake]
enabled = true
[stop]
settle_s = 0.02
min_window_s = 0.05
[page]
enabled = false
{export}
"""
OFF = 'compensation = "off"'
ON = (
    'compensation = "on"\nactive = ["lattice.csv"]\nactive_date = 2026-01-31\nactive_source = '
    '"the folder of the INI file"'
)
EXPORT = '[[export]]\ncontroller = "linuxcnc"\nprofile = "linuxcnc.toml"'
FEED_MM_MIN = 90000.0
DWELL_S = 0.12
TILT = Alignment(mirror_mrad=(0.4, -0.3), beam_mrad=(0.1, 0.15))
NOISE_UM = 0.05
"""Of one laser sample; a stop is the mean of a dozen, as a longer one of a noisier laser is of a
hundred."""


def surveyed(
    control: Control,
    machine: Machine,
    folder: Path,
    setups: tuple[str, ...],
    volume: Volume,
    within: Volume,
    active: bytes = b"",
) -> tuple[Path, float]:
    """Let the daemon record and solve a survey that the control drives, and export where no lattice
    is ``active``.

    Returns its folder, and what the machine errs on a grid ``within`` a volume, which is driven
    while the daemon solves.
    """
    own = folder / ("again" if active else "first")
    own.mkdir()
    sequence = Sequence(
        name=own.name,
        volume=volume,
        setups=setups,
        return_pass=False,
        feed_mm_min=FEED_MM_MIN,
        dwell_s=DWELL_S,
        overrun_mm=5.0,
        handshake=True,
    )
    box = Box(
        origin_mm=volume.origin_mm, size_mm=volume.size_mm, increments=volume.increments
    )
    (own / "linuxcnc.toml").write_text(profile_text("kinematics", volume), encoding="utf-8")
    (own / "angles.csv").write_bytes((folder / "angles.csv").read_bytes())
    with Stand(control, machine, box, own, noise_um=NOISE_UM) as stand:
        survey = SURVEY.format(
            origin=list(volume.origin_mm),
            size=list(volume.size_mm),
            increments=volume.increments,
            setups=list(setups),
            feed=FEED_MM_MIN,
            dwell=DWELL_S,
            port=stand.plc_port,
            laser=stand.laser_port,
            latency=LATENCY_S,
            state=ON if active else OFF,
            export="" if active else EXPORT,
        )
        if active:
            (own / "lattice.csv").write_bytes(active)
        (own / "survey.toml").write_text(survey, encoding="utf-8")
        programs = {
            program.setup: program.data for program in nc_programs(sequence, "linuxcnc")
        }
        with daemon(own / "survey.toml") as log:
            for setup, program in programs.items():
                drive(control, stand, setup, program)
            left_um = driven_rms_um(control, machine, within)
            for attempt in range(ATTEMPTS):
                missing = still_missing(
                    own / "control" / "0001", log, len(programs) + attempt
                )
                if not missing:
                    return own / "control" / "0001", left_um
                drive(control, stand, missing, programs[missing])
            raise AssertionError(log.read_text(errors="replace")[-3000:])


def drive(control: Control, stand: Stand, setup: str, program: bytes) -> None:
    """Put the laser up for a setup and run its program."""
    stand.readout.align(setup, TILT)
    time.sleep(0.4)
    control.run(program)


def still_missing(folder: Path, log: Path, driven: int) -> str:
    """Return the setup to drive again, because a busy computer lost samples of it; nothing once the
    result is there.

    ``driven``: how many programs were run so far. What the daemon waits for counts once the last of
    them has ended.
    """

    def wanted() -> str:
        said = [
            json.loads(line)
            for line in log.read_text(encoding="utf-8", errors="replace").splitlines()
            if line.endswith("}")
        ]
        ended = [event for event in said if event.get("event") == "pass-ended"]
        begun = max(
            (
                place
                for place, event in enumerate(said)
                if event.get("event") == "stop" and event["stop"] == 0
            ),
            default=0,
        )
        waits = (
            [event["what"] for event in said[begun:] if event.get("event") == "waiting"]
            if len(ended) >= driven
            else []
        )
        program = (
            r"the program of (?:[^()]*\()?([a-z0-9+-]+)"  # a diagonal: by its corners first
        )
        found = re.search(program, waits[-1]) if waits else None
        return found[1] if found else ""

    until(lambda: bool(wanted()) or (folder / "result.json").exists(), log, 300.0)
    return "" if (folder / "result.json").exists() else wanted()


@contextmanager
def daemon(survey: Path) -> Iterator[Path]:
    """Run ``stepdiag run`` beside the machine; it must end cleanly when it is told to."""
    log = survey.parent / "daemon.log"
    with log.open("wb") as output:
        process = subprocess.Popen(
            [sys.executable, "-m", "stepdiag", "run", str(survey)],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
        )
    try:
        until(lambda: b"ready" in log.read_bytes() or process.poll() is not None, log)
        yield log
    finally:
        process.terminate()
        assert process.wait(60.0) == 0, log.read_text(errors="replace")


def until(done: Callable[[], bool], log: Path, timeout_s: float = 60.0) -> None:
    ends_s = time.monotonic() + timeout_s
    while not done():
        assert time.monotonic() < ends_s, log.read_text(errors="replace")[-4000:]
        time.sleep(0.1)
