"""Whether memory stays flat: a day of recording on a simulated clock, a week of links that are
lost; each in a process of its own."""

import asyncio
import gc
import logging
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import structlog

from benchmarks.bench_replay import BLOCK, SECOND_NS
from benchmarks.stand import SURVEY
from benchmarks.table import Row
from stepdiag.base.messages import message
from stepdiag.daq.records.events import Chunk, ModbusBlock

if TYPE_CHECKING:
    from stepdiag.daq.recording.session import Session

LINES_HZ, POLL_HZ = 40, 2
"""Much slower than at the machine, so that a day passes in a minute or two; every bound of the
program is one of time or of number.

What would be kept of every poll, or of every chunk, shows in the count of objects, which a few
megabytes of noise cannot hide."""
MOST_OBJECTS = 10_000
"""More than these kept in a day are something kept of every seventeenth poll."""
PASS_S, PAUSE_S = 3600, 10
"""A pass an hour, each in a log of its own."""
LOST_A_DAY, MB_A_DAY = 2160, 1.0
"""A link that is lost every 40 s; by how much memory may grow in a day of them. The first day's is
not counted: caches fill."""
_WAIT_S = 0.002
"""Between two attempts here, where the recorder waits 0.05 to 1 s."""


def rows(hours: float) -> list[Row]:
    """Return the row of a long survey."""
    command = [sys.executable, "-m", "benchmarks.bench_memory", str(hours)]
    first, last, objects, lasted = map(
        float,
        subprocess.run(command, check=True, capture_output=True, text=True).stdout.split(),
    )
    grown = last - first
    return [
        Row(
            f"memory over {hours:g} hours, simulated in {lasted:.0f} s",
            f"{last:.0f} MB, grown by {grown:.1f} MB and {objects:.0f} objects",
            f"first pass: {first:.0f} MB, {hours * 3600 * POLL_HZ:.0f} polls",
            goal=f"within 5 MB and {MOST_OBJECTS} objects",
            met=grown <= 5 and objects <= MOST_OBJECTS,
        ),
        _lost_links(7 if hours >= 24 else 2),
    ]


def _lost_links(days: int) -> Row:
    """Return the row of links that are lost for so many days."""
    command = [sys.executable, "-m", "benchmarks.bench_memory", "lost", str(days)]
    first, last, lasted = map(
        float,
        subprocess.run(command, check=True, capture_output=True, text=True).stdout.split(),
    )
    slope = (last - first) / (days - 1)
    return Row(
        f"memory over {days} days with the laser lost every 40 s, in {lasted:.0f} s",
        f"{last:.1f} MB, {slope:.2f} MB a day",
        f"after the first day: {first:.1f} MB; {days * LOST_A_DAY} times lost, the machine "
        "beside it",
        goal=f"{MB_A_DAY:g} MB a day",
        met=slope <= MB_A_DAY,
    )


def resident_mb() -> float:
    """Return the memory of this process that is resident now."""
    return int(Path("/proc/self/status").read_text().partition("VmRSS:")[2].split()[0]) / 1024


def simulate(hours: float, folder: Path) -> tuple[float, float, int]:
    """Run session and recorder over so many hours; return the memory at the end of the first pass
    and of the last, and by how many objects the process has grown between them.
    """
    from stepdiag.daq.log.recorder import Recorder
    from stepdiag.daq.recording.session import Round, Session
    from stepdiag.daq.survey.file import parse_survey

    text = SURVEY.format(laser="/dev/ttyUSB0", plc_port=502, page="false", page_port=8420)
    recorder = Recorder(lambda _: None)
    begun = Round(folder / "0001", {"machine": "bench"})
    session = Session(
        parse_survey(text, "bench"),
        text,
        begun,
        recorder,
        on_outcome=lambda _: None,
        wall_offset_ns=lambda: 10**18,
    )
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
        lines = b"".join(
            b"100000 100000 %d 0 0 %d %d %d\r\n" % (1000 + at % 7, at, *_code(at))
            for at in range(number, number + per)
        )
        at_ns = begin + poll * step
        session.consume(Chunk("laser", at_ns, lines))
        words = [
            second & 0xFFFF,
            0,
            2 * (second % PASS_S < PASS_S - PAUSE_S),
            1,
            *[0] * 6,
            2000,
            2000,
            10130,
            500,
        ]
        session.consume(
            ModbusBlock(
                at_ns + 1000,
                at_ns + 401_000,
                BLOCK,
                (b"".join(word.to_bytes(2, "big") for word in words),),
            )
        )


def _code(number: int) -> tuple[int, int]:
    return {2: (8, LINES_HZ * 100), 3: (10, 6000)}.get(number % 32, (0, 0))


async def lose(days: int, folder: Path) -> tuple[float, float]:
    """Keep real links to a laser and a machine that go away at once; return the memory after the
    first day and after the last."""
    from stepdiag.daq.links import reconnect
    from stepdiag.daq.log.recorder import Recorder
    from stepdiag.daq.recording.session import Round, Session
    from stepdiag.daq.recording.survey_links import SurveyLinks
    from stepdiag.daq.records.events import Event, LinkEvent
    from stepdiag.daq.survey.file import parse_survey

    structlog.configure(
        wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL)
    )  # the figures stand alone on the output
    reconnect.FIRST_WAIT_S = reconnect.LONGEST_WAIT_S = _WAIT_S
    command = [sys.executable, "-m", "benchmarks.bench_memory", "away"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as away:  # noqa: ASYNC220  # nothing runs beside it yet
        assert away.stdout is not None
        laser, machine = map(int, away.stdout.readline().split())
        text = SURVEY.format(
            laser=f"socket://127.0.0.1:{laser}",
            plc_port=machine,
            page="false",
            page_port=8420,
        )
        survey, recorder = parse_survey(text, "bench"), Recorder(lambda _: None)
        begun = Round(folder / "0001", {"machine": "bench"})
        session = Session(
            survey,
            text,
            begun,
            recorder,
            on_outcome=lambda _: None,
            wall_offset_ns=lambda: 10**18,
        )
        lost, told = 0, list[float]()

        def consume(event: Event) -> None:
            nonlocal lost
            session.consume(event)
            if (
                isinstance(event, LinkEvent)
                and event.link == "laser"
                and event.state == "lost"
            ):
                lost += 1
                if lost % LOST_A_DAY == 0:
                    gc.collect()
                    told.append(resident_mb())

        keeping = asyncio.create_task(SurveyLinks(survey, consume).run())
        try:
            while len(told) < days:  # counted where the events come
                await asyncio.sleep(0.1)
                if keeping.done():
                    keeping.result()
        finally:
            keeping.cancel()
            away.kill()
            session.close(message("closed-stopped"))
            recorder.stop(60)
    return told[0], told[-1]


async def go_away() -> None:
    """Be a laser that sends two lines and a machine that answers once; print their ports."""

    async def laser(_: asyncio.StreamReader, to: asyncio.StreamWriter) -> None:
        to.write(
            b"".join(b"100000 100000 %d 0 0 %d 0 0\r\n" % (1000 + at, at) for at in range(2))
        )
        to.close()

    async def machine(asked: asyncio.StreamReader, to: asyncio.StreamWriter) -> None:
        head = await asked.readexactly(12)
        data = bytes(2 * int.from_bytes(head[10:12], "big"))
        to.write(
            head[:2]
            + struct.pack(">HHBBB", 0, 3 + len(data), head[6], head[7], len(data))
            + data
        )
        to.close()

    servers = [await asyncio.start_server(each, "127.0.0.1", 0) for each in (laser, machine)]
    sys.stdout.write(
        " ".join(str(each.sockets[0].getsockname()[1]) for each in servers) + "\n"
    )
    sys.stdout.flush()
    await asyncio.Event().wait()


def main() -> None:
    """Simulate and print memory at the beginning, at the end, objects gained where they are
    counted, and how long it took."""
    if sys.argv[1] == "away":
        asyncio.run(go_away())
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        told = (
            asyncio.run(lose(int(sys.argv[2]), Path(name)))
            if sys.argv[1] == "lost"
            else simulate(float(sys.argv[1]), Path(name))
        )
    sys.stdout.write(f"{' '.join(map(str, told))} {time.monotonic() - began}\n")


if __name__ == "__main__":
    main()
