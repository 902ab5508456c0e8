"""How many examples a property test draws where each is a whole solve or log: few in every run,
more in `make explore`."""

from collections.abc import Sequence
from typing import Any, TypeVar

from hypothesis import settings

MORE = 10
"""So many times as many with ``--hypothesis-profile explore``: a number that a test gives itself
stands before that of any profile."""


Case = TypeVar("Case")


def exploring() -> bool:
    """Return whether these are the tests of `make explore`."""
    return settings.get_current_profile_name() == "explore"


def spread(cases: Sequence[Case], every: int) -> list[Case]:
    """Return one case of so many, all in `make explore`."""
    return list(cases[:: 1 if exploring() else every])


def few(examples: int, **more: Any) -> settings:
    """Return settings with so many examples; ``more`` as of hypothesis."""
    return settings(
        max_examples=examples * (MORE if exploring() else 1),
        **more,
    )
