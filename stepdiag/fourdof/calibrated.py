"""The 4-DOF head as an object of the solver, from its calibration file."""

import math

import msgspec

from stepdiag.daq.survey.head_file import AxisTable, DetectorTable, HeadFile, LeverTable
from stepdiag.solver.fourdof.detector import Curve, Detector, DetectorAxis
from stepdiag.solver.fourdof.head import Crosstalk, Head, Light


def calibrated(file: HeadFile) -> Head:
    """Return the head of a calibration file. For this head, the travel in `motion` is the distance
    from the laser. A missing field has the ideal value."""
    lever = file.lever or LeverTable()
    return Head(
        qd=_detector(file.qd),
        psd1=_detector(file.psd1),
        psd2=_detector(file.psd2),
        psd1_focal_length_mm=file.head.psd1_focal_length_mm,
        psd2_focal_length_mm=file.head.psd2_focal_length_mm,
        dead_path_mm=lever.dead_path_mm,
        lever_scale=lever.scale,
        light=None
        if file.light is None
        else Light(sums=file.light.sums, within=file.light.within),
        crosstalk=Crosstalk(
            **{
                name: value
                for name, value in msgspec.structs.asdict(file.crosstalk).items()
                if value is not None
            }
        ),
    )


def _detector(table: DetectorTable) -> Detector:
    ceiling = math.inf if table.sum_max is None else table.sum_max
    return Detector(
        x=_axis(table.x or AxisTable()),
        y=_axis(table.y or AxisTable()),
        sum_min=table.sum_min,
        sum_max=ceiling,
        rotation_mrad=table.rotation_mrad or 0.0,
        dark=table.dark or (0.0, 0.0, 0.0),
    )


def _axis(table: AxisTable) -> DetectorAxis:
    curve = Curve(
        kind=table.kind,
        coefficients_um=table.coefficients_um,
        low=table.low,
        high=table.high,
        u_um=table.u_um,
    )
    return DetectorAxis(sign=table.sign, curve=curve)
