"""Whether memory stays flat over a day: the recording's own code on a simulated clock, in a process of its own."""

import gc
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.bench_replay import BLOCK, SECOND_NS
from benchmarks.stand import SURVEY
from benchmarks.table import Row
from stepdiag.base.messages import message
from stepdiag.daq.records.events import Chunk, ModbusBlock

if TYPE_CHECKING:
    from stepdiag.daq.recording.session import Session

LINES_HZ, POLL_HZ = 40, 2
"""Much slower than at the machine, so that a day passes in a minute or two; every bound of the program is one of time or of number.

What would be kept of every poll, or of every chunk, shows in the count of objects, which a few megabytes of noise cannot hide."""
MOST_OBJECTS = 10_000
"""More than these kept in a day are something kept of every seventeenth poll."""
PASS_S, PAUSE_S = 3600, 10
"""A pass an hour, each in a log of its own."""


def rows(hours: float) -> list[Row]:
    """Return the row of a long survey."""
    command = [sys.executable, "-m", "benchmarks.bench_memory", str(hours)]
    told = map(float, subprocess.run(command, check=True, capture_output=True, text=True).stdout.split())
    first, last, objects, lasted = told
    grown = last - first
    return [
        Row(
            f"memory over {hours:g} hours, simulated in {lasted:.0f} s",
            f"{last:.0f} MB, grown by {grown:.1f} MB and {objects:.0f} objects",
            f"first pass: {first:.0f} MB, {hours * 3600 * POLL_HZ:.0f} polls",
            goal=f"within 5 MB and {MOST_OBJECTS} objects",
            met=grown <= 5 and objects <= MOST_OBJECTS,
        )
    ]


def resident_mb() -> float:
    """Return the memory of this process that is resident now."""
    return int(Path("/proc/self/status").read_text().partition("VmRSS:")[2].split()[0]) / 1024


def simulate(hours: float, folder: Path) -> tuple[float, float, int]:
    """Run session and recorder over so many hours; return the memory at the end of the first pass and of the last, and by how many objects
    the process has grown between them.
    """
    from stepdiag.daq.log.recorder import Recorder
    from stepdiag.daq.recording.session import Round, Session
    from stepdiag.daq.survey.file import parse_survey

    text = SURVEY.format(laser="/dev/ttyUSB0", plc_port=502, page="false", page_port=8420)
    recorder = Recorder(lambda _: None)
    begun = Round(folder / "0001", {"machine": "bench"})
    session = Session(parse_survey(text, "bench"), text, begun, recorder, on_outcome=lambda _: None, wall_offset_ns=lambda: 10**18)
    told: list[tuple[float, int]] = []
    for second in range(int(hours * 3600)):
        _second(session, second)
        while recorder.health.backlog_bytes > 1_000_000:
            time.sleep(0.001)
        if second % PASS_S == PASS_S - PAUSE_S // 2:
            gc.collect()
            told.append((resident_mb(), sys.getallocatedblocks()))
    session.close(message("closed-stopped"))
    recorder.stop(60)
    return told[0][0], told[-1][0], told[-1][1] - told[0][1]


def _second(session: "Session", second: int) -> None:
    begin = (second + 1) * SECOND_NS
    step = SECOND_NS // POLL_HZ
    per = LINES_HZ // POLL_HZ
    for poll in range(POLL_HZ):
        number = second * LINES_HZ + poll * per
        lines = b"".join(b"100000 100000 %d 0 0 %d %d %d\r\n" % (1000 + at % 7, at, *_code(at)) for at in range(number, number + per))
        at_ns = begin + poll * step
        session.consume(Chunk("laser", at_ns, lines))
        words = [second & 0xFFFF, 0, 2 * (second % PASS_S < PASS_S - PAUSE_S), 1, *[0] * 6, 2000, 2000, 10130, 500]
        session.consume(ModbusBlock(at_ns + 1000, at_ns + 401_000, BLOCK, (b"".join(word.to_bytes(2, "big") for word in words),)))


def _code(number: int) -> tuple[int, int]:
    return {2: (8, LINES_HZ * 100), 3: (10, 6000)}.get(number % 32, (0, 0))


def main() -> None:
    """Simulate and print memory at the beginning, at the end, objects gained, and how long it took."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        told = simulate(float(sys.argv[1]), Path(name))
    sys.stdout.write(f"{' '.join(map(str, told))} {time.monotonic() - began}\n")


if __name__ == "__main__":
    main()
