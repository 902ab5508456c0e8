"""What a line brings between two logs: said once where nothing of it makes a reading, by a clock
that the test holds."""

from stepdiag.daq.recording.listening import PATIENCE_NS, Listening
from stepdiag.daq.records.events import Chunk, LinkEvent
from stepdiag.daq.survey.file import parse_survey
from testkit.checked import LINE_SURVEY

GOOD = b"12.5 7 0.9\n"
NONSENSE = b"\xf8\x00\x9c\xe0\n"
S = 1_000_000_000


def said(listening, data, from_s, seconds):
    """Return what is said while a line brings this ten times a second."""
    chunks = [
        Chunk("laser", int((from_s + each / 10) * S), data)
        for each in range(int(10 * seconds))
    ]
    return [(found.code, found.text) for chunk in chunks for found in listening.take(chunk)]


def listening():
    return Listening(parse_survey(LINE_SURVEY, "s"))


def test_nonsense_is_said_once_after_a_while():
    ears = listening()
    assert said(ears, NONSENSE, 0, PATIENCE_NS / S - 0.1) == []
    ((code, text),) = said(ears, NONSENSE, PATIENCE_NS / S, 60)
    assert code == "bytes-garbled"
    assert "they begin with f8 00 9c e0" in text
    assert "check baud rate" in text


def test_who_was_understood_is_not_listened_to_until_the_line_was_lost():
    """A pass says by itself what it hears; a line that comes back may lead to another
    instrument."""
    ears = listening()
    assert said(ears, GOOD, 0, 1) + said(ears, NONSENSE, 1, 60) == []
    ears.take_link(LinkEvent(61 * S, "machine", "lost", ""))
    ears.take_link(LinkEvent(61 * S, "laser", "silent", ""))
    assert said(ears, NONSENSE, 62, 60) == []
    ears.take_link(LinkEvent(122 * S, "laser", "lost", ""))
    assert [code for code, _ in said(ears, NONSENSE, 123, 60)] == ["bytes-garbled"]


def test_a_line_that_is_lost_again_and_again_is_said_once():
    """Another product that hangs up on whoever comes."""
    ears, found = listening(), []
    for at in range(60):
        found += said(ears, NONSENSE, at, 0.5)
        ears.take_link(LinkEvent(at * S, "laser", "lost", ""))
    assert [code for code, _ in found] == ["bytes-garbled"]


def test_after_who_was_named_the_next_wrong_one_is_named_too():
    ears = listening()
    first = said(ears, NONSENSE, 0, 10)
    ears.take_link(LinkEvent(10 * S, "laser", "lost", ""))
    ((_, text),) = said(ears, b"login: ", 20, 60)
    assert len(first) == 1
    assert "they begin with 6c 6f 67 69 6e" in text


def test_noise_at_opening_does_not_accuse_the_instrument_that_gets_power_an_hour_later():
    ears = listening()
    assert said(ears, NONSENSE, 0, 0.3) == []
    assert said(ears, NONSENSE, 3600, 1) + said(ears, GOOD, 3601, 10) == []


def test_nonsense_seldom_sent_is_named():
    ears = listening()
    assert [
        code for at in range(0, 600, 60) for code, _ in said(ears, NONSENSE, at, 0.2)
    ] == ["bytes-garbled"]


def test_a_senseless_flood_is_no_longer_decoded_whole_once_it_is_named(monkeypatch):
    ears, taken = listening(), []
    ear = ears._ears["laser"]
    feed = ear.decoder.feed
    monkeypatch.setattr(
        ear.decoder, "feed", lambda data, at: (taken.append(len(data)), feed(data, at))[1]
    )
    assert len(said(ears, NONSENSE * 2000, 0, 5)) == 1
    taken.clear()
    assert said(ears, NONSENSE * 2000, 5, 20) == []
    assert sum(taken) <= 21 * 4096
    assert said(ears, GOOD * 2000, 25, 10) == []
    assert ear.understood


def test_an_instrument_that_answers_with_errors_alone_is_said_in_its_own_words():
    ears = Listening(parse_survey(LINE_SURVEY.replace("[-+.0-9]+", ".+"), "s"))
    assert [code for code, _ in said(ears, b"ERR 7 0.9\n", 0, 60)] == ["instrument-reports"]
