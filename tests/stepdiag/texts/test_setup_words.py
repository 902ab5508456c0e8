"""Setups as a person reads them: a diagonal by its corners."""

import pytest

from stepdiag.base.setups import DRIVEN_SETUPS, setup_of
from stepdiag.texts.setup_words import setup_words


@pytest.mark.parametrize("name", DRIVEN_SETUPS)
@pytest.mark.parametrize("shift", ["", "+2"])
def test_words_agree_with_the_signs_of_the_travel(name: str, shift: str) -> None:
    """The way out ends at the side to which each axis moves, and begins at the other."""
    words = setup_words(name + shift, "en")
    assert words.endswith(f" ({name}{shift})")
    signs = {
        letter: sign for letter, sign in zip("XYZ", setup_of(name).signs, strict=True) if sign
    }
    if setup_of(name).axis:
        assert words.split(" (", maxsplit=1)[0].endswith(
            f" run {setup_of(name).axis.upper()}"
        )
        return
    begin, end = words.split(" (", maxsplit=1)[0].rsplit(" ", 3)[1::2]
    assert end == "".join(f"{axis}{'+' if sign > 0 else '-'}" for axis, sign in signs.items())
    assert begin == "".join(
        f"{axis}{'-' if sign > 0 else '+'}" for axis, sign in signs.items()
    )


@pytest.mark.parametrize(
    "name", ["", "two", "ppq", "face-xy-ppp", "linear-a", "body-pp", "x"]
)
def test_any_other_name_stands_as_it_is(name: str) -> None:
    """A file of another program may name a setup as it likes."""
    assert setup_words(name, "de") == name
