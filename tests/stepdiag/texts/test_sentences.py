"""German out of English sentences: whole or not at all, with its arguments and its comma."""

import re

import pytest

from stepdiag.base.messages import Message, Place, at, joined, message, rendered
from stepdiag.texts import catalogue, localised
from stepdiag.texts.explained import explanations
from stepdiag.texts.findings import advice_of, place_of, ranges, sentence
from stepdiag.texts.sentences import NESTED, is_known, translated
from testkit.german import is_english

SENTENCES = catalogue("sentence", "en")


@pytest.mark.parametrize("key", SENTENCES)
def test_every_sentence_reads_in_german(key: str) -> None:
    """The English pattern finds itself; all arguments arrive; no English word stays."""
    german = catalogue("sentence", "de")[key]
    names = re.findall(r"\{(\w+)\}", SENTENCES[key])
    assert sorted(set(names)) == sorted(set(re.findall(r"\{(\w+)\}", german)))
    given = {name: "firmware 7" if name in NESTED else f"X{index}" for index, name in enumerate(dict.fromkeys(names))}
    assert is_known(SENTENCES[key].format(**given))
    assert translated(SENTENCES[key].format(**given), "de") == german.format(
        **{name: value.replace("firmware", "Firmware") for name, value in given.items()}
    )
    assert not is_english(translated(SENTENCES[key].format(**given), "de"))


STEP = message("window-step", step_um=2.5)
LOST = message("losses", causes=[message("beam-was-lost"), message("laser-head-error")])
READ = [
    message("pass-why", number=1, why=message("stops-without-start", stops="5, 6", why=LOST, again=message("again-from-or-whole", stop=4))),
    message("stops-misfit", stops="5", misfit_um=2.5),
    message("pass-why", number=1, why=message("stops-off", stops="5, 6", why=STEP, stop=2)),
    joined([STEP, message("window-step.strays", wrong=25, count=40), message("laser-frozen", same=20, count=41)]),
    at(Place(setup="ppp", way="back", stop=5, last=30), message("beam-lost", why=message("no-sample-for", seconds_s=2.5))),
    message("recording-gap", events=12, bytes=25, why=message("disk-slower")),
    message("of-stream", stream=message("stream-laser"), what=message("samples-between", count=2, a=65203, b=65205)),
    message("bytes-lost-at", causes=[message("lost-framing", count=4)]),
]


@pytest.mark.parametrize("said", READ, ids=lambda said: said.key)
def test_what_the_recording_says_reads_in_german_with_its_figures(said: Message) -> None:
    """A reason of a setup, a doubt, a finding: none stays English, however deep it is nested."""
    german = rendered(said, "de")
    assert not is_english(german), german
    assert re.findall(r"\d+", german) == re.findall(r"\d+", rendered(said, "en"))


@pytest.mark.parametrize("code", explanations())
def test_no_finding_is_half_english(code: str) -> None:
    """What no pattern knows is told by what the code means; its advice is German too."""
    said = sentence(code, "ppp out, stop 5 of 30: something that nobody has put into German yet", "de")
    assert said.startswith("ppp hin, Messpunkt 5: ")
    assert not is_english(said)
    assert not is_english(advice_of(code, "de"))


def test_the_place_of_a_finding() -> None:
    """Setup, way and stop are read from the sentence; what has no place stays whole."""
    place = place_of("npp+1 back, stop 7 of 30: the count was lost")
    assert (place.run, place.stop, place.rest) == ("npp+1 back", 7, "the count was lost")
    assert place_of("laser: firmware 264").run == ""
    assert ranges([5, 6, 7, 9, 11, 12]) == "5–7, 9, 11–12"


@pytest.mark.parametrize(
    ("text", "german"),
    [
        ("1.5 µm", "1,5 µm"),
        ("stepdiag 0.1.0", "stepdiag 0.1.0"),
        ("192.168.1.10", "192.168.1.10"),
        ("−20.05", "−20,05"),
        ("Ende 5.", "Ende 5."),
    ],
)
def test_only_numbers_get_a_comma(text: str, german: str) -> None:
    """Versions, addresses and the ends of sentences keep their points."""
    assert localised(text, "de") == german
    assert localised(text, "en") == text
