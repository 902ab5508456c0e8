"""Is a text German throughout: no English word of a sentence stays in it."""

import re

from stepdiag.base.errors import StepdiagError
from stepdiag.base.messages import rendered

ENGLISH = re.compile(
    r"\b(the|and|of|was|were|stop|stops|pass|beam|count|with|not|this|from|again|drive|which|are|is)\b"
)
"""Words that no German sentence has ("was" is German too: it stands here for English only where
another one does)."""


def is_english(text: str) -> bool:
    """Tell whether a text holds English words; names, files, settings, codes, what stands in
    backquotes and "was" do not count."""
    bare = re.sub(r"\S*[._=/]\w\S*|`[^`]*`|\b[A-Z]+ and [A-Z]+\b|[a-z]+(-[a-z]+)+", " ", text)
    return bool(set(ENGLISH.findall(bare.lower())) - {"was"})


def in_german(refusal: StepdiagError) -> str:
    """Return what a refusal says in German; it must say it whole."""
    said = rendered(refusal.message, "de")
    assert not is_english(said), said
    return said
