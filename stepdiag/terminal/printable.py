"""Texts from foreign files on a terminal."""


def printable(text: str) -> str:
    """Return a text without what a terminal would obey instead of show; line ends stay."""
    return "".join(letter if letter.isprintable() or letter == "\n" else "?" for letter in text)
