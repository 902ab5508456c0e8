"""What the links bring comes in the order in which it came about, whoever wakes the loop."""

import asyncio

import pytest

from stepdiag.daq.recording import survey_links
from stepdiag.daq.recording.survey_links import SurveyLinks
from stepdiag.daq.records.events import Chunk, LinkEvent
from stepdiag.daq.survey.file import parse_survey
from stepdiag.daq.timing.host_clock import now_ns
from stepdiag.virtual.base.reserved import reserved_port
from testkit.running.slaves import Pty, wait_until

SURVEY = """
[survey]
name = "wires"
machine = "none"
[volume]
size_mm = [300.0, 200.0, 100.0]
increments = 10
[laser]
format = "umd"
port = "{laser}"
[plc]
port = {plc}
"""


@pytest.fixture
def pty():
    line = Pty()
    yield line
    line.close()


def nobody():
    """Return a port where nobody listens."""
    return reserved_port()


def connected(event):
    return (
        isinstance(event, LinkEvent) and event.link == "laser" and event.state == "connected"
    )


def lost(event):
    return isinstance(event, LinkEvent) and event.link == "laser" and event.state == "lost"


def test_a_loss_is_told_after_the_bytes_that_came_before_it(pty, monkeypatch):
    """Bytes wait until the loop is awake anyway; the word of the loss would overtake them."""
    monkeypatch.setattr(survey_links, "WAKE_NS", 10**12)
    events, said = [], [b"1 2 3 4 5 %d 0 0\r\n" % number for number in range(50)]

    def pulled(links):
        wait_until(lambda: any(map(connected, events)))
        for line in said:
            pty.write(line)
        wait_until(
            lambda: b"".join(chunk.data for chunk in [*links._arrived]) == b"".join(said)
        )
        pty.close()
        wait_until(lambda: any(map(lost, events)))

    async def run():
        links = SurveyLinks(
            parse_survey(SURVEY.format(laser=pty.name, plc=nobody()), "survey.toml"),
            events.append,
        )
        task = asyncio.create_task(links.run())
        await asyncio.to_thread(pulled, links)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    asyncio.run(run())
    place = next(number for number, event in enumerate(events) if lost(event))
    before = b"".join(event.data for event in events[:place] if isinstance(event, Chunk))
    assert before == b"".join(said)


def test_while_a_machine_waits_a_chunk_is_collected_as_it_arrives(monkeypatch):
    """A look at the links between the request and the chunk does not make the chunk wait: the
    machine would wait for the next poll."""
    monkeypatch.setattr(survey_links, "WAKE_NS", 10**12)
    events = []

    async def run():
        links = SurveyLinks(
            parse_survey(SURVEY.format(laser="none", plc=1), "survey.toml"), events.append
        )
        arrived = links._receiver("laser")
        for number, asked in enumerate((links.collect, links.hurry)):
            asked()
            links.collect()
            await asyncio.to_thread(arrived, b"%d" % number, now_ns())
            await asyncio.sleep(0)
            assert len(events) == 2 * number

    asyncio.run(run())
