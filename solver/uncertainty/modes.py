"""A covariance as a few modes with the largest effect over the volume, and independent values
for the rest."""

from dataclasses import dataclass

import numpy as np

from stepdiag.base.result.posterior import UnknownSize
from stepdiag.base.volume import Vector
from stepdiag.solver.linear.families import Family, class_factors
from stepdiag.solver.linear.ties import first_of_the_largest

KEPT_SHARE = 0.995
"""Share of the variance over the volume that the modes must contain."""
UNSEEN = 1e-3
"""A direction counts as determined if the readings reduce its variance at the largest likely size
by at least this share. All undetermined directions form one group."""
ROUNDING = 1e-9
"""Share of the largest value below which a value is rounding."""


@dataclass(frozen=True, eq=False)
class BySize:
    """Modes (k, modes) of random effects of unknown size, the factors of the modes at each size,
    and the standard deviations (k,) of the rest."""

    modes: Vector
    sized: UnknownSize
    left: Vector

    @classmethod
    def nothing(cls, count: int) -> "BySize":
        """Return an empty set of modes for ``count`` values."""
        return cls(np.zeros((count, 0)), UnknownSize.nothing(), np.zeros(count))

    def beside(self, other: "BySize") -> "BySize":
        """Return the modes of both sets; each set has its own size."""
        first, second = self.sized, other.sized
        sizes = max(len(first.scale), len(second.scale))
        sized = UnknownSize(
            scale=_size_columns(sizes, first.scale, second.scale),
            shift=_size_columns(sizes, first.shift, second.shift),
        )
        modes = np.hstack([self.modes, other.modes])
        return BySize(modes, sized, np.hypot(self.left, other.left))


def _size_columns(sizes: int, first: Vector, second: Vector) -> Vector:
    return np.hstack(
        [np.broadcast_to(part, (sizes, part.shape[1])) for part in (first, second)]
    )


def factored(found: Vector, fields: Vector, most: int) -> tuple[Vector, Vector]:
    """Return columns whose products approximate a covariance (k, k), and the standard deviations
    (k,) of the rest.

    ``fields`` (k, values) is the effect of one unit of each of the k values over the volume. Each
    new column removes the largest remaining variance among the values over the volume. Among equal
    values the first is chosen, so that rounding does not decide. The mean square of the rest over
    the volume is exact.
    """
    return _factored(np.diag(found), found @ fields, fields, most)


def _factored(
    variance: Vector, across: Vector, fields: Vector, most: int
) -> tuple[Vector, Vector]:
    alone = variance.copy()
    open_um2 = np.sum(across * fields, axis=0)
    total = float(np.sum(open_um2))
    enough = (1.0 - KEPT_SHARE) * total
    columns = np.zeros((len(fields), most))
    seen = np.zeros((most, fields.shape[1]))
    count = 0
    while count < most and float(np.sum(open_um2)) > enough:
        pivot = first_of_the_largest(open_um2)
        explained = columns[:, :count] @ seen[:count, pivot]
        column = (across[:, pivot] - explained) / np.sqrt(open_um2[pivot])
        columns[:, count] = column
        seen[count] = columns[:, count] @ fields
        alone -= column**2
        open_um2 = np.maximum(open_um2 - seen[count] ** 2, 0.0)
        count += 1
    return columns[:, :count], _each(alone, float(np.sum(open_um2)), total, fields)


def _each(square: Vector, over_volume: float, total: float, fields: Vector) -> Vector:
    moving = np.sum(fields**2, axis=1)
    has_effect = moving > ROUNDING * np.max(moving)
    kept = np.where(has_effect, np.maximum(square, 0.0), 0.0)
    alone = float(kept @ moving)
    remains = over_volume > ROUNDING * total and alone > 0
    share = over_volume / alone if remains else 0.0
    found: Vector = np.sqrt(kept * min(share, 1.0))
    return found


def of_one_factor(found: Vector, fields: Vector, most: int) -> BySize:
    """Return the modes of a covariance (k, k) with an unknown common factor, distributed as
    `class_factors`."""
    columns, left = factored(found, fields, most)
    factor = class_factors()
    usual = float(np.sqrt(np.mean(factor**2)))
    scale = np.tile((factor / usual)[:, None], (1, columns.shape[1]))
    sized = UnknownSize(scale=scale, shift=np.zeros(scale.shape))
    return BySize(usual * columns, sized, usual * left)


def by_size(direction: Vector, family: Family, fields: Vector, most: int) -> BySize:
    """Return the directions (k, q) of a family as modes; the size of a mode is its root mean square
    over all likely sizes.

    Directions that the readings determine equally well, within a factor of two, form a group,
    because an eigenvalue decomposition would choose among them by rounding. Each group has an
    additional mode: the most likely amounts of the group change with the size of the random
    effects.
    """
    unseen = family.seen * np.max(family.factor) ** 2 < UNSEEN
    octave = np.floor(np.log2(np.where(unseen, 1.0, family.seen)))
    level = np.where(unseen, -np.inf, octave)
    square = family.factor**2
    never = np.zeros(len(square))
    columns, scale, shift = [np.zeros((len(direction), 0))], [], []
    left = np.zeros(len(direction))
    for group in np.unique(level):
        mine = level == group
        seen = 0.0
        if np.isfinite(group):
            seen = float(np.exp(np.mean(np.log(family.seen[mine]))))
        variance = square / (1.0 + square * seen)
        usual = float(np.sqrt(np.mean(variance)))
        those = usual * direction[:, mine]
        alone = np.sum(those**2, axis=1)
        across = those @ (those.T @ fields)
        own, rest = _factored(alone, across, fields, most)
        left = np.hypot(left, rest)
        follows = variance - 1.0 / (1.0 + seen)
        moved = max(float(np.sqrt(np.mean(follows**2))), 1e-30)
        amounts = direction[:, mine] @ family.shown[mine]
        columns += [own, moved * amounts[:, None]]
        scale += [np.sqrt(variance) / usual] * own.shape[1] + [never]
        shift += [never] * own.shape[1] + [follows / moved]
    modes = np.hstack(columns)
    matters = np.sum((modes.T @ fields) ** 2, axis=1)
    total = float(np.sum(matters))
    order = np.argsort(-matters, kind="stable")
    share = np.cumsum(matters[order]) / max(total, 1e-30)
    enough = int(np.searchsorted(share, KEPT_SHARE)) + 1
    kept, dropped = np.split(order, [min(2 * most, enough)])
    square_of_dropped = np.sum(modes[:, dropped] ** 2, axis=1)
    more = _each(square_of_dropped, float(np.sum(matters[dropped])), total, fields)
    kept = np.sort(kept)
    sized = UnknownSize(scale=np.array(scale).T[:, kept], shift=np.array(shift).T[:, kept])
    return BySize(modes[:, kept], sized, np.hypot(left, more))
