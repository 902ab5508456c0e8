"""The broadcaster without a browser: who is slow gets the latest, nobody gets a backlog, nothing runs when nobody looks on."""

import asyncio
import json
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from stepdiag.page.broadcast import FAST_FIELDS, SLOW_FIELDS, Broadcaster, Mailbox
from testkit.played import PlayedSurvey


def events(received: bytes) -> list[tuple[str, dict[str, object]]]:
    """Return the named events of a piece of stream."""
    blocks = [dict(line.split(": ", 1) for line in block.split("\n")) for block in received.decode().strip().split("\n\n")]
    return [(block["event"], json.loads(block["data"])) for block in blocks if "event" in block]


@given(st.lists(st.tuples(st.sampled_from(["now", "survey"]), st.integers(0, 999)), min_size=1, max_size=50))
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


def test_every_field_of_the_snapshot_is_sent_once() -> None:
    """The two events together hold the whole snapshot."""
    assert not set(FAST_FIELDS) & set(SLOW_FIELDS)
    assert "reading_mm" in FAST_FIELDS


def test_the_first_piece_shows_the_whole_survey(tmp_path: Path) -> None:
    """A reader needs nothing that was sent before it came; stops are sent again only when they change."""

    async def look() -> list[list[tuple[str, dict[str, object]]]]:
        survey = PlayedSurvey(tmp_path)
        broadcaster = Broadcaster(survey)
        pieces = []
        stream = broadcaster.stream()
        async for piece in stream:
            pieces.append(events(piece))
            if len(pieces) == 3:
                survey.stop("npp", 1, 0)
            if len(pieces) == 6:
                break
        await stream.aclose()
        assert broadcaster.readers == 0
        await broadcaster.close()
        return pieces

    pieces = asyncio.run(look())
    assert [kind for kind, _ in pieces[0]] == ["survey", "now"]
    assert pieces[0][0][1]["machine"] == "VM 500"
    assert sum(kind == "survey" for piece in pieces for kind, _ in piece) == 2
    assert all(piece[-1][0] == "now" for piece in pieces)


def test_nothing_runs_while_nobody_looks_on(tmp_path: Path) -> None:
    """No snapshot is taken before the first reader and none after the last."""

    async def look() -> tuple[int, int]:
        survey = PlayedSurvey(tmp_path)
        broadcaster = Broadcaster(survey)
        await asyncio.sleep(0.3)
        assert survey.snapshots_taken == 0
        stream = broadcaster.stream()
        await anext(stream)
        await stream.aclose()
        taken = survey.snapshots_taken
        await asyncio.sleep(0.5)
        after = survey.snapshots_taken
        await broadcaster.close()
        return taken, after

    taken, after = asyncio.run(look())
    assert taken == after


def test_a_failing_source_ends_the_streams(tmp_path: Path) -> None:
    """A page that would go on showing the last picture as if it were live is worse than none."""

    class Failing(PlayedSurvey):
        def snapshot(self):
            if self.snapshots_taken >= 3:
                raise RuntimeError("the daemon's fault")
            return super().snapshot()

    async def look() -> int:
        broadcaster = Broadcaster(Failing(tmp_path))
        pieces = [piece async for piece in broadcaster.stream()]
        return len(pieces)

    async def guarded() -> int:
        asyncio.get_running_loop().set_exception_handler(lambda *_: None)
        return await asyncio.wait_for(look(), 5)

    assert 1 <= asyncio.run(guarded()) <= 3
