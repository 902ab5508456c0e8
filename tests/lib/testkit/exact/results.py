"""Results made by hand, for tests of what comes after the solver."""

from collections.abc import Mapping, Sequence

import numpy as np

from stepdiag.base.findings import Finding
from stepdiag.base.result.result import DISPLACEMENTS, Function, Quantity, Result, Scale
from stepdiag.base.volume import Volume

VOLUME = Volume(origin_mm=(-200.0, 0.0, -100.0), size_mm=(400.0, 400.0, 200.0), increments=4)


def made_result(
    values: Mapping[str, Sequence[float] | None] | None = None,
    *,
    squareness: Mapping[str, float | None] | None = None,
    reversal: Mapping[str, Sequence[float]] | None = None,
    angles: Mapping[str, Sequence[float]] | None = None,
    chain: str = "FXYZ",
    shape_only: Sequence[str] = (),
    u_um: float = 0.3,
    volume: Volume = VOLUME,
    findings: tuple[Finding, ...] = (),
) -> Result:
    """Return a result with the values in um at the volume's nodes; a function that is not given is
    zero, None is not identified.

    ``angles`` in urad, by name (EAX ..): those that are not given are unknown.
    """
    given = dict(values or {})
    square = {"C0Y": 0.0, "B0Z": 0.0, "A0Z": 0.0} | dict(squareness or {})
    return Result(
        volume=volume,
        chain=chain,
        method="made by hand",
        errors={
            name: _function(
                volume,
                name,
                given.get(name, np.zeros(volume.increments + 1)),
                u_um,
                name not in shape_only,
            )
            for name in DISPLACEMENTS
        }
        | {
            name: _function(volume, name, rows, 1.0, True, "urad")
            for name, rows in (angles or {}).items()
        },
        squareness={
            name: Quantity(value=value, u=None if value is None else 1.0)
            for name, value in square.items()
        },
        scale={axis: Scale(value=None, u=None, identified=False) for axis in "XYZ"},
        setups={},
        findings=findings,
        reversal={
            name: _function(volume, name, rows, u_um, True)
            for name, rows in (reversal or {}).items()
        },
    )


def _function(
    volume: Volume,
    name: str,
    rows: Sequence[float] | None,
    u: float,
    slope: bool,
    unit: str = "um",
) -> Function:
    position = volume.nodes_mm("XYZ".index(name[2]))
    known = rows is not None
    return Function(
        position_mm=position,
        value=np.asarray(rows, dtype=np.float64) if known else None,
        u=np.full(position.shape, u) if known else None,
        unit=unit,
        slope_identified=slope,
    )
