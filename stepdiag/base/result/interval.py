"""A predicted value as an interval (k = 2), and its notation."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from stepdiag.base.messages import Message, message
from stepdiag.base.result.typed import Maybe, Named

When = Literal["before", "after"]
"""State of the machine to which a value belongs: before or after compensation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """A value in um. ``low_um`` and ``high_um`` are None if its uncertainty is unknown (results of
    version 1).

    ``within`` is the probability that the value is at most its tolerance (JCGM 106), None without
    a tolerance.
    """

    value_um: Annotated[float, Named("value")]
    low_um: Annotated[float | None, Named("low")] = None
    high_um: Annotated[float | None, Named("high")] = None
    within: Maybe[float] = None

    def shown(self) -> tuple[str, str]:
        """Return both limits of the interval as texts, rounded outwards so that rounding never
        makes the interval smaller; empty texts if the uncertainty is unknown."""
        if self.low_um is None or self.high_um is None:
            return "", ""
        decimals = decimals_of(self.high_um)
        power = 10.0**decimals
        low = math.floor(self.low_um * power + 1e-9) / power
        high = math.ceil(self.high_um * power - 1e-9) / power
        return f"{low:.{decimals}f}", f"{high:.{decimals}f}"

    def best(self) -> str:
        return f"{self.value_um:.{decimals_of(self.value_um)}f}"

    def words(self) -> Message:
        """Return the interval as a message; only the value if the uncertainty is unknown."""
        low, high = self.shown()
        return (
            message("interval", low=low, high=high)
            if low
            else message("value-or-more", value=self.best())
        )

    def bound(self) -> Message:
        """Return the upper limit of the largest error vector as a message."""
        high = self.shown()[1]
        return message("up-to", high=high) if high else self.words()


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldFigures:
    """Length of the error vector over the volume in um: root mean square and largest value."""

    rms_um: Interval
    largest_um: Interval


@dataclass(frozen=True, slots=True, kw_only=True)
class Predicted:
    """The predicted values of the volume before and after compensation, with and without the rigid
    motion of the whole volume."""

    without_rigid_motion: dict[When, FieldFigures]
    as_it_is: dict[When, FieldFigures]

    def parts(self) -> dict[str, dict[When, FieldFigures]]:
        """Return the values by their printed name: without rigid motion, and as it is."""
        return {"without rigid motion": self.without_rigid_motion, "as it is": self.as_it_is}


def decimals_of(um: float) -> int:
    """Return the number of decimals for a value in um: two digits, at most one decimal."""
    return 0 if abs(um) >= 9.95 else 1


def decimals_of_u(expanded: float) -> int:
    """Return the number of decimals of an expanded uncertainty and its value: two significant
    digits of U (JCGM 100:2008, 7.2.6)."""
    if not 0.0 < expanded < math.inf:
        return 2
    return max(0, 1 - int(f"{expanded:.1e}".partition("e")[2]))


def with_expanded(value: float, expanded: float, *, sign: str = "-") -> str:
    """Return a value with its U (k = 2) as a text; with ``sign`` "+", a positive value has a
    sign."""
    decimals = decimals_of_u(expanded)
    return f"{value:{sign}.{decimals}f} ± {expanded:.{decimals}f}"
