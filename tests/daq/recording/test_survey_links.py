"""What the links bring comes in the order in which it came about, whoever wakes the loop."""

import asyncio

import pytest

from stepdiag.daq.recording import survey_links
from stepdiag.daq.recording.survey_links import SurveyLinks
from stepdiag.daq.records.events import Chunk, LinkEvent
from stepdiag.daq.survey.file import parse_survey
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
    return isinstance(event, LinkEvent) and event.link == "laser" and event.state == "connected"


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
        wait_until(lambda: b"".join(chunk.data for chunk in [*links._arrived]) == b"".join(said))
        pty.close()
        wait_until(lambda: any(map(lost, events)))

    async def run():
        links = SurveyLinks(
            parse_survey(SURVEY.format(laser=pty.name, plc=nobody()), "survey.toml"), events.append
        )
        task = asyncio.create_task(links.run())
        await asyncio.to_thread(pulled, links)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    asyncio.run(run())
    place = next(number for number, event in enumerate(events) if lost(event))
    before = b"".join(event.data for event in events[:place] if isinstance(event, Chunk))
    assert before == b"".join(said)
