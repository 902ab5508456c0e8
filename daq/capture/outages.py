"""Times at which the link of an instrument was down: findings name this cause of a missing reading
instead of its symptoms.
"""

import math
from collections.abc import Collection

from stepdiag.base.messages import Message, message
from stepdiag.daq.records.events import Link, LinkEvent

LINK_DOWN: dict[Link, Message] = {
    "laser": message("samples-missing.laser"),
    "head": message("samples-missing.head"),
}
"""Message of a lost link, by link; reported once per outage."""


class Outages:
    """Follows the links of a log. ``down`` are the links that were down at the beginning of the
    log.
    """

    def __init__(self, down: Collection[Link] = ()) -> None:
        self._last: dict[Link, tuple[float, float]] = dict.fromkeys(
            down, (-math.inf, math.inf)
        )
        self._named: set[tuple[Link, float]] = set()

    def take(self, event: LinkEvent) -> None:
        """Record a change of a link; a silent link is an outage too."""
        begin, end = self._last.get(event.link, (0.0, -math.inf))
        if event.state == "connected":
            self._last[event.link] = begin, min(end, event.time_ns)
        elif end < math.inf:
            self._last[event.link] = event.time_ns, math.inf

    def covers(self, link: Link, from_ns: int, to_ns: int) -> bool:
        """Return whether a link was down at any time from ``from_ns`` to ``to_ns``."""
        begin, end = self._last.get(link, (0.0, -math.inf))
        return begin <= to_ns and end >= from_ns

    def news(self, link: Link) -> bool:
        """Return whether a loss on the link is new: each outage counts once."""
        this = link, self._last[link][0]
        new = this not in self._named
        self._named.add(this)
        return new
