"""The virtual 4-DOF head as its maker would describe it: calibration from the data sheet, and
sections for bench and survey."""

import math

from stepdiag.daq.survey.head_file import (
    AxisTable,
    DetectorTable,
    HeadFile,
    HeadIdentity,
    LeverTable,
    render_head_file,
)

HEAD_ID = "4D-001"
RADIUS_MM = 2.0
PSD_HALF_UM = 2000.0
QD_PATH_MM = 60.0


def head_file(**changes):
    """Return the ideal calibration of the virtual head's `HeadOptics`: erf of a 2 mm spot, linear
    PSDs, lever = distance + 30 mm."""
    quadrant = AxisTable(
        kind="erf",
        coefficients_um=(0.0, 1e3 * RADIUS_MM / math.sqrt(2.0)),
        low=-0.9,
        high=0.9,
        u_um=0.5,
    )
    lateral = AxisTable(coefficients_um=(0.0, PSD_HALF_UM), low=-0.95, high=0.95, u_um=0.1)
    return HeadFile(
        **{
            "head": HeadIdentity(
                id=HEAD_ID, format="fourdof", date="2026-03-31", reference="data sheet"
            ),
            "lever": LeverTable(dead_path_mm=QD_PATH_MM / 2, u_mm=1.0),
            "qd": DetectorTable(x=quadrant, y=quadrant, sum_min=2e5, sum_max=4e6),
            "psd1": DetectorTable(x=lateral, y=lateral, sum_min=2e5, sum_max=4e6),
            "psd2": DetectorTable(x=lateral, y=lateral, sum_min=2e5, sum_max=4e6),
            **changes,
        }
    )


def write_head_file(path, **changes):
    """Write the ideal calibration."""
    path.write_text(render_head_file(head_file(**changes)), encoding="utf-8")


def survey_section(port, *, name=HEAD_ID, calibration="head.toml", rest=""):
    """Return the [head] of a survey file."""
    return (
        f'\n[head]\nformat = "fourdof"\nport = "{port}"\nid = "{name}"\ncalibration = '
        f'"{calibration}"\n{rest}'
        "[head.fourdof]\nrate_hz = 250.0\nfull_sum = [1000000.0, 1000000.0, 1000000.0]\n"
    )
