"""The ``[fanuc]`` section of a profile."""

from typing import Annotated

import msgspec

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message

LAST_POINT = 9999
PointNumber = Annotated[int, msgspec.Meta(ge=0, le=LAST_POINT)]
Unit = Annotated[float, msgspec.Meta(ge=0.001, le=1000)]
FourNumbers = Annotated[list[int], msgspec.Meta(min_length=4, max_length=4)]


class AxisPoints(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """The section ``[fanuc.axes.X]``: the number of the axis in the control (A1, A2 ..; parameter
    1020 contains its letter) and its pitch points.
    """

    number: Annotated[int, msgspec.Meta(ge=1)]
    reference_point: PointNumber
    reverse_first_point: PointNumber = 0
    magnification: Annotated[int, msgspec.Meta(ge=1, le=100)] | None = None
    inclination: bool = False


class StraightnessNumbers(
    msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True
):
    """The section ``[fanuc.straightness.EYX]``: parameter numbers of this machine. No consulted
    manual states these numbers.
    """

    moving: int
    compensated: int
    points: FourNumbers
    values: FourNumbers


class FanucOptions(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    detection_unit_um: Unit
    axes: dict[str, AxisPoints]
    least_input_um: Unit = 1.0
    increment_limit: Annotated[int, msgspec.Meta(ge=1, le=127)] = 7
    points_per_axis: int = 128
    experimental_bidirectional: bool = False
    straightness: dict[str, StraightnessNumbers] = {}
    straightness_option: bool = False

    def axis(self, letter: str, source: str) -> AxisPoints:
        """Return the points of axis X, Y or Z. Raises ``UsageError`` for an axis without a
        section."""
        if letter not in self.axes:
            raise UsageError(
                f"{source}: fanuc.axes.{letter}",
                expected=message("section-fanuc-axes", letter=letter),
                found=message("nothing"),
            )
        return self.axes[letter]


TEMPLATE = """\
# FANUC writes only into copies of the machine's own files: name its punched pitch data in
# machine.existing (SYSTEM > PITCH > PUNCH),
# and its punched parameters (SYSTEM > PARAM > PUNCH) if 3620-3624 are to be written too.
[fanuc]
# 1.0 or 0.1: a wrong answer makes every value 10 times too large or small
detection_unit_um = "?"
# least_input_um = 1.0        # least input increment, for 3624 of old controls (16i/18i)
# increment_limit = 7         # largest increment per point; some series and options allow 127
# points_per_axis = 128
# true: the control has straightness compensation, and its parameter file contains 5711 to 5784
# straightness_option = false
# experimental_bidirectional = false   # 3605#0: pitch data of their own for each direction
[fanuc.axes.X]
# which A<number> is X: parameter 1020 holds 88 for X, 89 for Y, 90 for Z
number = "?"
reference_point = "?"         # 3620: number of the point at the reference position
# reverse_first_point = 0     # 3626, only with experimental_bidirectional
# 3623; left out: the smallest magnification with which every increment is within the limit
# magnification = 1
# true: put the slope into inclination compensation (5861-5864, 5871-5874)
# inclination = false
[fanuc.axes.Y]
number = "?"
reference_point = "?"
[fanuc.axes.Z]
number = "?"
reference_point = "?"
# only with the parameter numbers of this machine, from its own parameter manual
# [fanuc.straightness.EYX]
# moving = 5711
# compensated = 5721
# points = [5731, 5732, 5733, 5734]
# values = [5761, 5762, 5763, 5764]
"""
