"""Compensations that correct the effect of the angles' levers on the tool: a lattice, products of
tables, columns of angles.

Under such a compensation the axes still rotate, but the readings do not contain the levers of the
angles. A solver that uses the measured angles then computes squareness errors that do not exist (3
urad for angles of 10 urad, on the virtual control of the tests).
"""

import re
from collections.abc import Mapping

from stepdiag.base.compensation import stated_in
from stepdiag.base.errors import SafetyError
from stepdiag.base.findings import Finding, warning
from stepdiag.base.messages import message
from stepdiag.base.result.result import ROTATIONS, Result
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.tables import lattice
from stepdiag.exporters.tables.profile import Profile

_PRODUCT = re.compile(rb"\$AN_CEC_MULT_BY_TABLE\[[^\]]*\]\s*=\s*[1-9]")
_ANGLE_COLUMNS = re.compile(
    rb"^\s*(?:BEGIN [^\n]*\n\s*NR\b[^\n]*\bC[456]\b|(?!//)[XYZ]\s[^\n]*\bE[ABC][XYZ]\b)",
    re.MULTILINE,
)


def without_levers(files: Mapping[str, bytes]) -> tuple[str, ...]:
    return tuple(
        name
        for name, data in files.items()
        if lattice.recognises(ControlFile(name=name, data=data))
        or _PRODUCT.search(data)
        or _ANGLE_COLUMNS.search(data)
    )


def left_out(files: Mapping[str, bytes]) -> Finding | None:
    """Return the finding that a solution does not use the measured angles because ``files`` were
    active; None if the solution may use them.
    """
    names = without_levers(files)
    if not names:
        return None
    return warning("angles-left-out", names=names)


def require_levers(result: Result, profile: Profile) -> None:
    """Raise ``SafetyError`` for a result with measured angles, if the active compensation corrected
    the levers of the angles.
    """
    names = without_levers({file.name: file.data for file in profile.existing})
    known = [name for name in ROTATIONS if result.knows(name)]
    if (
        profile.machine.measured_with == "on"
        and stated_in(result).state != "off"
        and names
        and known
    ):
        raise SafetyError(
            f"{result.source}: errors.{known[0]}",
            code="active-table-unfit.angles",
            expected=message("without-angles"),
            found=message("and-active", names=known, files=names),
            remedy=message("solve-without"),
        )
