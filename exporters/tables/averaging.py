"""The mean of both directions, for tables without a direction of travel, and the finding about the
difference.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import msgspec

from stepdiag.base.findings import Finding, info, warning
from stepdiag.base.messages import message
from stepdiag.base.result.result import POSITIONING
from stepdiag.exporters.tables.curves import Curve
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.sampling import is_directional


def averaging(profile: Profile) -> Profile:
    return replace(
        profile, machine=msgspec.structs.replace(profile.machine, direction="mean")
    )


def averaged_remarks(curves: Sequence[Curve], profile: Profile) -> Iterator[Finding]:
    """Yield the finding ``direction-averaged`` for every curve that goes into one table although
    the profile requests both directions.
    """
    for curve in curves:
        if is_directional(curve, profile):
            yield warning("direction-averaged.written", name=curve.name)


def straightness_remark(curves: Sequence[Curve], control: str) -> Iterator[Finding]:
    """Yield the finding ``function-left-out.no-table`` with the straightness (without its end-point
    line) that stays in the machine.
    """
    left = [
        message("so-much-of", name=curve.name, size_um=_straightness_um(curve))
        for curve in curves
        if curve.name not in POSITIONING
    ]
    if left:
        yield info("function-left-out.no-table", control=control, left=left)


def _straightness_um(curve: Curve) -> float:
    first, last = curve.position_mm[[0, -1]]
    share = (curve.position_mm - first) / (last - first)
    line = curve.mean_um[0] + share * (curve.mean_um[-1] - curve.mean_um[0])
    return float(max(abs(curve.mean_um - line)))
