"""What the inputs of daq/capture are made of: series of numbers as reference files tell them, a
box, its diagonal."""

from typing import Any

from testkit.timeline import diagonal

Case = tuple[str, str, Any]
Series = list[Any]
BOX = {"size_mm": [300.0, 200.0, 100.0], "n": 2, "setup": "ppp", "outward": True}
NOMINAL = [round(each.reading, 4) for each in diagonal("ppp", n=2)]
SENSOR = '[environment.sensor]\nformat = "ptu300"\nport = "/dev/null2"\n'
FIXED = '[environment]\nsource = "fixed"\n'
UNCOMPENSATED = [["compensated = true\n", ""]]


def noise(count: int, seed: int, size: float = 0.2) -> Series:
    """Return noise of about that standard deviation."""
    return [["noise", count, seed, size]]


def added(*columns: Series) -> Series:
    """Return the sum of series, number by number."""
    return [["sum", *columns]]


def step(count: int, at: int, size: float) -> Series:
    """Return a step."""
    return [["same", at, 0.0], ["same", count - at, size]]


def spiked(series: Series, places: dict[int, float]) -> Series:
    """Return a series with other numbers at some places."""
    return [["with", series, *([at, round(value, 6)] for at, value in places.items())]]


def at_mm(mm: float, um: Series) -> Series:
    """Return readings in mm about a level, from series in um."""
    return [["scaled", mm, 1e-3, um]]
