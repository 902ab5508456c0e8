"""A predicted figure as an interval (k = 2), and the one way in which it is written wherever a person reads it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """A figure in um; ``low_um`` and ``high_um`` are None where nothing states how sure it is (a result of version 1)."""

    value_um: float
    low_um: float | None = None
    high_um: float | None = None

    def shown(self) -> tuple[str, str]:
        """Return low and high as written everywhere, rounded outwards so that rounding never promises more; empty where unknown."""
        if self.low_um is None or self.high_um is None:
            return "", ""
        decimals = decimals_of(self.high_um)
        power = 10.0**decimals
        low = math.floor(self.low_um * power + 1e-9) / power
        high = math.ceil(self.high_um * power - 1e-9) / power
        return f"{low:.{decimals}f}", f"{high:.{decimals}f}"

    def best(self) -> str:
        """Return the value alone as written everywhere."""
        return f"{self.value_um:.{decimals_of(self.value_um)}f}"

    def words(self) -> str:
        """Return the interval in English, the value alone where nothing states how sure it is."""
        low, high = self.shown()
        return f"{low} to {high}" if low else f"{self.best()} or more"

    def bound(self) -> str:
        """Return what a largest vector is at most, in English: how small it may be is no promise."""
        high = self.shown()[1]
        return f"up to {high}" if high else self.words()

    def as_json(self) -> dict[str, float | None]:
        """Return the form of contract 4."""
        return {"value": self.value_um, "low": self.low_um, "high": self.high_um}


def decimals_of(um: float) -> int:
    """Return how many decimals a figure in um is worth: two digits, a tenth at the finest."""
    return 0 if abs(um) >= 9.95 else 1


def interval_of(figure: object) -> Interval | None:
    """Return a figure of ``predicted`` (contract 4, version 2; a bare number before), or None where it is none."""
    if isinstance(figure, int | float) and not isinstance(figure, bool):
        return Interval(value_um=float(figure))
    if not isinstance(figure, Mapping) or not isinstance(figure.get("value"), int | float):
        return None
    low, high = figure.get("low"), figure.get("high")
    if isinstance(low, int | float) and isinstance(high, int | float):
        return Interval(value_um=float(figure["value"]), low_um=float(low), high_um=float(high))
    return Interval(value_um=float(figure["value"]))
