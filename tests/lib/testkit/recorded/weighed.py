"""Reference inputs at the limits: what was compensated, asked for or limited, drawn in sizes,
shifts and mixtures; a case on each side."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np

from stepdiag.base.result.field import error_field_um
from stepdiag.base.result.result import Result
from stepdiag.base.volume import grid_points_mm
from stepdiag.exporters.profiles.file import quick_profile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.safety.standing import Standing
from stepdiag.exporters.safety.verdicts.case import TableCase
from stepdiag.exporters.safety.verdicts.judge import judge
from stepdiag.exporters.safety.verdicts.lattice import judge_lattice
from stepdiag.exporters.safety.verdicts.wanted import Wanted, growing_um
from stepdiag.exporters.tables.curves import FUNCTIONS
from stepdiag.exporters.tables.fit import fitted
from stepdiag.exporters.tables.merge import merged
from stepdiag.exporters.tables.tables import Law, Multiplier, Table
from testkit import references
from testkit.recorded import plain
from testkit.recorded.checked import curve_of, table_of
from testkit.recorded.profiles import profile_of
from testkit.recorded.results import (
    LEANING,
    PLAIN,
    SHAPES,
    TURNING,
    VOLUME,
    expecting,
    result_of,
)

STEPPED = Law(sense="as-error", between="stepped")
PROFILE = quick_profile(controller_named("siemens"), VOLUME, 20.0)
FACTORS = (
    -3.1,
    -1.37,
    -1.0,
    -0.63,
    -0.23,
    0.017,
    0.13,
    0.37,
    0.57,
    0.63,
    0.83,
    1.0,
    1.17,
    1.37,
    1.43,
    1.83,
    2.7,
    6.1,
)


def asked(result: Result = PLAIN, law: Law = STEPPED, nodes: int = 13) -> list[Table]:
    """Return the tables that a result asks for."""
    law = replace(law, between="linear") if law is STEPPED else law
    found = []
    for curve in fitted(result).curves:
        at = np.linspace(curve.position_mm[0], curve.position_mm[-1], nodes)
        found.append(
            table_of(
                (-law.factor * curve.at(at)).tolist(),
                curve.name,
                at=at.tolist(),
                law=law,
                reference=float(at[0]),
                quantum=0.1,
            )
        )
    return found


def verdicts(
    tables: Sequence[Table],
    result: Result = PLAIN,
    before: Sequence[Table] = (),
    after: Sequence[Table] | None = None,
) -> list[Any]:
    """Return the verdict on each table: its code, what is said beside its label, its factor."""
    standing = Standing(
        before=tuple(before),
        after=tuple(tables if after is None else after),
        new=tuple(tables),
    )
    on = (
        replace(PROFILE, machine=msgspec.structs.replace(PROFILE.machine, measured_with="on"))
        if before
        else PROFILE
    )
    return [
        [one.code, references.plain(one.words.arguments.get("what", one.words)), one.factor]
        for one in judge(result, tables, standing, on)
    ]


def cases() -> dict[str, Callable[[], Any]]:
    """Return what is weighed by its name."""
    return {
        "sizes": _sizes,
        "shifts": _shifts,
        "mixtures": _mixtures,
        "slopes": _slopes,
        "products": _products,
        "over-others": _over_others,
        "fields": _fields,
        "parts": _parts,
        "merged": _merged,
    }


def _changed(tables: Sequence[Table], values: Callable[[int, Table], Any]) -> list[Table]:
    return [
        replace(table, value_um=np.asarray(values(index, table)))
        for index, table in enumerate(tables)
    ]


def _sizes() -> Any:
    """Every table in another size, each function in one of its own."""
    tables = asked()
    found: dict[str, Any] = {}
    for turn in range(0, len(FACTORS), 2):
        made = _changed(
            tables,
            lambda index, table, turn=turn: (
                table.value_um * FACTORS[(index + turn) % len(FACTORS)]
            ),
        )
        found[f"{turn}"] = verdicts(made)
    small = result_of(
        shapes={name: [0.05 * value for value in values] for name, values in SHAPES.items()},
        squareness={"C0Y": 0.7, "A0Z": -0.9},
    )
    for factor in (-6.0, -1.0, 0.3, 1.0, 2.3, 7.0, 21.0):
        found[f"small {factor:g}"] = verdicts(
            _changed(asked(small), lambda _, table, factor=factor: table.value_um * factor),
            small,
        )
    sure = replace(
        PLAIN,
        errors={
            name: replace(one, u=None if one.u is None else one.u * 0.0 + 3.0)
            for name, one in PLAIN.errors.items()
        },
    )
    for factor in (0.3, 1.5, 2.2):
        found[f"unsure {factor:g}"] = verdicts(
            _changed(tables, lambda _, table, factor=factor: table.value_um * factor), sure
        )
        coarse = [replace(table, quantum_um=4.0) for table in tables]
        found[f"coarse {factor:g}"] = verdicts(
            _changed(coarse, lambda _, table, factor=factor: table.value_um * factor)
        )
    found["compensation"] = verdicts(asked(law=Law(sense="as-compensation")))
    found["of two nodes"] = verdicts(asked(nodes=2))
    found["of three nodes"] = verdicts(
        _changed(asked(nodes=3), lambda index, table: table.value_um * (1.0 + 0.2 * index))
    )
    found["of many nodes"] = verdicts(
        _changed(asked(nodes=90), lambda index, table: table.value_um * (1.0 + 0.2 * index))
    )
    return found


def _shifts() -> Any:
    """Tables that lie elsewhere, shorter ones and longer ones."""
    tables = asked()
    found: dict[str, Any] = {}
    for share in (-1.6, -1.0, -0.61, -0.43, -0.13, 0.07, 0.29, 0.47, 0.53, 0.9, 1.3):
        found[f"by {share:g}"] = verdicts(
            [
                replace(each, position_mm=each.position_mm + share * np.ptp(each.position_mm))
                for each in tables
            ]
        )
    for first, last in ((0, 5), (0, 6), (0, 7), (6, 13), (3, 10), (7, 13)):
        found[f"points {first} to {last}"] = verdicts(
            [
                replace(
                    each,
                    position_mm=each.position_mm[first:last],
                    value_um=each.value_um[first:last],
                )
                for each in tables
            ]
        )
    for ends in ("held", "extended"):
        wide = [
            replace(
                each, position_mm=each.position_mm * 1.5, law=replace(each.law, ends=ends)
            )
            for each in tables
        ]
        found[f"wider, {ends}"] = verdicts(wide)
    return found


def _mixtures() -> Any:
    """Tables that hold part of another function, waves, origins."""
    tables = asked()
    found: dict[str, Any] = {}
    for own, other in (
        (0.0, 1.0),
        (0.0, -1.0),
        (0.2, 0.9),
        (0.5, 0.5),
        (0.7, -0.6),
        (0.05, 0.97),
        (0.0, 2.2),
    ):
        for step in (1, 4):
            found[f"{own:g} and {other:g} of {step} on"] = verdicts(
                _changed(
                    tables,
                    lambda index, table, own=own, other=other, step=step: (
                        own * table.value_um
                        + other * tables[(index + step) % len(tables)].value_um
                    ),
                )
            )
    for um in (0.3, 1.1, 2.3, 4.7, 9.0):
        wave = um * np.resize([1.0, -1.0, 0.5], 13)
        found[f"waves of {um:g}"] = verdicts(
            _changed(tables, lambda _, table, wave=wave: table.value_um + wave)
        )
        found[f"origin of {um:g}"] = verdicts(
            _changed(tables, lambda _, table, um=um: table.value_um + 10.0 * um)
        )
        lean = um * np.linspace(0.0, 3.0, 13)
        found[f"slope of {um:g}"] = verdicts(
            _changed(tables, lambda _, table, lean=lean: table.value_um + lean)
        )
    mirrored = {name: f"E{name[2]}{name[1]}" for name in FUNCTIONS}
    by_name = {table.name: table for table in tables}
    for sign in (1.0, -1.0, 0.8):
        found[f"mirrored {sign:g}"] = verdicts(
            _changed(
                tables,
                lambda _, table, sign=sign: sign * by_name[mirrored[table.name]].value_um,
            )
        )
    turning = asked(TURNING)
    found["one direction"] = verdicts(
        [replace(each, direction=1) for each in turning], TURNING
    )
    found["not known"] = verdicts(
        tables,
        result_of(
            shapes={**SHAPES, "EXX": None, "EZY": None},
            squareness={"C0Y": None, "B0Z": 1.0, "A0Z": 2.0},
        ),
    )
    return found


def _slopes() -> Any:
    """One number for two functions: extended tables of two points."""
    found: dict[str, Any] = {}
    wanted = {name: curves for name in FUNCTIONS if (curves := Wanted(PLAIN).as_slope(name))}
    found["as slopes"] = {
        name: [[float(f"{um:.9g}") for um in curve.forward_um] for curve in curves]
        for name, curves in wanted.items()
    }
    for factor in (-1.0, 0.2, 0.7, 1.0, 1.6, 3.0):
        tables = []
        for table in asked():
            at, um = table.position_mm[[0, -1]], table.value_um[[0, -1]] * factor
            tables.append(
                replace(
                    table,
                    position_mm=at,
                    value_um=um,
                    law=Law(sense="as-error", ends="extended"),
                )
            )
        found[f"times {factor:g}"] = verdicts(tables)
    return found


def _products() -> Any:
    made = fitted(LEANING)
    tables = []
    for product in made.products:
        middle, half = product.middle_mm, product.half_mm
        times = Multiplier(
            axis=product.by_axis,
            position_mm=np.array([middle - half, middle + half]),
            value=np.array([-1.0, 1.0]),
        )
        um = product.value_um.tolist()
        name = f"E{product.output_axis}{product.input_axis}"
        tables.append(
            replace(
                table_of(um, name, at=product.position_mm.tolist(), quantum=0.1),
                multiplier=times,
            )
        )
    found: dict[str, Any] = {}
    for turn in range(0, len(FACTORS), 2):
        factors = [FACTORS[(index + turn) % len(FACTORS)] for index in range(len(tables))]
        found[f"{turn}"] = verdicts(
            _changed(
                tables, lambda index, table, factors=factors: table.value_um * factors[index]
            ),
            LEANING,
        )
    found["not known"] = verdicts(tables[:3], PLAIN)
    found["expected"] = verdicts(tables[:6], expecting())
    bent = np.array([0.0, 1.5, -2.5, 4.0])
    found["bent"] = verdicts(
        _changed(tables, lambda index, table: table.value_um + bent * index), LEANING
    )
    own = [
        replace(each, multiplier=replace(each.multiplier, axis=each.input_axis))
        for each in tables[:2]
        if each.multiplier
    ]
    found["of itself"] = verdicts(own, LEANING)
    found["beside curves"] = verdicts(
        [*asked(LEANING), *tables[:2]], LEANING, after=[*asked(LEANING), *tables]
    )
    return found


def _over_others() -> Any:
    """New tables over such as acted while measuring, stepped ones among them."""
    old = [
        replace(each, law=STEPPED, value_um=np.round(0.6 * each.value_um[::-1], 1))
        for each in asked(nodes=7)
    ]
    residual = asked()
    found: dict[str, Any] = {}
    for factor in (0.0, 0.6, 1.0, 1.9):
        new = []
        for each, was in zip(residual, old, strict=True):
            held = np.interp(each.position_mm, was.position_mm, was.value_um)
            new.append(replace(each, value_um=held + factor * each.value_um))
        found[f"over steps, {factor:g}"] = verdicts(new, before=old)
        smooth = [replace(each, law=Law(sense="as-error")) for each in old]
        found[f"over lines, {factor:g}"] = verdicts(new, before=smooth)
    found["itself"] = verdicts(old, before=old)
    found["emptied"] = verdicts(
        [replace(each, value_um=0.0 * each.value_um) for each in old], before=old, after=()
    )
    before = [replace(old[0], value_um=old[0].value_um + 1.0)]
    case = TableCase(table=old[0], together=old[:2], before=before, volume=VOLUME)
    curve = curve_of("EXX", (0, 3, 1, 4), 0.3)
    fits = (case.fit(curve), case.fit(curve, 15.0), case.fit(curve, 15.0, 0.02))
    found["parts"] = [
        *([fit.factor, fit.left(), fit.rest_um] for fit in fits if fit is not None),
        case.unstepped(curve).forward_um.tolist(),
        [case.slope_left_um_mm(curve), case.is_slope],
    ]
    times = Multiplier(
        axis="Z", position_mm=np.array([-150.0, 30.0]), value=np.array([-0.5, 1.0])
    )
    for name, each in {
        "product along": replace(old[0], multiplier=times),
        "product across": replace(
            old[0],
            input_axis="Y",
            position_mm=old[0].position_mm + 200.0,
            multiplier=replace(times, axis="X"),
        ),
        "stepped product": replace(old[0], multiplier=times, law=STEPPED),
    }.items():
        both = TableCase(table=old[0], together=[old[0], each], before=[each], volume=VOLUME)
        fit = both.fit(curve)
        found[name] = [
            both.slope_left_um_mm(curve),
            both.unstepped(curve).forward_um.tolist(),
            None if fit is None else fit.factor,
        ]
    return found


def _fields() -> Any:
    """Corrections of the whole field, as lattices have them."""
    axes = (
        np.linspace(-200.0, 100.0, 5),
        np.linspace(40.0, 280.0, 4),
        np.linspace(-150.0, 30.0, 3),
    )

    def of(result: Result, moved: Callable[[Any], Any], at: Any = axes) -> Any:
        return [[one.code, one.factor] for one in judge_lattice(result, moved, at)]

    def right(result: Result) -> Callable[[Any], Any]:
        return lambda points: -error_field_um(result, points)

    found: dict[str, Any] = {}
    for factor in (-1.7, -0.4, 0.03, 0.45, 0.65, 1.0, 1.35, 1.45, 3.3):
        found[f"times {factor:g}"] = of(
            LEANING, lambda points, factor=factor: factor * right(LEANING)(points)
        )
    found["turned axes"] = of(LEANING, lambda points: right(LEANING)(points)[:, [1, 2, 0]])
    found["a part"] = of(
        LEANING, lambda points: right(LEANING)(points) * np.array([1.0, 0.2, 1.0])
    )
    found["expected"] = of(expecting(), right(LEANING))
    found["plain"] = of(PLAIN, right(LEANING))
    found["beside"] = of(PLAIN, right(PLAIN), (axes[0] + 120.0, axes[1] - 50.0, axes[2]))
    for um in (0.05, 0.11, 0.5):

        def bowed(points, um=um):
            return um * np.stack([np.sin(points[:, 0] / 40.0)] * 3, axis=-1)

        found[f"small {um:g}"] = of(result_of(shapes={}, squareness={}), bowed)
    return found


def _parts() -> Any:
    """The grids at which fields are compared, and what of a field grows with a lever."""
    points = grid_points_mm(VOLUME, 9)

    def bent_um(at):
        x, y, z = at.T
        return np.stack([x * y / 1e3 + 0.02 * z**2 - 0.3 * y] * 3, axis=1)

    return {
        "grid": [points[0].tolist(), points[1].tolist(), points[-1].tolist(), len(points)],
        "drawn": [
            [grid_points_mm(VOLUME, nodes)[n].tolist() for n in (0, 1, -2, -1)]
            for nodes in (2, 3, 5)
        ],
        "growing": [
            growing_um(bent_um, VOLUME, name).tolist() for name in ("EXX*Y", "EYY*X")
        ],
    }


def _merged() -> Any:
    """Curves over tables that acted while they were measured."""
    found: dict[str, Any] = {}
    curve = curve_of("EXX", (0.0, 3.0, -1.0, 4.0), 0.5)
    turned = replace(curve, reverse_um=np.array([0.5, 2.0, -2.0, 5.5]))
    at = (-190.0, -120.0, -10.0, 60.0)
    old = table_of((0.0, 2.0, 5.0, -3.0), at=at)
    tables = {
        "lines": [old],
        "steps": [replace(old, law=STEPPED)],
        "both ways": [
            replace(old, direction=1, law=STEPPED),
            replace(old, direction=-1, value_um=old.value_um[::-1]),
        ],
        "turned": [replace(old, law=Law(sense="as-compensation", ends="extended"))],
        "of another": [table_of((0.0, 2.0, 5.0, -3.0), "EYX")],
    }
    for direction in ("mean", "both"):
        profile = profile_of(
            "siemens", machine=f'direction = "{direction}"', steps={"X": 50.0}
        )
        for name, active in tables.items():
            for which, one in (("plain", curve), ("turned", turned)):

                def act(one: Any = one, active: Any = active, profile: Any = profile) -> Any:
                    (made,) = merged([one], active, profile)
                    return [
                        made.forward_um.tolist(),
                        None if made.reverse_um is None else made.reverse_um.tolist(),
                        made.u_um.tolist(),
                        list(made.parts),
                        made.slope_known,
                    ]

                found[f"{name}, {which}, {direction}"] = plain.attempted(act)
    return found
