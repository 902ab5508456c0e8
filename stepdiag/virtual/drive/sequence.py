"""The path of the virtual NC program: the box, its diagonals and lines, and the stops in the order
of driving."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stepdiag.virtual.physics.error_functions import Array

REGISTER_OF_SETUP = {
    "ppp": 1,
    "npp": 2,
    "pnp": 3,
    "ppn": 4,
    "linear-x": 11,
    "linear-y": 12,
    "linear-z": 13,
    "fourdof-x": 21,
    "fourdof-y": 22,
    "fourdof-z": 23,
}
"""The setups with their values in the machine's ``setup`` register (contract 2)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """The measured volume, cut in ``increments`` per axis (contract 1).

    ``decimals`` is the number of decimal places in the NC program, None for a program that does not
    round. An ``incremental`` program (G91) contains steps, whose rounding accumulates along the
    pass.
    """

    origin_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    size_mm: tuple[float, float, float] = (500.0, 400.0, 300.0)
    increments: int = 10
    decimals: int | None = None
    incremental: bool = False


def base_name(setup: str) -> str:
    """Return the setup without the suffix of a shifted beam: ``ppp+1`` is driven as ``ppp``."""
    return setup.partition("+")[0]


def register_of(setup: str) -> int:
    """Return the value of the ``setup`` register. Raises ValueError for an unknown name."""
    try:
        return REGISTER_OF_SETUP[base_name(setup)]
    except KeyError:
        raise ValueError(
            f"setup: expected one of {', '.join(REGISTER_OF_SETUP)}, found {setup!r}"
        ) from None


def axis_of_run(setup: str) -> int | None:
    """Return the axis (0, 1, 2) of a run along one axis, None for a diagonal."""
    letter = base_name(setup)[-1]
    return "xyz".index(letter) if "-" in setup else None


def outward_direction(box: Box, setup: str) -> Array:
    """Return the unit vector of the outward pass, shape (3,)."""
    register_of(setup)
    axis = axis_of_run(setup)
    if axis is not None:
        along: Array = np.eye(3)[axis]
        return along
    signs = [1.0 if letter == "p" else -1.0 for letter in base_name(setup)]
    diagonal = np.multiply(signs, box.size_mm)
    unit: Array = diagonal / np.linalg.norm(diagonal)
    return unit


def outward_stops_mm(box: Box, setup: str, axis_order: str = "xyz") -> Array:
    """Return the commanded positions of the outward pass, shape (3n+1, 3) for a diagonal, (n+1, 3)
    along one axis.

    A diagonal starts where ``p`` axes are low and ``n`` axes high, and moves one axis at a time in
    ``axis_order``. A run along one axis leaves the other axes at their low end.
    """
    signs = np.sign(outward_direction(box, setup))
    low = np.array(box.origin_mm, dtype=np.float64)
    here = np.where(signs < 0, low + box.size_mm, low)
    stops = [here]
    for number in range(1, box.increments + 1):
        for axis in _moved_axes(setup, axis_order):
            end = low[axis] if signs[axis] < 0 else low[axis] + box.size_mm[axis]
            start = stops[0][axis]
            here = here.copy()
            here[axis] = start + (end - start) * number / box.increments
            stops.append(here)
    return _written(np.array(stops), box)


def _written(stop_mm: Array, box: Box) -> Array:
    """Return the positions as the NC program writes them, shape like ``stop_mm``."""
    if box.decimals is None:
        return stop_mm
    if not box.incremental:
        return stop_mm.round(box.decimals)
    steps = np.diff(stop_mm, axis=0).round(box.decimals)
    start = stop_mm[:1].round(box.decimals)
    return np.concatenate([start, start + np.cumsum(steps, axis=0)]).round(box.decimals + 3)


def _moved_axes(setup: str, axis_order: str) -> Iterator[int]:
    axis = axis_of_run(setup)
    return (
        iter((axis,))
        if axis is not None
        else iter("xyz".index(letter) for letter in axis_order)
    )


@dataclass(frozen=True, slots=True)
class DrivenPass:
    """A pass: ``stop_mm`` (M, 3) in the order of driving; ``approach`` (3,) is the sign of every
    axis' approach, 0 for an axis that never moves."""

    setup: str
    number: int
    stop_mm: Array
    approach: Array


def driven_pass(box: Box, setup: str, number: int, axis_order: str = "xyz") -> DrivenPass:
    """Return the pass with this ``number`` (from 1). Odd passes go outward, even passes visit the
    same stops in reverse."""
    stops = outward_stops_mm(box, setup, axis_order)
    approach = np.sign(outward_direction(box, setup))
    if number % 2 == 0:
        return DrivenPass(setup, number, stops[::-1], -approach)
    return DrivenPass(setup, number, stops, approach)
