"""Results for the references: odd numbers of few decimals, so that no two functions, axes or signs
can be taken for each other."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from stepdiag.base.findings import Finding
from stepdiag.base.result.members import Software
from stepdiag.base.result.result import DISPLACEMENTS, ROTATIONS, Quantity, Result, Scale
from stepdiag.base.volume import Volume
from testkit.exact.members import members, setups
from testkit.exact.results import made_result

VOLUME = Volume(origin_mm=(-200.0, 40.0, -150.0), size_mm=(300.0, 240.0, 180.0), increments=3)
SHAPES = {
    "EXX": (0.0, 3.317, 7.141, 11.863),
    "EYX": (0.0, 4.519, -2.731, 0.0),
    "EZX": (0.0, -3.137, 1.913, 0.0),
    "EXY": (0.0, 2.293, 5.179, 0.0),
    "EYY": (0.0, -4.327, -6.713, -9.137),
    "EZY": (0.0, -2.911, -4.177, 0.0),
    "EXZ": (0.0, -1.733, 3.319, 0.0),
    "EYZ": (0.0, 3.873, 2.127, 0.0),
    "EZZ": (0.0, 2.477, -1.913, 4.219),
}
SQUARE = {"C0Y": 21.37, "B0Z": -13.71, "A0Z": 17.13}
ANGLES = {
    "EAX": (0.0, 3.1, 5.3, 7.9),
    "EBX": (0.0, -2.3, -6.1, -7.3),
    "ECX": (0.0, 4.7, 3.7, 9.1),
    "EAY": (0.0, 6.1, 9.7, 13.3),
    "EBY": (0.0, 1.9, 2.9, 8.3),
    "ECY": (0.0, -5.3, -7.1, -11.9),
    "EAZ": (0.0, -3.7, -4.3, -9.7),
    "EBZ": (0.0, 5.9, 8.9, 14.9),
    "ECZ": (0.0, 2.1, 6.7, 8.1),
}
REVERSAL = {
    "EXX": (2.13, 2.37, 2.71, 2.29),
    "EYY": (-3.19, -3.47, -2.93, -3.31),
    "EYX": (0.0, 1.37, -1.93, 1.17),
}
BACKLASH = {
    "X": {"value": 2.34, "u": 0.21, "unit": "um"},
    "Y": {"value": -3.27, "u": 0.17, "unit": "um"},
}
OFF: Mapping[str, Any] = {
    "machine": "test machine",
    "compensation": "off",
    "active_files": [],
}


def result_of(
    *,
    shapes: Mapping[str, Sequence[float] | None] = SHAPES,
    squareness: Mapping[str, float | None] = SQUARE,
    angles: Mapping[str, Sequence[float]] | None = None,
    reversal: Mapping[str, Sequence[float]] | None = None,
    chain: str = "FXYZ",
    volume: Volume = VOLUME,
    shape_only: Sequence[str] = (),
    findings: tuple[Finding, ...] = (),
    **extra: Any,
) -> Result:
    """Return the result of a survey that says what was active (``survey``), by a program whose
    version never changes."""
    made = made_result(
        shapes,
        squareness=squareness,
        reversal=reversal,
        angles=angles,
        chain=chain,
        volume=volume,
        shape_only=shape_only,
        findings=findings,
    )
    return replace(
        made,
        software=Software(name="stepdiag", version="0"),
        **members(**{"survey": OFF, **extra}),
    )


PLAIN = result_of()
LEANING = result_of(angles=ANGLES)
TURNING = result_of(reversal=REVERSAL, backlash=BACKLASH)


def told() -> Result:
    """Return a result that says all that a report passes on."""
    full = result_of(
        angles={name: ANGLES[name] for name in ("EAX", "EBY", "ECY")},
        reversal=REVERSAL,
        shape_only=("EZZ",),
        findings=(
            Finding(code="scale-unidentified", severity="warning", text="the scale of Z"),
            Finding(code="closure", severity="info", text="the readings close to 0.4 µm"),
        ),
        backlash=BACKLASH,
        assumed={"angles_urad": 5.0, "drift_um": 0.4, "shape_um": 3.25},
        lengths={
            "tables": "as_measured",
            "material_c": [22.5, 22.75, 22.625],
            "as_measured": {
                "X": {"value": 11.9, "u": 0.8},
                "Y": {"value": -9.1, "u": 0.7},
                "Z": {"value": None, "u": None},
            },
            "at_20_c": {
                "X": {"value": -18.3, "u": 1.1},
                "Y": {"value": -39.7, "u": 1.2},
                "Z": {"value": None, "u": None},
            },
        },
        conditions={
            "assumed": {"air_temperature_c": 20.0, "relative_humidity_percent": 50.0}
        },
        tool={"up_to_um_per_100_mm": 1.43},
    )
    scale = {
        "X": Scale(value=39.5, u=0.8, identified=True),
        "Y": Scale(value=-38.1, u=0.7, identified=True),
        "Z": full.scale["Z"],
    }
    reports = setups(
        ppp={"passes": [1, 2], "repeatability_um": 0.31},
        linear_x={"passes": [1]},
        linear_y={"passes": [1]},
    )
    return replace(full, scale=scale, setups=reports)


def expecting() -> Result:
    """Return a result whose angles were not measured, with what its readings make likely of three
    of them."""
    full = result_of(angles={name: ANGLES[name] for name in ("EAX", "ECY", "EBZ")})
    likely = {name: function for name, function in full.errors.items() if name in ROTATIONS}
    return replace(
        full, errors={name: full.errors[name] for name in DISPLACEMENTS}, expected=likely
    )


def uncertain(result: Result, **u: float) -> Result:
    """Return a result with other standard uncertainties: of the squarenesses by name."""
    return replace(
        result,
        squareness={
            name: Quantity(value=q.value, u=u.get(name, q.u))
            for name, q in result.squareness.items()
        },
    )
