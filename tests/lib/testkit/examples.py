"""How many examples a property test draws where each is a whole solve or log: few in every run,
more in `make explore`."""

from typing import Any

from hypothesis import settings

MORE = 10
"""So many times as many with ``--hypothesis-profile explore``: a number that a test gives itself
stands before that of any profile."""


def few(examples: int, **more: Any) -> settings:
    """Return settings with so many examples; ``more`` as of hypothesis."""
    return settings(
        max_examples=examples * (MORE if settings.get_current_profile_name() == "explore" else 1),
        **more,
    )
