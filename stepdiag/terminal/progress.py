"""Progress on standard error during work of more than a second; nothing if standard error is not a
terminal."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from stepdiag.base.messages import Message
from stepdiag.terminal.viewer import shown

Item = TypeVar("Item")


@contextmanager
def working(doing: Message) -> Iterator[None]:
    """Show the name of the work and its progress until the block ends."""
    from rich.console import Console

    with Console(stderr=True).status(shown(doing)):
        yield


def counted(items: Iterable[Item], doing: Message, total: int) -> Iterator[Item]:
    """Yield the items while a bar shows the number of complete items out of ``total``."""
    from rich.console import Console
    from rich.progress import track

    yield from track(
        items,
        description=shown(doing),
        total=total,
        console=Console(stderr=True),
        transient=True,
    )
