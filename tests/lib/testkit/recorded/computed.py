"""What the tables are computed from: curves, fits, products, angles, lattices and laws, number by
number, before any unit rounds them."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from stepdiag.base.result.result import POSITIONING, Function, Quantity, Result
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.tables import angular, fit, lattice
from stepdiag.exporters.tables.curves import Curve, curves_of
from stepdiag.exporters.tables.sampling import is_directional, quantised, sampled_um
from stepdiag.exporters.tables.tables import (
    Law,
    Multiplier,
    Table,
    correction_um,
    mean_correction_um,
    plain_rows,
    require_rising,
    summed_um,
    total_correction_um,
)
from testkit.recorded import plain
from testkit.recorded.profiles import profile_of
from testkit.recorded.results import (
    ANGLES,
    LEANING,
    PLAIN,
    REVERSAL,
    SHAPES,
    TURNING,
    result_of,
    told,
)

CHAINS = ("FXYZ", "XFYZ", "XYFZ", "ZYXF", "YFXZ")


def _curve(one: Curve) -> Any:
    return [
        list(one.parts),
        one.slope_known,
        *(
            _numbers(each)
            for each in (one.position_mm, one.forward_um, one.reverse_um, one.u_um)
        ),
        fit.straight_line_um_mm(one),
    ]


def _numbers(values: Any) -> Any:
    return (
        None
        if values is None
        else [
            float(f"{value:.10g}") + 0.0 if np.isfinite(value) else str(value)
            for value in values
        ]
    )


def _product(one: fit.Product) -> Any:
    return [
        *(_numbers(each) for each in (one.position_mm, one.value_um, one.u_um)),
        one.middle_mm,
        one.half_mm,
        one.rms_um,
    ]


def _fitted(result: Result, *names: str, **how: Any) -> Any:
    def act() -> Any:
        found = fit.fitted(result, *([list(names)] if names else []), **how)
        return {one.name: _curve(one) for one in found.curves} | {
            one.name: _product(one) for one in found.products
        }

    return plain.attempted(act)


def uneven() -> Result:
    """Return a result whose uncertainties differ from node to node, some of them unknown, angles
    with more nodes than the others."""

    def changed(name: str, one: Function) -> Function:
        if name in ("EXX", "EBY"):
            return replace(one, u=None)
        more = 0.125 * len(set(name)) * np.arange(1, len(one.position_mm) + 1)
        if name == "ECX":
            at = np.linspace(one.position_mm[0], one.position_mm[-1], 5)
            return replace(
                one,
                position_mm=at,
                value=np.array([0.0, 2.5, 7.5, 4.5, 8.0]),
                u=np.array([0.5, 1.0, 2.0, 1.5, 0.25]),
            )
        return replace(one, u=None if one.u is None else one.u + more)

    return replace(
        LEANING, errors={name: changed(name, one) for name, one in LEANING.errors.items()}
    )


def cases() -> dict[str, Callable[[], Any]]:
    """Return what is computed by its name."""
    return {
        "fits": _fits,
        "curves": _curves,
        "sampled": _sampled,
        "columns": _columns,
        "lattices": _lattices,
        "laws": _laws,
    }


def _fits() -> Any:
    names = ("EXX", "EYX", "EXY", "EZY", "EXZ")
    found: dict[str, Any] = {
        chain: _fitted(
            result_of(angles=ANGLES, chain=chain), *(names if chain != "FXYZ" else ())
        )
        for chain in CHAINS
    }
    found["uneven"] = _fitted(uneven())
    found["told"] = _fitted(told())
    zone = {"X": (-150.0, 50.0), "Z": (-150.0, -30.0)}
    found["zone"] = _fitted(uneven(), zone=zone)
    found["one angle"] = _fitted(result_of(angles={"EBX": ANGLES["EBX"]}))
    found["no lever"] = _fitted(
        result_of(angles={"ECZ": ANGLES["ECZ"]}, chain="FXYZ"), "EXZ", "EYZ"
    )
    found["hardly an angle"] = _fitted(
        result_of(angles={"EBX": (0.0, 0.01, 0.0, 0.01), "EAY": (0.0, 0.04, 0.0, 0.04)}),
        "EZX",
        "EZY",
    )
    for fold in ({"C0Y": "EYX"}, {"B0Z": "EZX", "A0Z": "EZY"}, {}):
        found[f"fold {fold}"] = _fitted(LEANING, "EYX", "EXY", "EZX", "EXZ", "EZY", fold=fold)
    for ends in ((-200.0, 100.0), (-201.0, 100.0), (-200.0, 101.0), (0.0, 0.0), (50.0, 0.0)):
        found[f"zone {ends}"] = _fitted(PLAIN, "EXX", zone={"X": ends})
    at, times = (
        np.array([-200.0, -50.0, 100.0]),
        Multiplier(
            axis="Z", position_mm=np.array([-150.0, 30.0]), value=np.array([-1.0, 1.0])
        ),
    )
    active = Table(
        kind="cec-product",
        input_axis="X",
        output_axis="Y",
        position_mm=at,
        value_um=np.array([0.0, 3.0, -5.0]),
        quantum_um=0.1,
        law=Law(sense="as-error"),
        reference_mm=-200.0,
        multiplier=times,
    )
    three, bent = np.array([-150.0, 0.0, 30.0]), np.array([-1.0, 1.0, 0.5])
    for name, table in (
        ("active", active),
        ("active, as compensation", replace(active, law=Law(sense="as-compensation"))),
        (
            "active, its lever turned",
            replace(active, multiplier=replace(times, value=np.array([1.0, -0.5]))),
        ),
        (
            "active, bent",
            replace(active, multiplier=replace(times, position_mm=three, value=bent)),
        ),
        (
            "active, constant",
            replace(active, multiplier=replace(times, value=np.array([1.0, 1.0]))),
        ),
        ("active, no product", replace(active, multiplier=None)),
    ):
        found[name] = _fitted(PLAIN, "EYX", "EYZ", active=[table])
    return found


def _curves() -> Any:
    """Reversals around what is significant, unknown uncertainties, and what refuses a curve."""

    def of(result: Result, *names: str, **how: Any) -> Any:
        return plain.attempted(
            lambda: {one.name: _curve(one) for one in curves_of(result, names, **how)}
        )

    def reversed_by(name: str, value: Any, u: Any, at: Any = None) -> Result:
        one = TURNING.reversal["EXX"]
        where = one.position_mm if at is None else np.array(at)
        own = replace(
            one,
            position_mm=where,
            value=None if value is None else np.array(value),
            u=None if u is None else np.array(u),
        )
        return replace(PLAIN, reversal={name: own})

    found: dict[str, Any] = {
        "turning": of(TURNING, *SHAPES),
        "shape": of(told(), "EZZ"),
        "uneven": of(uneven(), "EXX", "EYX"),
    }
    for um in (2.75, 3.0, 3.25, -3.25):
        found[f"reversal of {um}, u 1"] = of(
            reversed_by("EXX", [0.0, um, 0.0, 0.0], [1.0] * 4), "EXX"
        )
    for name in ("EXX", "EYX"):
        for first in (0.0, 0.5):
            found[f"{name} from u {first}"] = of(
                reversed_by(name, [9.0, 8.0, 7.0, 6.0], [first, 1.0, 1.0, 1.0]), name
            )
    found["reversal without u"] = of(reversed_by("EXX", [1.0, 2.0, 3.0, 4.0], None), "EXX")
    found["no reversal"] = of(reversed_by("EXX", None, [1.0] * 4), "EXX")
    found["neither"] = of(reversed_by("EXX", None, None), "EXX")
    found["elsewhere"] = of(reversed_by("EXX", [5.0, 9.0], [0.5, 0.5], (-150.0, 60.0)), "EXX")
    found["twice"] = of(PLAIN, "EXX", "EYX", "EXX")
    found["unknown name"] = of(PLAIN, "EAX")
    found["not identified"] = of(result_of(shapes={"EXX": None}), "EXX")
    found["no squareness"] = of(
        replace(PLAIN, squareness={"C0Y": Quantity(value=None, u=None)}), "EXY"
    )
    found["no squareness there"] = of(replace(PLAIN, squareness={}), "EXX", "EXZ")
    for fold in ({"C0Y": "EXX"}, {"Q0Y": "EXY"}, {"C0Y": "EYX", "B0Z": "EZX", "A0Z": "EZY"}):
        found[f"fold {fold}"] = of(PLAIN, "EXX", "EYX", "EZX", "EZY", fold=fold)
    one = replace(curves_of(TURNING, ["EXX"])[0])
    places = np.array([-300.0, -200.0, -120.0, 50.0, 100.0, 200.0])
    found["at"] = [_numbers(one.at(places, way)) for way in (-1, 0, 1)] + [
        _numbers(replace(one, reverse_um=None).at(places, way)) for way in (-1, 0, 1)
    ]
    return found


def _sampled() -> Any:
    found: dict[str, Any] = {}
    for direction in ("mean", "both"):
        for reference in (-200.0, -130.0, 100.0):
            profile = profile_of(
                "siemens",
                machine=f'direction = "{direction}"',
                axis={"X": f"reference_mm = {reference}"},
            )
            for name in ("EXX", "EYX", "EZX"):
                (one,) = curves_of(TURNING, [name])
                found[f"{name} {direction} from {reference}"] = [
                    is_directional(one, profile),
                    *(_numbers(each) for each in sampled_um(one, profile)),
                ]
    found["quantised"] = [
        str(value)
        for value in quantised(np.array([-0.04, 0.04, 0.06, -0.06, 1.24, -7.77]), 0.25)
    ]
    return found


def _columns() -> Any:
    """Angles as columns, for controls that count the travel of an axis among its levers and for
    those that do not."""
    found: dict[str, Any] = {}
    profile = profile_of(
        "beckhoff",
        steps={"X": 75.0, "Y": 80.0, "Z": 90.0},
        axis={"X": "reference_mm = -125.0"},
    )
    for chain in ("FXYZ", "XYFZ", "ZYXF"):
        for own in (False, True):
            made = fit.fitted(
                result_of(
                    angles=ANGLES, reversal=REVERSAL if chain == "XYFZ" else None, chain=chain
                )
            )
            levers = angular.levers_of(chain, own=own)
            columns = angular.columns_of(made.curves, made.products, levers, profile)
            tables = [
                table
                for angle in columns.angles
                for table in angular.angle_tables(
                    angle,
                    levers,
                    profile,
                    kind="k",
                    laws={
                        letter: Law(sense="as-compensation" if letter == "Y" else "as-error")
                        for letter in "XYZ"
                    },
                    quantum_urad=0.5,
                    place={"n": 1},
                )
            ]
            found[f"{chain} {own}"] = {
                "levers": levers.tolist(),
                "angles": {
                    one.name: [_numbers(one.position_mm), _numbers(one.value_urad)]
                    for one in columns.angles
                },
                "curves": {
                    one.name: [
                        _numbers(each) for each in (one.position_mm, one.mean_um, one.u_um)
                    ]
                    for one in columns.curves
                },
                "tables": {
                    str(one.label): [
                        _numbers(one.value_um),
                        one.quantum_um,
                        _numbers(angular.column_urad(one)),
                    ]
                    for one in tables[::3]
                },
                "times": [
                    _numbers(one.multiplier.at(np.array([-500.0, 10.0, 500.0])))
                    for one in tables[::3]
                    if one.multiplier
                ],
            }
    made = fit.fitted(LEANING)
    for name, levers, curves in (
        ("of another chain", angular.levers_of("ZYXF", own=False), made.curves),
        ("few functions", angular.levers_of("FXYZ", own=True), made.curves[:4]),
        ("alone", angular.levers_of("FXYZ", own=True), ()),
    ):
        found[name] = plain.attempted(
            lambda curves=curves, levers=levers: [
                [
                    one.name
                    for one in angular.columns_of(
                        curves, made.products, levers, profile
                    ).curves
                ],
                [
                    one.name
                    for one in angular.columns_of(
                        curves, made.products, levers, profile
                    ).angles
                ],
            ]
        )
    chained = profile_of("beckhoff", 'chain = "FXYZ"')
    for chain in ("FXYZ", "XFYZ"):
        found[f"required {chain}"] = [
            plain.attempted(
                lambda chain=chain, own=own: angular.require_chain(
                    result_of(chain=chain), own
                )
            )
            for own in (chained, profile)
        ]
    return found


def _lattices() -> Any:
    held = lattice.lattice_of(LEANING, 60.0)
    points = np.array(
        [
            [-200.0, 40.0, -150.0],
            [100.0, 280.0, 30.0],
            [-170.0, 100.0, -90.0],
            [-999.0, 160.0, 999.0],
            [10.0, 290.0, -1.0],
        ]
    )
    axes = (
        np.array([-250.0, -50.0, 150.0]),
        np.array([40.0, 300.0]),
        np.array([-150.0, 0.0]),
    )
    found: dict[str, Any] = {
        "whole": [[len(axis), float(axis[0]), float(axis[-1])] for axis in held.axes_mm],
        "corners": held.vectors_um[::5, ::4, ::3].reshape(-1).tolist(),
        "between": held.correction_um(points).tolist(),
        "on other axes": lattice.lattice_on(LEANING, axes).vectors_um.reshape(-1).tolist(),
        "over an active one": lattice.lattice_on(PLAIN, axes, held)
        .vectors_um.reshape(-1)
        .tolist(),
    }
    for step in (60.0, 45.0, 120.0, 240.0, 300.0, 700.0, 59.9999999999, 59.99999, 0.5, 1e-9):
        found[f"step {step}"] = plain.attempted(
            lambda step=step: list(lattice.lattice_of(PLAIN, step).vectors_um.shape)
        )
    cube = replace(PLAIN, volume=replace(PLAIN.volume, size_mm=(60.0, 60.0, 60.0)))
    found["one step of a cube"] = plain.attempted(
        lambda: list(lattice.lattice_of(cube, 60.0).vectors_um.shape)
    )
    made, other = lattice.render(held), ControlFile(name="a.com", data=b"x")
    for files in ((), (made,), (other,), (made, other), (made, made)):
        found[f"one in {[file.name for file in files]}"] = plain.attempted(
            lambda files=files: lattice.the_one_in(files, "p.toml").name
        )
    return found


def _laws() -> Any:
    """Tables one by one and together, at points on, between and beyond theirs."""
    at = np.array(
        [-300.0, -200.0, -199.9999995, -199.99999, -150.0, -100.0, 0.0, 40.0, 100.0, 250.0]
    )
    points = np.stack([at, at[::-1] + 100.0, at / 2.0], axis=-1)
    one = Table(
        kind="k",
        input_axis="X",
        output_axis="Y",
        position_mm=np.array([-200.0, -100.0, 100.0]),
        value_um=np.array([0.0, 5.0, -4.0]),
        quantum_um=0.5,
        law=Law(sense="as-error"),
        reference_mm=-100.0,
    )
    times = Multiplier(
        axis="Z", position_mm=np.array([-100.0, 50.0]), value=np.array([-0.5, 1.0])
    )
    tables = {
        "plain": one,
        "+": replace(one, direction=1, input_axis="Z", output_axis="X"),
        "-": replace(one, direction=-1),
        "stepped": replace(one, law=Law(sense="as-compensation", between="stepped")),
        "extended": replace(one, law=Law(sense="as-error", ends="extended")),
        "product": replace(one, multiplier=times),
        "product, extended": replace(
            one, output_axis="Z", multiplier=replace(times, axis="Y", ends="extended")
        ),
        **{
            f"incremental from {reference}": replace(
                one,
                law=Law(sense="as-error", data="incremental"),
                reference_mm=reference,
                offset_um=1.5,
            )
            for reference in (-300.0, -200.0, -100.0000005, -100.00001, 50.0, 100.0)
        },
    }
    found: dict[str, Any] = {
        name: [
            one.absolute_um.tolist(),
            correction_um(one, at).tolist(),
            correction_um(one, at, -1).tolist(),
            list(plain_rows(one)),
        ]
        for name, one in tables.items()
    }
    alike = [tables["plain"], tables["-"], tables["stepped"]]
    found["summed"] = [
        summed_um(alike, at).tolist(),
        summed_um(alike, at, -1).tolist(),
        summed_um([], at).tolist(),
    ]
    found["total"] = [
        total_correction_um(tables.values(), points, 1).tolist(),
        total_correction_um(tables.values(), points, -1).tolist(),
        mean_correction_um(list(tables.values()), points).tolist(),
    ]
    for values in ((1.0,), (1.0, 2.0), (1.0, 1.0), (2.0, 1.0), (1.0, 2.0, 2.0), ()):
        found[f"rising {values}"] = plain.attempted(
            lambda values=values: require_rising(np.array(values), "where")
        )
    found["positioning"] = list(POSITIONING)
    return found
