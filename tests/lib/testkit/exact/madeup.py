"""A result made up for the tests of what shows results: smooth functions, known numbers, every
branch used."""

from typing import Any

import numpy as np

from stepdiag.base.findings import Finding
from stepdiag.base.result.members import Software
from stepdiag.base.result.result import (
    DISPLACEMENTS,
    ROTATIONS,
    SQUARENESS,
    Function,
    Quantity,
    Result,
    Scale,
)
from stepdiag.base.volume import Volume
from testkit.exact.members import members, setups

VOLUME = Volume(origin_mm=(0.0, 0.0, -300.0), size_mm=(500.0, 400.0, 300.0), increments=10)


def made_up_result(
    *,
    amplitude_um: float = 8.0,
    u_um: float = 0.4,
    scales: bool = False,
    angles: bool = False,
    reversal: bool = True,
    **extra: Any,
) -> Result:
    """Return a result whose functions are waves of this amplitude with this standard
    uncertainty."""
    names = (*DISPLACEMENTS, *(ROTATIONS if angles else ()))
    errors = {
        name: _wave(order, name, amplitude_um, u_um, scales)
        for order, name in enumerate(names)
    }
    turned = {name: _reversal(errors[name]) for name in ("EXX", "EYY")} if reversal else {}
    findings = (
        ()
        if scales
        else (
            Finding(
                code="scale-unidentified",
                severity="warning",
                text="the scales of X, Y and Z separately",
            ),
        )
    )
    slope = 12.0 if scales else None
    return Result(
        volume=VOLUME,
        chain="FXYZ",
        method="estimate",
        errors=errors,
        squareness={
            name: Quantity(value=20.0 - 12.0 * order, u=0.4)
            for order, name in enumerate(SQUARENESS)
        },
        scale={
            letter: Scale(value=slope, u=0.3 if scales else None, identified=scales)
            for letter in "XYZ"
        },
        setups=setups(
            ppp={"tilt_mrad": 0.43, "repeatability_um": 0.25}, npp={"tilt_mrad": 0.54}
        ),
        findings=findings,
        reversal=turned,
        software=Software(name="stepdiag", version="0.1.0"),
        **members(**extra),
    )


def _wave(order: int, name: str, amplitude_um: float, u_um: float, scales: bool) -> Function:
    nodes = VOLUME.nodes_mm("XYZ".index(name[2]))
    fraction = (nodes - nodes[0]) / (nodes[-1] - nodes[0])
    slope = 12e-3 * (nodes - nodes[0]) if scales and name[1] == name[2] else 0.0
    value = (
        amplitude_um * np.sin(np.pi * fraction * (1 + order % 3)) * (1 if order % 2 else -0.7)
        + slope
    )
    known = scales or name[1] != name[2]
    unit = "um" if name in DISPLACEMENTS else "urad"
    u = u_um * np.sqrt(np.clip(4 * fraction * (1 - fraction), 0, None))
    return Function(position_mm=nodes, value=value, u=u, unit=unit, slope_identified=known)


def _reversal(function: Function) -> Function:
    nodes = function.position_mm
    return Function(
        position_mm=nodes,
        value=np.linspace(0.0, 1.5, len(nodes)),
        u=np.full(len(nodes), 0.3),
        unit="um",
    )
