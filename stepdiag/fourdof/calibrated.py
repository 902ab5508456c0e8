"""The head as the solver takes it, from its calibration file."""

import math

import msgspec

from stepdiag.daq.survey.head_file import AxisTable, DetectorTable, HeadFile
from stepdiag.solver.fourdof.detector import Curve, Detector, DetectorAxis
from stepdiag.solver.fourdof.head import Crosstalk, Head


def calibrated(file: HeadFile) -> Head:
    """Return the head of a calibration file; the travel it asks for is then the distance."""
    return Head(
        qd=_detector(file.qd),
        psd1=_detector(file.psd1),
        psd2=_detector(file.psd2),
        psd1_focal_length_mm=file.head.psd1_focal_length_mm,
        psd2_focal_length_mm=file.head.psd2_focal_length_mm,
        dead_path_mm=file.lever.dead_path_mm,
        lever_scale=file.lever.scale,
        crosstalk=Crosstalk(**msgspec.structs.asdict(file.crosstalk)),
    )


def _detector(table: DetectorTable) -> Detector:
    ceiling = math.inf if table.sum_max is None else table.sum_max
    return Detector(x=_axis(table.x), y=_axis(table.y), sum_min=table.sum_min, sum_max=ceiling, rotation_mrad=table.rotation_mrad)


def _axis(table: AxisTable) -> DetectorAxis:
    curve = Curve(kind=table.kind, coefficients_um=table.coefficients_um, low=table.low, high=table.high, u_um=table.u_um)
    return DetectorAxis(sign=table.sign, curve=curve)
