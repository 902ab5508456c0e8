"""The names of setups, each with the travel of the machine that it represents.

    ppp npp pnp ppn        body step diagonal: the axes move one after the other (contract 1)
    face-xy-pp face-xz-np  step diagonal in a face: two axes move one after the other
    body-ppp body-npp      body diagonal with all axes moving together, read once per increment
                           (ISO 230-6)
    linear-x linear-y      run along one axis
    fourdof-x fourdof-y    run of the 4-DOF head along one axis: its own record, no readings

A number after ``+`` distinguishes setups with the same travel: a shifted beam, a second mirror
alignment, another face (``ppp+1``).
"""

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import Literal

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.base.names import AXES, BODY_DIAGONALS, FOURDOF_RUNS, LINEAR_RUNS, SETUP_NUMBERS

Kind = Literal["step", "face", "body", "linear", "fourdof"]

FACE_DIAGONALS = tuple(
    f"face-{first}{second}-{signs}"
    for first, second in combinations(AXES, 2)
    for signs in ("pp", "np")
)
CONTINUOUS_DIAGONALS = tuple(f"body-{diagonal}" for diagonal in BODY_DIAGONALS)
SETUP_NAMES = (*BODY_DIAGONALS, *FACE_DIAGONALS, *CONTINUOUS_DIAGONALS, *LINEAR_RUNS)
"""Names of all setups whose readings the solver accepts, in the order of tables."""
DRIVEN_SETUPS = (*SETUP_NAMES, *FOURDOF_RUNS)
CODED_FROM = 100
"""Values of the ``setup`` register above this number are 100 + k for the k-th setup of the plan
(contract 2)."""
_CODES = {name: number for number, name in SETUP_NUMBERS.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """A setup: the ``kind`` of its travel, its name without a shift (``base``), and the number of
    its ``shift``, 0 for the usual line.

    ``signs`` contains +1, -1 or 0 (standing) per axis for the outward pass.
    """

    name: str
    base: str
    kind: Kind
    signs: tuple[int, int, int]
    shift: int

    @property
    def order(self) -> tuple[int, int]:
        return SETUP_NAMES.index(self.base), self.shift

    @property
    def axis(self) -> str:
        """Return the axis of a run along one axis, otherwise an empty text."""
        return self.base[-1] if self.kind in ("linear", "fourdof") else ""

    @property
    def is_diagonal(self) -> bool:
        """Return whether the setup is a step diagonal through the volume."""
        return self.kind == "step"

    @property
    def is_fourdof(self) -> bool:
        """Return whether the setup is a run of the 4-DOF head, which gives no readings."""
        return self.kind == "fourdof"

    def shifted(self, number: int) -> str:
        """Return the name of the same travel along another line."""
        return f"{self.base}+{number}" if number else self.base


@lru_cache(maxsize=1024)
def setup_of(
    name: str, where: str = "setup", names: tuple[str, ...] = DRIVEN_SETUPS
) -> Setup:
    """Return the setup of a name. Raises ``UsageError`` with the nearest name for a name outside
    ``names``."""
    base, plus, number = name.partition("+")
    if base not in names or (
        plus
        and not (
            number.isascii()
            and number.isdigit()
            and not number.startswith("0")
            and len(number) < 6
        )
    ):
        near = difflib.get_close_matches(base, names, cutoff=0.5)
        remedy = (
            message("did-you-mean-near", near=repr(near[0]))
            if near
            else message("shifted-beam-second-alignment")
        )
        raise UsageError(
            where,
            expected=message("one-of", names=list(names)),
            found=repr(name),
            remedy=remedy,
        )
    return Setup(
        name=name,
        base=base,
        kind=_kind(base),
        signs=_signs(base),
        shift=int(number) if plus else 0,
    )


def setup_code(setup: str, planned: Sequence[str]) -> int:
    """Return the value of the machine's ``setup`` register for a setup of a plan: 100 + k for the
    k-th setup if it has no number of its own.

    A step diagonal with a shifted beam has the number of its diagonal, because the machine drives
    the same stops. Raises ``UsageError`` for an invalid name.
    """
    travel = setup_of(setup, "plan.setups")
    if travel.base in _CODES and (travel.is_diagonal or not travel.shift):
        return _CODES[travel.base]
    return CODED_FROM + planned.index(setup) + 1


def setups_meant(code: int | None, planned: Iterable[str]) -> list[str]:
    """Return the setups of a plan that a value of the ``setup`` register can mean, in the order of
    the plan."""
    names = list(planned)
    if code is not None and CODED_FROM < code <= CODED_FROM + len(names):
        return [names[code - CODED_FROM - 1]]
    base = SETUP_NUMBERS.get(code) if code is not None else None
    meant = [name for name in names if setup_of(name).base == base]
    return [
        name for name in meant if setup_of(name).is_diagonal or not setup_of(name).shift
    ] or meant


def _kind(base: str) -> Kind:
    match base.partition("-")[0]:
        case "face" | "body" | "linear" | "fourdof" as kind:
            return kind
        case _:
            return "step"


def _signs(base: str) -> tuple[int, int, int]:
    axes, letters = "xyz", base.removeprefix("body-")
    if base.startswith("face-"):
        _, axes, letters = base.split("-")
    elif base.startswith(("linear-", "fourdof-")):
        axes, letters = base[-1], "p"
    given = {
        axis: 1 if letter == "p" else -1 for axis, letter in zip(axes, letters, strict=True)
    }
    return given.get("x", 0), given.get("y", 0), given.get("z", 0)
