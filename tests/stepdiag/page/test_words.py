"""Every word that the page's scripts and its frame ask for stands in the catalogue: what is missing
would show its own name."""

import re
from importlib.resources import files

import pytest

from stepdiag.texts import LANGUAGES, catalogue

STATIC = files("stepdiag.page") / "static"
ASKED = re.compile(r"""(?:\bsay\(|data-text=|data-label=)["']([a-z_0-9]+)["']""")


def asked() -> dict[str, str]:
    """Return the words that are asked for by their own name, with the file that does so."""
    sources = [each for each in STATIC.iterdir() if each.name.endswith((".js", ".html"))]
    return {
        word: each.name
        for each in sources
        for word in ASKED.findall(each.read_text(encoding="utf-8"))
    }


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_word_of_the_page_is_in_the_catalogue(language):
    found = asked()
    assert len(found) > 60
    known = catalogue("page", language)
    assert {word: place for word, place in found.items() if word not in known} == {}
