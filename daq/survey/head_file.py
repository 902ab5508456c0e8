"""The calibration file of a 4-DOF head (TOML): who it belongs to, when it was made, curves, signs, lever and their uncertainty.

It travels with the logs (`daq.survey.bundle`). A file of another head is refused: its curves would give numbers that look right.
"""

import datetime as dt
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.files import as_text
from stepdiag.base.messages import message
from stepdiag.base.settings import convert, read_toml
from stepdiag.base.volume import Vector
from stepdiag.daq.survey.models import Head as HeadSection
from stepdiag.daq.survey.models import NotNegative, Positive, Text

Pair = tuple[float, float]
Day = Annotated[str, Meta(pattern=r"^[0-9]{4}-[0-9]{2}-[0-9]{2}\Z", description="a-day")]
MOST_COEFFICIENTS = 20
DetectorName = Literal["qd", "psd1", "psd2"]
AxisName = Literal["x", "y"]


class AxisTable(msgspec.Struct, frozen=True, kw_only=True):
    """One axis of a detector: its sign and the curve from the normalised reading to the shift of the spot."""

    sign: Literal[1, -1] = 1
    kind: Literal["polynomial", "erf"] = "polynomial"
    coefficients_um: Annotated[tuple[float, ...], Meta(min_length=1, max_length=MOST_COEFFICIENTS)] = (0.0, 1000.0)
    low: Annotated[float, Meta(ge=-1, lt=1)] = -1.0
    high: Annotated[float, Meta(gt=-1, le=1)] = 1.0
    u_um: NotNegative = 0.0


class DetectorTable(msgspec.Struct, frozen=True, kw_only=True):
    x: AxisTable = AxisTable()
    y: AxisTable = AxisTable()
    sum_min: NotNegative = 0.0
    sum_max: Positive | None = None
    rotation_mrad: float = 0.0


class LeverTable(msgspec.Struct, frozen=True, kw_only=True):
    """The lever is ``dead_path_mm + scale * distance``, distance from the head's reference face to the target.

    Its standard uncertainty is ``u_mm`` at ``u_at_mm`` of distance, where what is uncertain about the scale (``u_scale``) turns the line.
    """

    dead_path_mm: float = 0.0
    scale: Positive = 1.0
    u_mm: NotNegative = 0.0
    u_at_mm: NotNegative = 0.0
    u_scale: NotNegative = 0.0

    def u_at(self, distance_mm: Vector) -> Vector:
        """Return the lever's standard uncertainty in mm at each distance, shape like ``distance_mm``."""
        u: Vector = np.hypot(self.u_mm, self.u_scale * (distance_mm - self.u_at_mm))
        return u


class CrosstalkTable(msgspec.Struct, frozen=True, kw_only=True):
    """The corrections of the solver (`fourdof.head.Crosstalk`); zero is none."""

    vertex_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    psd1_leak: Pair = (0.0, 0.0)
    psd2_leak: Pair = (0.0, 0.0)
    qd_gain_per_m: Pair = (0.0, 0.0)
    qd_calibrated_at_mm: NotNegative = 0.0


class HeadIdentity(msgspec.Struct, frozen=True, kw_only=True):
    """Whose file it is. Focal lengths are needed for the angles; a single quadrant detector has none."""

    id: Text
    format: Literal["fourdof", "tqd"]
    date: Day
    reference: str = ""
    psd1_focal_length_mm: Positive = 150.0
    psd2_focal_length_mm: Positive = 150.0


class HeadFile(msgspec.Struct, frozen=True, kw_only=True):
    """The whole file."""

    head: HeadIdentity
    lever: LeverTable = LeverTable()
    qd: DetectorTable = DetectorTable()
    psd1: DetectorTable = DetectorTable()
    psd2: DetectorTable = DetectorTable()
    crosstalk: CrosstalkTable = CrosstalkTable()

    def detector(self, name: DetectorName) -> DetectorTable:
        """Return a detector's table."""
        return {"qd": self.qd, "psd1": self.psd1, "psd2": self.psd2}[name]

    def with_axis(self, detector: DetectorName, axis: AxisName, table: AxisTable) -> "HeadFile":
        """Return the file with one axis of one detector replaced."""
        changed = msgspec.structs.replace(self.detector(detector), **{axis: table})
        return msgspec.structs.replace(self, **{detector: changed})


def parse_head_file(data: bytes, source: str) -> HeadFile:
    """Return a calibration file. Raises UsageError naming the field that is wrong."""
    file = convert(read_toml(as_text(data, source, UsageError), source), HeadFile, source)
    _check_date(file, source)
    for name, detector in (("qd", file.qd), ("psd1", file.psd1), ("psd2", file.psd2)):
        for letter, axis in (("x", detector.x), ("y", detector.y)):
            if axis.low >= axis.high:
                raise UsageError(f"{source}: {name}.{letter}.high", expected=message("more-than-low", low=axis.low), found=f"{axis.high:g}")
    return file


def _check_date(file: HeadFile, source: str) -> None:
    try:
        dt.date.fromisoformat(file.head.date)
    except ValueError as error:
        raise UsageError(f"{source}: head.date", expected=message("a-day"), found=file.head.date) from error


def require_owner(file: HeadFile, section: HeadSection, source: str) -> None:
    """Raise DataError unless the file belongs to the head that the survey names."""
    for field, of_file, of_survey in (("id", file.head.id, section.id), ("format", file.head.format, section.format)):
        if of_file != of_survey:
            raise DataError(
                f"{source}: head.{field}",
                expected=message("head-survey", of_survey=repr(of_survey)),
                found=f"{of_file!r}",
                remedy=message("name-calibration-file-head"),
            )


def render_head_file(file: HeadFile) -> str:
    """Return the file as text (TOML, LF): the same bytes for the same calibration."""
    lines = ["# Calibration of a 4-DOF head (docs/fourdof.md). Curves: shift of the spot in um over difference / sum.", ""]
    lines += _table("head", file.head)
    lines += _table("lever", file.lever)
    for name, detector in (("qd", file.qd), ("psd1", file.psd1), ("psd2", file.psd2)):
        lines += _table(name, detector)
        lines += _table(f"{name}.x", detector.x)
        lines += _table(f"{name}.y", detector.y)
    return "\n".join([*lines, *_table("crosstalk", file.crosstalk)])


def _table(name: str, table: msgspec.Struct) -> list[str]:
    fields = msgspec.structs.asdict(table)
    plain = {key: value for key, value in fields.items() if value is not None and not isinstance(value, msgspec.Struct)}
    return [f"[{name}]", *(f"{key} = {_value(value)}" for key, value in plain.items()), ""]


def _value(value: object) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    # a JSON text is a TOML text, but for DEL; and repr gives a float all its digits
    return msgspec.json.encode(value).decode().replace("\x7f", "\\u007f") if isinstance(value, str) else repr(value)
