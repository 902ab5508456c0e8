"""What is said to people, in every language.

In: a code. Out: a sentence. Imported by page, report and daemon.
"""

from stepdiag.texts.texts import LANGUAGES, Language, catalogue, finding_advice, localised

__all__ = ["LANGUAGES", "Language", "catalogue", "finding_advice", "localised"]
