"""The calibration file of a 4-DOF head (TOML): identity of the head, date, curves, signs, lever,
and their uncertainties.

The logs contain the file (`daq.survey.bundle`). The file of another head is refused, because its
curves would give plausible but wrong numbers. A field is absent until a command has measured it;
`require_measured` reports the command to run next.
"""

import datetime as dt
from collections.abc import Sequence
from typing import Annotated, Literal, get_args

import msgspec
import numpy as np
from msgspec import Meta

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.files import as_text
from stepdiag.base.messages import message
from stepdiag.base.settings import convert, read_toml, unknown_key
from stepdiag.base.volume import Vector
from stepdiag.daq.survey.models import Head as HeadSection
from stepdiag.daq.survey.models import NotNegative, Positive, Text

Pair = tuple[float, float]
Day = Annotated[str, Meta(pattern=r"^[0-9]{4}-[0-9]{2}-[0-9]{2}\Z", description="a-day")]
MOST_COEFFICIENTS = 20
DetectorName = Literal["qd", "psd1", "psd2"]
AxisName = Literal["x", "y"]
CURVES = ("qd.x", "qd.y", "psd1.x", "psd1.y", "psd2.x", "psd2.y")
"""The names of the curves of the head's detectors."""
CALIBRATED = (
    *CURVES,
    "qd.rotation_mrad",
    "psd1.rotation_mrad",
    "psd2.rotation_mrad",
    "qd.dark",
    "psd1.dark",
    "psd2.dark",
    "light",
    "lever",
    "crosstalk.psd1_leak",
    "crosstalk.psd2_leak",
    "crosstalk.qd_gain_per_m",
)
"""Every field of the file that a command measures."""
QD_CALIBRATED = ("qd.x", "qd.y")
"""Fields that a head with only a quadrant detector needs."""


class AxisTable(msgspec.Struct, frozen=True, kw_only=True):
    """One axis of a detector: its sign and the curve from the normalised reading to the shift of
    the spot.
    """

    sign: Literal[1, -1] = 1
    kind: Literal["polynomial", "erf"] = "polynomial"
    coefficients_um: Annotated[
        tuple[float, ...], Meta(min_length=1, max_length=MOST_COEFFICIENTS)
    ] = (0.0, 1000.0)
    low: Annotated[float, Meta(ge=-1, lt=1)] = -1.0
    high: Annotated[float, Meta(gt=-1, le=1)] = 1.0
    u_um: NotNegative = 0.0


class DetectorTable(msgspec.Struct, frozen=True, kw_only=True):
    """A detector: curves, limits of the sum, roll, and ``dark`` (difference x, difference y and sum
    without light).
    """

    x: AxisTable | None = None
    y: AxisTable | None = None
    sum_min: NotNegative = 0.0
    sum_max: Positive | None = None
    rotation_mrad: float | None = None
    dark: tuple[float, float, float] | None = None


class LightTable(msgspec.Struct, frozen=True, kw_only=True):
    """The ``sums`` of QD, PSD1 and PSD2 under the same light. ``within`` is the largest relative
    difference between the sum of one detector and the other sums; a larger difference means a
    clipped spot.
    """

    sums: tuple[Positive, Positive, Positive]
    within: Annotated[float, Meta(gt=0, le=0.5)]


class LeverTable(msgspec.Struct, frozen=True, kw_only=True):
    """The lever of a head is ``dead_path_mm + scale * distance``; the distance is from the head's
    reference face to the target.

    ``u_mm`` is the standard uncertainty of the lever at the distance ``u_at_mm``; at other
    distances the uncertainty of the scale (``u_scale``) is added.
    """

    dead_path_mm: float = 0.0
    scale: Positive = 1.0
    u_mm: NotNegative = 0.0
    u_at_mm: NotNegative = 0.0
    u_scale: NotNegative = 0.0

    def u_at(self, distance_mm: Vector) -> Vector:
        """Return the lever's standard uncertainty in mm at each distance, shape like
        ``distance_mm``.
        """
        u: Vector = np.hypot(self.u_mm, self.u_scale * (distance_mm - self.u_at_mm))
        return u


class CrosstalkTable(msgspec.Struct, frozen=True, kw_only=True):
    """The corrections of crosstalk (`fourdof.head.Crosstalk`). The place of the corner cube
    (``vertex_mm``) is stated, not measured: zero means no offset.
    """

    vertex_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    psd1_leak: Pair | None = None
    psd2_leak: Pair | None = None
    qd_gain_per_m: Pair | None = None
    qd_calibrated_at_mm: NotNegative = 0.0


class Measured(msgspec.Struct, frozen=True, kw_only=True):
    by: Text
    on: Day


class UncertaintyTable(msgspec.Struct, frozen=True, kw_only=True):
    """Standard uncertainties of the fields of a commissioning, and the correlations of these
    fields: the rows of the matrix below the diagonal.
    """

    of: tuple[str, ...] = ()
    u: tuple[NotNegative, ...] = ()
    correlation: tuple[Annotated[float, Meta(ge=-1, le=1)], ...] = ()

    def covariance(self) -> Vector:
        """Return the covariance matrix of the fields, shape (k, k)."""
        full = np.eye(len(self.of))
        full[np.tril_indices(len(self.of), -1)] = self.correlation
        full = full + np.tril(full, -1).T
        covariance: Vector = full * np.outer(self.u, self.u)
        return covariance


class HeadIdentity(msgspec.Struct, frozen=True, kw_only=True):
    """Identity of the calibrated head. The angles need the focal lengths; a quadrant detector alone
    has no focal length.
    """

    id: Text
    format: Literal["fourdof", "tqd"]
    date: Day
    reference: str = ""
    psd1_focal_length_mm: Positive = 150.0
    psd2_focal_length_mm: Positive = 150.0
    version: Literal[1, 2] = 1


class HeadFile(msgspec.Struct, frozen=True, kw_only=True):
    """The whole calibration file. A file of version 1 does not contain the method of a measurement
    (``measured``). Missing fields of version 1, except curves, count as ideal.
    """

    head: HeadIdentity
    lever: LeverTable | None = None
    qd: DetectorTable = DetectorTable()
    psd1: DetectorTable = DetectorTable()
    psd2: DetectorTable = DetectorTable()
    light: LightTable | None = None
    crosstalk: CrosstalkTable = CrosstalkTable()
    measured: dict[str, Measured] = {}
    uncertainty: UncertaintyTable = UncertaintyTable()

    def detector(self, name: DetectorName) -> DetectorTable:
        return {"qd": self.qd, "psd1": self.psd1, "psd2": self.psd2}[name]

    def curve(self, name: str) -> AxisTable | None:
        """Return a detector's curve by its name (``qd.x`` .. ``psd2.y``)."""
        detector, _, axis = name.partition(".")
        table: AxisTable | None = getattr(getattr(self, detector), axis)
        return table

    def with_axis(
        self, detector: DetectorName, axis: AxisName, table: AxisTable
    ) -> "HeadFile":
        changed = msgspec.structs.replace(self.detector(detector), **{axis: table})
        return msgspec.structs.replace(self, **{detector: changed})

    def with_measured(self, by: str, on: str, *names: str) -> "HeadFile":
        """Return the file with the fields ``names`` marked as measured by the method ``by`` on the
        day ``on``. The uncertainties of an earlier commissioning are removed.
        """
        measured = {**self.measured, **{name: Measured(by=by, on=on) for name in names}}
        return msgspec.structs.replace(
            self, measured=measured, uncertainty=UncertaintyTable()
        )

    def absent(self, names: Sequence[str] = CALIBRATED) -> list[str]:
        """Return the fields that are not measured yet; for a file of version 1 only curves."""
        tables = msgspec.to_builtins(self)
        return [
            name
            for name in names
            if _entry_at(tables, name) is None and (self.head.version > 1 or name in CURVES)
        ]


def require_measured(file: HeadFile, source: str) -> None:
    """Raise DataError if a field that the head needs is not measured; the error contains these
    fields and the next command.
    """
    needed = QD_CALIBRATED if file.head.format == "tqd" else CALIBRATED
    if absent := file.absent(needed):
        raise DataError(
            f"{source}: {absent[0]}",
            expected=message("measured-field"),
            found=message("nothing-measured", names=absent),
            remedy=message("fourdof-commission-next"),
        )


def _entry_at(tables: object, name: str) -> object:
    for part in name.split("."):
        tables = tables.get(part) if isinstance(tables, dict) else None
    return tables


def parse_head_file(data: bytes, source: str) -> HeadFile:
    """Return the calibration file in ``data``. Raises UsageError with the wrong field."""
    file = convert(read_toml(as_text(data, source, UsageError), source), HeadFile, source)
    _check_date(file.head.date, f"{source}: head.date")
    for name, measured in file.measured.items():
        if name not in CALIBRATED:
            raise unknown_key(source, f"measured.{name}", name, list(CALIBRATED))
        _check_date(measured.on, f"{source}: measured.{name}.on")
    _check_uncertainty(file.uncertainty, f"{source}: uncertainty")
    for name in CURVES:
        axis = file.curve(name)
        if axis is not None and not np.isfinite(axis.coefficients_um).all():
            raise UsageError(
                f"{source}: {name}.coefficients_um",
                expected=message("a-number"),
                found=str(list(axis.coefficients_um)),
            )
        if axis is not None and axis.low >= axis.high:
            raise UsageError(
                f"{source}: {name}.high",
                expected=message("more-than-low", low=axis.low),
                found=f"{axis.high:g}",
            )
    return file


def _check_date(day: str, where: str) -> None:
    try:
        dt.date.fromisoformat(day)
    except ValueError as error:
        raise UsageError(where, expected=message("a-day"), found=day) from error


def _check_uncertainty(table: UncertaintyTable, where: str) -> None:
    count = len(table.of)
    for field, values, needed in (
        ("u", table.u, count),
        ("correlation", table.correlation, count * (count - 1) // 2),
    ):
        if len(values) != needed:
            raise UsageError(
                f"{where}.{field}",
                expected=message("values-count", count=needed),
                found=str(len(values)),
            )


def require_owner(file: HeadFile, section: HeadSection, source: str) -> None:
    """Raise DataError if the file belongs to another head than the head of the survey."""
    for field, of_file, of_survey in (
        ("id", file.head.id, section.id),
        ("format", file.head.format, section.format),
    ):
        if of_file != of_survey:
            raise DataError(
                f"{source}: head.{field}",
                expected=message("head-survey", of_survey=repr(of_survey)),
                found=f"{of_file!r}",
                remedy=message("name-calibration-file-head"),
            )


def render_head_file(file: HeadFile) -> str:
    """Return the file as text (TOML, LF): the same bytes for the same calibration. Raises
    UsageError for a file that its reader refuses.
    """
    lines = [
        (
            "# Calibration of a 4-DOF head (docs/fourdof.md). Curves: shift of the spot in um over "
            "difference / sum."
        ),
        "",
    ]
    lines += _section_lines("head", file.head)
    lines += _section_lines("lever", file.lever)
    for name in get_args(DetectorName):
        detector = file.detector(name)
        lines += _section_lines(name, detector)
        lines += _section_lines(f"{name}.x", detector.x)
        lines += _section_lines(f"{name}.y", detector.y)
    lines += _section_lines("light", file.light)
    lines += _section_lines("crosstalk", file.crosstalk)
    for name, measured in sorted(file.measured.items()):
        lines += _section_lines(f'measured."{name}"', measured)
    if file.uncertainty.of:
        lines += _section_lines("uncertainty", file.uncertainty)
    text = "\n".join(lines)
    parse_head_file(text.encode("utf-8"), "calibration")
    return text


def _section_lines(name: str, table: msgspec.Struct | None) -> list[str]:
    if table is None:
        return []
    fields = msgspec.structs.asdict(table)
    plain = {
        key: value
        for key, value in fields.items()
        if value is not None and not isinstance(value, msgspec.Struct)
    }
    return [
        f"[{name}]",
        *(f"{key} = {_toml_value(value)}" for key, value in plain.items()),
        "",
    ]


def _toml_value(value: object) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_toml_value, value)) + "]"
    if isinstance(value, float):
        return repr(
            float(value)
        )  # all digits; the repr of a numpy float would contain the name of its type
    # a JSON string is a TOML string, except for DEL
    return (
        msgspec.json.encode(value).decode().replace("\x7f", "\\u007f")
        if isinstance(value, str)
        else repr(value)
    )
