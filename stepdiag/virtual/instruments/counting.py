"""Instruments that number their samples and send nothing at power-on."""


class Counting:
    """The counter of such an instrument (`talker.Talking`): it begins at 0, and unread samples are
    counted too.
    """

    def __init__(self) -> None:
        self._counter = 0

    def banner(self) -> bytes:
        """Return nothing: the counter starts again."""
        self._counter = 0
        return b""

    def skip(self, count: int) -> None:
        """Advance the counter."""
        self._counter += count
