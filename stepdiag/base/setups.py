"""The names of setups and what they say about the travel of the machine.

    ppp npp pnp ppn        body step diagonal: the axes move one after the other (contract 1)
    face-xy-pp face-xz-np  step diagonal in a face: two axes move one after the other, the third stands
    body-ppp body-npp      body diagonal with all axes moving together, read once per increment (ISO 230-6)
    linear-x linear-y      run along one axis

A number behind ``+`` tells setups of the same travel apart: a shifted beam, a second mirror alignment, another face (``ppp+1``).
"""

import difflib
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

from stepdiag.base.errors import UsageError
from stepdiag.base.volume import AXES, BODY_DIAGONALS, LINEAR_RUNS

Kind = Literal["step", "face", "body", "linear"]

FACE_DIAGONALS = tuple(f"face-{first}{second}-{signs}" for first, second in combinations(AXES, 2) for signs in ("pp", "np"))
CONTINUOUS_DIAGONALS = tuple(f"body-{diagonal}" for diagonal in BODY_DIAGONALS)
SETUP_NAMES = (*BODY_DIAGONALS, *FACE_DIAGONALS, *CONTINUOUS_DIAGONALS, *LINEAR_RUNS)
"""Every setup whose readings the solver understands, in the order in which tables list them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """What a setup name says. ``signs`` holds +1, -1 or 0 (standing) per axis for the outward pass."""

    name: str
    base: str
    kind: Kind
    signs: tuple[int, int, int]
    variant: int

    @property
    def order(self) -> tuple[int, int]:
        """Return the place of this setup in tables and files."""
        return SETUP_NAMES.index(self.base), self.variant


def setup_of(name: str, where: str = "setup") -> Setup:
    """Return what a setup name means. Raises ``UsageError`` for a name nobody knows, with the nearest known one."""
    base, plus, number = name.partition("+")
    if base not in SETUP_NAMES or (plus and not (number.isascii() and number.isdigit() and not number.startswith("0") and len(number) < 6)):
        near = difflib.get_close_matches(base, SETUP_NAMES, cutoff=0.5)
        remedy = f"did you mean {near[0]!r}?" if near else "a shifted beam or a second alignment is named ppp+1, ppp+2, .."
        raise UsageError(where, expected="one of " + ", ".join(SETUP_NAMES), found=repr(name), remedy=remedy)
    return Setup(name=name, base=base, kind=_kind(base), signs=_signs(base), variant=int(number) if plus else 0)


def _kind(base: str) -> Kind:
    if base.startswith("face-"):
        return "face"
    if base.startswith("body-"):
        return "body"
    return "linear" if base.startswith("linear-") else "step"


def _signs(base: str) -> tuple[int, int, int]:
    axes, letters = "xyz", base.removeprefix("body-")
    if base.startswith("face-"):
        _, axes, letters = base.split("-")
    elif base.startswith("linear-"):
        axes, letters = base[-1], "p"
    given = {axis: 1 if letter == "p" else -1 for axis, letter in zip(axes, letters, strict=True)}
    return given.get("x", 0), given.get("y", 0), given.get("z", 0)
