"""FANUC straightness parameters in the machine's own files.

B-63522EN/02 15.5 describes a moving axis, a compensated axis, four pitch points of the moving axis
and the compensation at each point. The parameter numbers below were not checked against a document,
because no consulted manual states them. These numbers are used only if the profile states the
option (``straightness_option``) and the machine's punched parameters contain all ten numbers of a
set. Without the option or a complete set, only the report shows the table. A control with the
option has three sets of parameters, for the three functions with the largest effect (with
squareness).
"""

from collections.abc import Mapping, Sequence

import msgspec
import numpy as np

from stepdiag.base.errors import SafetyError
from stepdiag.base.messages import message
from stepdiag.exporters.fanuc.options import FanucOptions, StraightnessNumbers
from stepdiag.exporters.fanuc.punch import PunchFile
from stepdiag.exporters.tables.tables import Table

SETS = tuple(
    StraightnessNumbers(
        moving=5711 + number,
        compensated=5721 + number,
        points=[5731 + 10 * number + point for point in range(4)],
        values=[5761 + 10 * number + point for point in range(4)],
    )
    for number in range(3)
)


def sets_in(files: Sequence[PunchFile]) -> tuple[StraightnessNumbers, ...]:
    """Return the sets of parameters whose ten numbers are all in one file."""
    return tuple(
        one
        for one in SETS
        if any(
            all(file.parameter(key, None) is not None for key in _keys(one)) for file in files
        )
    )


def given_to(
    tables: Mapping[str, Table],
    options: FanucOptions,
    files: Sequence[PunchFile],
    source: str,
) -> FanucOptions:
    """Return the options with each set of parameters assigned to a function; the function with the
    largest effect comes first.

    A set in the profile keeps its function. A function keeps the set that it has in the machine's
    files, even if the function is not in ``tables``.

    Raises ``SafetyError`` (code ``template-missing.parameters``) if the profile states the option
    and no file contains a set.
    """
    if not options.straightness_option:
        return options
    asked = {
        name: table for name, table in tables.items() if name not in options.straightness
    }
    in_use = found_in(files, options)
    taken = {numbers.moving for numbers in options.straightness.values()}
    taken |= {numbers.moving for name, numbers in in_use.items() if name not in asked}
    free = [one for one in sets_in(files) if one.moving not in taken]
    if not sets_in(files) and not options.straightness:
        raise SafetyError(
            f"{source}: fanuc.straightness_option",
            code="template-missing.parameters",
            expected=message("punched-straightness-parameters"),
            found=message("none-of-sets"),
            remedy=message("punch-parameters-out-system"),
        )
    names = sorted(asked, key=lambda name: -_worth_um(asked[name]))[: len(free)]
    given = {name: in_use[name] for name in names if name in in_use}
    left = [one for one in free if one not in given.values()]
    given |= dict(zip((name for name in names if name not in given), left, strict=False))
    return msgspec.structs.replace(options, straightness={**options.straightness, **given})


def found_in(
    files: Sequence[PunchFile], options: FanucOptions
) -> dict[str, StraightnessNumbers]:
    """Return the sets in use by the name of their function, which follows from the moving and the
    compensated axis in the files.
    """
    letters = {axis.number: letter for letter, axis in options.axes.items()}
    found: dict[str, StraightnessNumbers] = {}
    for one in sets_in(files) if options.straightness_option else ():
        moving, compensated = (
            letters.get(_set_number(files, key)) for key in (one.moving, one.compensated)
        )
        if moving is not None and compensated is not None and moving != compensated:
            found[f"E{compensated}{moving}"] = one
    return found


def _keys(numbers: StraightnessNumbers) -> tuple[int, ...]:
    return numbers.moving, numbers.compensated, *numbers.points, *numbers.values


def _set_number(files: Sequence[PunchFile], key: int) -> int:
    texts = [text for file in files if (text := file.parameter(key, None)) is not None]
    return int(texts[0]) if texts and texts[0].lstrip("-").isdigit() else -1


def _worth_um(table: Table) -> float:
    """Return the standard deviation of a four-point table over the travel of its axis, in um."""
    at = np.linspace(table.position_mm[0], table.position_mm[-1], 201)
    return float(np.std(np.interp(at, table.position_mm, table.value_um)))
