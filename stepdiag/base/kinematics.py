"""Kinematic chains and their Abbe arms (theory of the rigid-body model, section 2.2).

A chain is the order of the axes from workpiece to tool. In ``FXYZ`` the bed ``F`` comes first, so
all axes carry the tool. In the ISO 10791-6 form ``[w X' b Y Z t]`` the bed is ``b``, and a prime
marks an axis that carries the work. Primes are optional, because the position of ``b`` determines
them.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.base.names import AXES
from stepdiag.base.volume import Vector


class Chain(NamedTuple):
    """A chain as two lists of axes (0, 1, 2): the axes that carry the work, from workpiece to bed,
    and the axes that carry the tool, from bed to tool."""

    work: tuple[int, ...]
    tool: tuple[int, ...]


def parse_chain(text: str, where: str = "chain") -> Chain:
    """Return the axes on both sides of the bed. Raises ``UsageError`` unless the text contains each
    axis once and a single bed."""
    stripped = text.strip()
    iso = stripped.startswith("[") and stripped.endswith("]")
    words = stripped[1:-1].split() if iso else list(stripped)
    if iso:
        words = words[1:-1] if len(words) > 2 and words[0] == "w" and words[-1] == "t" else []
    bed = "b" if iso else "F"
    names = [word.rstrip("'’′") for word in words]
    if sorted(names) != sorted(("X", "Y", "Z", bed)):
        raise _refusal(where, text)
    at = names.index(bed)
    primed = [word != name for word, name in zip(words, names, strict=True)]
    if any(primed[at:]) or (any(primed[:at]) and not all(primed[:at])):
        raise _refusal(where, text)
    work, tool = (
        tuple(AXES.index(name.lower()) for name in some)
        for some in (names[:at], names[at + 1 :])
    )
    return Chain(work=work, tool=tool)


def _refusal(where: str, text: str) -> UsageError:
    return UsageError(
        where,
        expected=message("x-y-z-bed"),
        found=repr(text),
        remedy=message("axes-left-bed-f"),
    )


def abbe_mask(chain: str) -> NDArray[np.float64]:
    """Return the coordinates of a point that enter the Abbe arm of each axis, shape (axis,
    coordinate), entries 0 or 1.

    The arm of axis ``a`` is ``r_a = mask[a] * (P - origin)`` (theory 2.2). The carriage of a
    tool-side axis is moved by all work-side axes, the tool-side axes from the bed up to this
    carriage, and its own axis. The carriage of a work-side axis is moved by the axes between it and
    the workpiece.
    """
    work, tool = parse_chain(chain)
    mask = np.ones((3, 3))
    for place, axis in enumerate(work):
        mask[axis, list(work[:place])] = 0.0
    for place, axis in enumerate(tool):
        mask[axis, [*work, *tool[: place + 1]]] = 0.0
    return mask


def cross_matrix(vector: Vector) -> Vector:
    """Return the matrices ``K`` with ``K @ a = vector x a``, shape (..., 3, 3)."""
    matrix = np.zeros((*vector.shape, 3))
    x, y, z = np.moveaxis(vector, -1, 0)
    matrix[..., 0, 1], matrix[..., 0, 2], matrix[..., 1, 2] = -z, y, -x
    matrix[..., 1, 0], matrix[..., 2, 0], matrix[..., 2, 1] = z, -y, x
    return matrix
