"""Instruments that number their samples and send nothing at power-on."""


class Counting:
    """The counter of samples in an instrument that numbers them (`talker.Talking`). It begins at 0,
    and samples that nobody reads are counted too.
    """

    def __init__(self) -> None:
        self._counter = 0

    def banner(self) -> bytes:
        """Start the counter again; return no bytes."""
        self._counter = 0
        return b""

    def skip(self, count: int) -> None:
        """Advance the counter by samples that are not sent."""
        self._counter += count
