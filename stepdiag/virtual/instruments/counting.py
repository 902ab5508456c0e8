"""Instruments that number their samples and send nothing at power-on."""


class Counting:
    """The counter of samples in an instrument (`talker.Talking`). The counter begins at 0, and also
    counts samples that are not sent."""

    def __init__(self) -> None:
        self._counter = 0

    def banner(self) -> bytes:
        self._counter = 0
        return b""

    def skip(self, count: int) -> None:
        self._counter += count
