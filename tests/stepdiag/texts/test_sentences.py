"""German out of English sentences: whole or not at all, with its arguments and its comma."""

import re

import pytest

from stepdiag.texts import catalogue, localised
from stepdiag.texts.explained import explanations
from stepdiag.texts.findings import advice_of, place_of, ranges, sentence
from stepdiag.texts.sentences import TOLD, is_known, translated
from testkit.german import is_english

SENTENCES = catalogue("sentence", "en")


@pytest.mark.parametrize("key", SENTENCES)
def test_every_sentence_reads_in_german(key: str) -> None:
    """The English pattern finds itself; all arguments arrive; no English word stays."""
    german = catalogue("sentence", "de")[key]
    names = re.findall(r"\{(\w+)\}", SENTENCES[key])
    assert sorted(set(names)) == sorted(set(re.findall(r"\{(\w+)\}", german)))
    given = {name: "firmware 7" if name in TOLD else f"X{index}" for index, name in enumerate(dict.fromkeys(names))}
    assert is_known(SENTENCES[key].format(**given))
    assert translated(SENTENCES[key].format(**given), "de") == german.format(
        **{name: value.replace("firmware", "Firmware") for name, value in given.items()}
    )
    assert not is_english(translated(SENTENCES[key].format(**given), "de"))


MAY_BE = "pass 1: stops 5, 6 may be off ({why}): to make sure, {again}, or accept it"
STEP = "a step of +2.5 um inside the dwell: a slip of the count, a jerk of the machine, or the mirror"
READ = [
    "pass 1: stops 5, 6 do not reach back to the start (beam lost, laser head error): drive again from stop 4 on, or the whole pass",
    "stops 5 do not go with the others: the stops measured twice disagree by 2.5 um, the mirror was moved: drive the whole pass again",
    MAY_BE.format(why=STEP, again="drive again from stop 2 on"),
    MAY_BE.format(why="2.5 of 40 samples lie far from the others: more than noise explains", again="drive the whole pass again"),
    MAY_BE.format(why="the laser sent one value 2.5 times of 41: it is frozen", again="drive the whole pass again"),
    "air_temperature_c reads 2.5 C after 20.1 C, 12 s ago: 20.1 C is held, u = 0.3 C; check the sensor, or solve with --environment FILE",
    "12 events (2.5 bytes) were not recorded: the disk is full",
    "laser: 2.5 samples missing between counts 65203 and 65205",
    "laser: the count went from 6 to 2.5: the instrument began anew",
    "the spot is off its detector in 2.5 of 16 samples of the dwell",
]


@pytest.mark.parametrize("text", READ)
def test_what_the_recording_says_reads_in_german_with_its_figures(text: str) -> None:
    """A reason of a setup, a doubt, a finding: none stays English, and none is told by its code alone without its figures."""
    assert is_known(text)
    german = translated(text, "de")
    assert not is_english(german), german
    assert "2,5" in german or "5, 6" in german


@pytest.mark.parametrize("code", explanations())
def test_no_finding_is_half_english(code: str) -> None:
    """What no pattern knows is told by what the code means; its advice is German too."""
    said = sentence(code, "ppp out, stop 5 of 30: something that nobody has put into German yet", "de")
    assert said.startswith("ppp hin, Messpunkt 5: ")
    assert not is_english(said)
    assert not is_english(advice_of(code, "de"))


def test_a_sentence_within_a_sentence() -> None:
    """Reasons are lists of sentences with sentences in them."""
    english = (
        "pass 1: stops 5, 6 do not reach back to the start (no sample was seen for 1.5 s): drive again from stop 4 on, or the whole pass"
    )
    german = (
        "Durchgang 1: Messpunkte 5, 6 reichen nicht bis zum Anfang zurück (1,5 s lang kam kein Wert): "
        "ab Messpunkt 4 wiederholen oder den ganzen Durchgang"
    )
    assert translated(english, "de") == german
    assert translated(f"{english}; pass 2: stops 3 are missing: drive again from stop 2 on, or the whole pass", "de").startswith(
        f"{german}; "
    )
    assert translated(english, "en") == english


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
