"""What a line says it has lost, as it is told: what is new alone, and not oftener than a person wants to hear it."""

from collections.abc import Mapping

EVERY_S = 60.0
"""A line with steady errors says so once in so long, with all of them since."""


class Losses:
    """Counts that only grow, since a line was opened, become what was lost since that was last said."""

    def __init__(self) -> None:
        self._said: dict[str, int] = {}
        self._rests_until_s = 0.0

    def news(self, counted: Mapping[str, int], now_s: float) -> str:
        """Return in words what was lost since this last returned something: the first at once, then at most every `EVERY_S`.

        ``counted`` holds how often each kind of loss came since the line was opened; its words have a place for ``{times}``.
        """
        more = {words: count - self._said.get(words, 0) for words, count in counted.items() if count > self._said.get(words, 0)}
        if not more or now_s < self._rests_until_s:
            return ""
        self._said |= counted
        self._rests_until_s = now_s + EVERY_S
        return "; ".join(words.format(times=f"{count} times") for words, count in more.items())
