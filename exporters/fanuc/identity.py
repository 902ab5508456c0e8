"""Check that the machine's own punch file belongs to the machine of the profile: axes and units
must agree.

From manuals: 1020 axis names in ASCII (88 X, 89 Y, 90 Z), 3620 reference point, 3605#0
bidirectional compensation, 8135#0 of the 0i-D (controllers.md 2.1, 2.6). Not checked against a
document, so a contradiction is only a warning: 1001#0 inch machine, 1006#3 diameter programming,
1013#0 and #1 increment system, 5711 to 5764 straightness compensation.
"""

from collections.abc import Iterator, Sequence

import msgspec

from stepdiag.base.findings import Finding, error, warning
from stepdiag.exporters.fanuc.options import AxisPoints, FanucOptions
from stepdiag.exporters.fanuc.parameters import BIDIRECTIONAL, DISABLED, MOST_AXES
from stepdiag.exporters.fanuc.punch import PunchFile
from stepdiag.exporters.fanuc.straightness import found_in
from stepdiag.exporters.tables.profile import Profile

AXIS_NAME, REFERENCE_POINT, HIGHEST_POINT = 1020, 3620, 3622
OF_EVERY_AXIS, AXES = (AXIS_NAME, REFERENCE_POINT), range(1, MOST_AXES + 1)
"""Parameters that a file contains for each axis or without an axis, and the axis numbers to
search.
"""
_INCREMENT_UM = {(True, False): 10.0, (False, False): 1.0, (False, True): 0.1}
"""Least input increment by 1013#0 (IS-A) and 1013#1 (IS-C)."""


def identity_findings(
    masters: Sequence[PunchFile], profile: Profile, options: FanucOptions
) -> Iterator[Finding]:
    """Yield an error or a warning for each contradiction between the machine's own files and the
    profile. A missing parameter is no contradiction.
    """
    if _bit(masters, DISABLED, None, 0):
        yield error("machine-file-differs.disabled")
    if _bit(masters, 1001, None, 0) and profile.machine.units == "mm":
        yield warning("units-not-metric.machine")
    used = found_in(masters, msgspec.structs.replace(options, straightness_option=True))
    acting = [
        name
        for name, one in used.items()
        if any(_parameter_number(masters, key, None) for key in one.values)
    ]
    if acting and not options.straightness_option and not options.straightness:
        yield warning("machine-file-differs.straightness", names=acting)
    for letter, axis in options.axes.items():
        yield from _axis(masters, letter, axis, profile, options)


def _axis(
    masters: Sequence[PunchFile],
    letter: str,
    axis: AxisPoints,
    profile: Profile,
    options: FanucOptions,
) -> Iterator[Finding]:
    name = _parameter_number(masters, AXIS_NAME, axis.number)
    if name is not None and name != ord(letter):
        shown = chr(name) if 32 < name < 127 else str(name)
        yield error(
            "machine-file-differs.axis",
            number=axis.number,
            name=name,
            shown=shown,
            again=axis.number,
            letter=letter,
        )
    others = [
        key
        for key in OF_EVERY_AXIS
        if _text(masters, key, axis.number) is None
        and any(_text(masters, key, each) for each in AXES)
    ]
    if others:
        yield error(
            "machine-file-differs.no-axis",
            parameter=others[0],
            number=axis.number,
            again=axis.number,
            letter=letter,
        )
    reference, highest = (
        _parameter_number(masters, REFERENCE_POINT, axis.number),
        _parameter_number(masters, HIGHEST_POINT, axis.number),
    )
    if highest and reference is not None and reference != axis.reference_point:
        yield error(
            "machine-file-differs.reference",
            number=axis.number,
            found=reference,
            stated=axis.reference_point,
            letter=letter,
        )
    if _bit(masters, BIDIRECTIONAL, axis.number, 0) and not (
        options.experimental_bidirectional and profile.machine.direction == "both"
    ):
        yield error("machine-file-differs.bidirectional", number=axis.number, letter=letter)
    if _bit(masters, 1006, axis.number, 3):
        yield warning("machine-file-differs.diameters", number=axis.number, letter=letter)
    is_a, is_c = (_bit(masters, 1013, axis.number, bit) for bit in (0, 1))
    if (
        is_a is not None
        and is_c is not None
        and _INCREMENT_UM.get((is_a, is_c), options.least_input_um) != options.least_input_um
    ):
        file_um = _INCREMENT_UM[is_a, is_c]
        yield warning(
            "machine-file-differs.increment",
            number=axis.number,
            found_um=file_um,
            stated_um=options.least_input_um,
        )


def _text(masters: Sequence[PunchFile], number: int, axis: int | None) -> str | None:
    return next(
        (text for master in masters if (text := master.parameter(number, axis)) is not None),
        None,
    )


def _parameter_number(
    masters: Sequence[PunchFile], number: int, axis: int | None
) -> int | None:
    text = _text(masters, number, axis)
    whole = (
        None if text is None else text.removesuffix(".0").removesuffix(".").removeprefix("-")
    )
    return int(whole) if whole is not None and whole.isdecimal() else None


def _bit(
    masters: Sequence[PunchFile], number: int, axis: int | None, bit: int
) -> bool | None:
    """Return a bit of a parameter, None if no file contains the parameter. The file contains the
    bits in the order from 7 to 0.
    """
    text = _text(masters, number, axis)
    return None if text is None or len(text) <= bit else text[-1 - bit] == "1"
