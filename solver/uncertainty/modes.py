"""A covariance in few modes: those that matter most over the volume, and what is left as values that differ each by itself."""

from dataclasses import dataclass

import numpy as np

from stepdiag.solver.geometry.volume import Vector
from stepdiag.solver.linear.families import Family
from stepdiag.solver.result.posterior import UnknownSize

TOLD = 0.995
"""A mode more is written until they hold this share of the variance over the volume."""
UNSEEN = 1e-3
"""A direction of which no likely size shows by more than this share of its variance is not seen: all such are alike."""


@dataclass(frozen=True, eq=False)
class BySize:
    """Modes (k, modes) of causes of unknown size, how they reach at each size, and what is left of them (k,)."""

    modes: Vector
    sized: UnknownSize
    left: Vector

    @classmethod
    def nothing(cls, count: int) -> "BySize":
        """Return no modes of ``count`` values."""
        return cls(np.zeros((count, 0)), UnknownSize.nothing(), np.zeros(count))


def factored(found: Vector, fields: Vector, most: int) -> tuple[Vector, Vector]:
    """Return columns of which the products make a covariance (k, k), and the standard deviations (k,) of what they leave.

    ``fields`` (k, values) is what one unit of each of the k does over the volume. Each column is what goes with the value of the field that
    is least known beside the columns before; of equal ones the first, so that rounding does not choose. What is left keeps its mean
    square over the volume.
    """
    rest = found.copy()
    across = rest @ fields
    open_um2 = np.sum(across * fields, axis=0)
    total = float(np.sum(open_um2))
    columns: list[Vector] = []
    while len(columns) < most and float(np.sum(open_um2)) > (1.0 - TOLD) * total:
        pivot = int(np.argmax(open_um2 >= (1.0 - 1e-6) * np.max(open_um2)))
        column = across[:, pivot] / np.sqrt(open_um2[pivot])
        seen = column @ fields
        columns.append(column)
        rest -= np.outer(column, column)
        across -= np.outer(column, seen)
        open_um2 = np.maximum(open_um2 - seen**2, 0.0)
    return np.column_stack([np.zeros((len(found), 0)), *columns]), _each(np.diag(rest), float(np.sum(open_um2)), fields)


def _each(square: Vector, over_volume: float, fields: Vector) -> Vector:
    """Return standard deviations of values by themselves, all smaller by the factor that makes their mean square over the volume right."""
    alone = float(np.maximum(square, 0.0) @ np.sum(fields**2, axis=1))
    share = over_volume / alone if alone > 0 else 0.0
    found: Vector = np.sqrt(np.maximum(square, 0.0) * min(share, 1.0))
    return found


def by_size(direction: Vector, family: Family, fields: Vector, most: int) -> BySize:
    """Return directions (k, q) of a family as modes at the root of their mean square over all sizes.

    Those that the readings do not see have one scale for each size and no order of their own: they are factored like any covariance.
    """
    scale, shift = family.scale(), family.shift()
    unseen = family.seen * np.max(family.factor) ** 2 < UNSEEN
    size = np.sqrt(np.mean(family.factor**2))
    hidden, left = factored(size**2 * direction[:, unseen] @ direction[:, unseen].T, fields, most)
    usual = np.sqrt(np.mean(scale[:, ~unseen] ** 2 + shift[:, ~unseen] ** 2, axis=0))
    seen = direction[:, ~unseen] * usual
    matters = np.sum((seen.T @ fields) ** 2, axis=1)
    order = np.argsort(-matters, kind="stable")
    share = np.cumsum(matters[order]) / max(float(np.sum(matters)), 1e-30)
    kept, dropped = np.split(order, [min(most, int(np.searchsorted(share, TOLD)) + 1)])
    seen, turned = _turned(seen, fields)
    more = _each(np.sum(seen[:, dropped] ** 2, axis=1), float(np.sum(matters[dropped])), fields)
    safe = np.where(usual > 0, usual, 1.0)
    sized = UnknownSize(
        scale=np.column_stack([np.repeat(family.factor[:, None] / size, hidden.shape[1], axis=1), (scale[:, ~unseen] / safe)[:, kept]]),
        shift=np.column_stack([np.zeros((len(scale), hidden.shape[1])), (turned * shift[:, ~unseen] / safe)[:, kept]]),
    )
    return BySize(np.column_stack([hidden, seen[:, kept]]), sized, np.hypot(left, more))


def _turned(modes: Vector, fields: Vector) -> tuple[Vector, Vector]:
    """Return modes with the sign in which they do most over the volume made positive, and those signs: an eigenvector has none."""
    done = modes.T @ fields
    largest = np.argmax(np.abs(done) >= (1.0 - 1e-6) * np.max(np.abs(done), axis=1, initial=0.0)[:, None], axis=1)
    sign = np.where(done[np.arange(len(done)), largest] < 0, -1.0, 1.0)
    return modes * sign, sign
