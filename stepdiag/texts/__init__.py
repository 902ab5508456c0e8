"""The texts for people in every language: the sentences of messages, the words of page and report.

This package imports no other package of the program, so every package may import it.
"""

from stepdiag.texts.explained import finding_advice
from stepdiag.texts.texts import LANGUAGES, Language, catalogue, localised

__all__ = ["LANGUAGES", "Language", "catalogue", "finding_advice", "localised"]
