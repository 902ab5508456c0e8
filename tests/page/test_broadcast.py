"""The broadcaster without a browser: who is slow gets the latest, nobody gets a backlog, nothing
runs when nobody looks on."""

import asyncio
import json
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from stepdiag.page.broadcast import Broadcaster, Mailbox
from testkit.played import PlayedSurvey


def events(received: bytes) -> list[tuple[str, dict[str, object]]]:
    """Return the named events of a piece of stream."""
    blocks = [
        dict(line.split(": ", 1) for line in block.split("\n"))
        for block in received.decode().strip().split("\n\n")
    ]
    return [
        (block["event"], json.loads(block["data"])) for block in blocks if "event" in block
    ]


@given(
    st.lists(
        st.tuples(st.sampled_from(["now", "survey"]), st.integers(0, 999)),
        min_size=1,
        max_size=50,
    )
)
def test_a_mailbox_holds_the_newest_of_each_kind(puts: list[tuple[str, int]]) -> None:
    """However much comes in while a reader is slow, it fetches one event of each kind: the last."""

    async def fetch() -> bytes:
        mailbox = Mailbox()
        for kind, number in puts:
            mailbox.put(kind, b"%s%d;" % (kind.encode(), number))
        mailbox.close()
        return b"".join([piece async for piece in mailbox.events()])

    fetched = asyncio.run(fetch()).decode().strip(";").split(";")
    assert sorted(fetched) == sorted(f"{kind}{number}" for kind, number in dict(puts).items())


def test_the_first_piece_shows_the_whole_survey(tmp_path: Path) -> None:
    """A reader needs nothing that was sent before it came; stops are sent again only when they
    change."""

    async def look() -> list[list[tuple[str, dict[str, object]]]]:
        survey = PlayedSurvey(tmp_path)
        broadcaster = Broadcaster(lambda _: None)
        stream = broadcaster.stream()
        pieces = []
        for number in range(6):
            piece = asyncio.create_task(anext(stream))
            await asyncio.sleep(0)
            if number == 3:
                survey.stop("npp", 1, 0)
            broadcaster.show(survey.snapshot())
            pieces.append(events(await piece))
        await stream.aclose()
        return pieces

    pieces = asyncio.run(look())
    assert [kind for kind, _ in pieces[0]] == ["survey", "now"]
    assert pieces[0][0][1]["machine"] == "VM 500"
    assert sum(kind == "survey" for piece in pieces for kind, _ in piece) == 2
    assert all(piece[-1][0] == "now" for piece in pieces)


def test_it_says_when_the_first_reader_comes_and_the_last_has_gone() -> None:
    """So nothing is made for nobody."""

    async def look() -> list[bool]:
        heard: list[bool] = []
        broadcaster = Broadcaster(heard.append)
        streams = [broadcaster.stream() for _ in range(2)]
        readings = [asyncio.create_task(anext(stream)) for stream in streams]
        await asyncio.sleep(0)
        assert heard == [True]
        broadcaster.close()
        for reading, stream in zip(readings, streams, strict=True):
            reading.cancel()
            await asyncio.gather(reading, return_exceptions=True)
            await stream.aclose()
        return heard

    assert asyncio.run(look()) == [True, False]
