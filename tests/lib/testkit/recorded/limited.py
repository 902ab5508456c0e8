"""What controls accept and ask for: limits, options with their defaults, steps of loading, which
products are worth their tables."""

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from functools import partial
from typing import Any

import msgspec
import numpy as np

from stepdiag.base.result.result import Result
from stepdiag.exporters.export.written import ExportReport
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.profiles.registry import CONTROLLERS, controller_named
from stepdiag.exporters.programs.settings import ProgramSection
from stepdiag.exporters.safety.checks import LIMITS, Case, run_checks
from stepdiag.exporters.safety.standing import unchanged
from stepdiag.exporters.siemens.products import chosen
from stepdiag.exporters.tables.controller import Limits, Plan
from stepdiag.exporters.tables.curves import Curve
from stepdiag.exporters.tables.fit import Product, fitted
from stepdiag.exporters.tables.profile import (
    AxisSection,
    LimitsSection,
    MachineSection,
    SignTestRecord,
)
from stepdiag.exporters.tables.tables import Law, Multiplier, Table
from testkit.recorded import plain
from testkit.recorded.checked import checked, curve_of, limited, table_of
from testkit.recorded.damaged import planned
from testkit.recorded.exported import BOTH, LISTS, WIDE, fanuc_section, said
from testkit.recorded.profiles import profile_of
from testkit.recorded.results import LEANING, PLAIN, TURNING

SIZES = "eec_points = { X = 9 }\ncec_points = 7\ncec_tables_held = 16\ncec_max_velo = 0.3\n"
HOW: Mapping[str, tuple[str, dict[str, Any]]] = {
    "siemens": ("siemens", {}),
    "siemens, sizes": ("siemens", {"more": SIZES}),
    "siemens, products": ("siemens", {"more": "products = true\ncec_max_velo = 0.25"}),
    "fanuc": ("fanuc", {"files": WIDE}),
    "fanuc, all": (
        "fanuc",
        {
            "files": WIDE,
            "section": fanuc_section(
                "points_per_axis = 64\nstraightness_option = true", "inclination = true"
            ),
        },
    ),
    "heidenhain": ("heidenhain", {}),
    "heidenhain, itnc": (
        "heidenhain",
        {"section": '[heidenhain]\ngeneration = "itnc530"\nchain = "FXYZ"'},
    ),
    "linuxcnc": ("linuxcnc", {}),
    "linuxcnc, backlash": ("linuxcnc", {"axes": "backlash_um = 3.5", "machine": BOTH}),
    "linuxcnc, kinematics": ("linuxcnc", {"more": 'way = "kinematics"'}),
    "beckhoff": ("beckhoff", {"more": "max_records = 300"}),
    "beckhoff, chain": ("beckhoff", {"more": 'chain = "FXYZ"'}),
    "beckhoff, lists": (
        "beckhoff",
        {
            "section": LISTS
            + 'cross_sense = "as-error"\nssfk_points = 90\ncross_points = 80',
            "machine": 'functions = ["EXX", "EYY", "EZZ", "EYX", "EXZ"]',
        },
    ),
    "mitsubishi": ("mitsubishi", {}),
    "mitsubishi, absolute": (
        "mitsubishi",
        {
            "section": '[mitsubishi]\noutput_unit_um = 0.05\ndata = "absolute"\nfirst_data = 4501'
        },
    ),
    "fagor": ("fagor", {}),
    "neutral": ("neutral", {}),
}


def cases() -> dict[str, Callable[[], Any]]:
    """Return what is accepted and asked by its name."""
    return {
        "options": _options,
        "limits": _limits,
        "nets": _nets,
        "worth": _worth,
        "unchanged": _unchanged,
        "free-names": _free_names,
        "before": _before,
    }


def _options() -> Any:
    """Every field of a profile with its type, its limits and its default."""
    models = [
        MachineSection,
        AxisSection,
        LimitsSection,
        SignTestRecord,
        ProgramSection,
        *(control.options for control in CONTROLLERS.values()),
    ]
    found: dict[str, Any] = {}
    while models:
        model = models.pop(0)
        if model.__name__ in found:
            continue
        found[model.__name__] = {
            field.name: f"{field.type} = {_default(field)}"
            for field in msgspec.structs.fields(model)
        }
        found[model.__name__]["(unknown)"] = model.__struct_config__.forbid_unknown_fields
        for field in msgspec.structs.fields(model):
            models += [each for each in _inner(field.type) if each.__name__ not in found]
    for plain_model in (Limits, Plan, ExportReport, Table, Multiplier, Law, Curve):
        found[plain_model.__name__] = {
            field.name: str(field.default).replace("<dataclasses._MISSING_TYPE object at", "")
            for field in fields(plain_model)
            if "MISSING" not in str(field.default)
        }
    for name, control in CONTROLLERS.items():
        found[name] = [control.title, *control.kinds]
    return found


def _inner(hint: Any) -> list[type[msgspec.Struct]]:
    """Return the models within an annotation."""
    if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
        return [hint]
    return [each for part in getattr(hint, "__args__", ()) for each in _inner(part)]


def _default(field: Any) -> str:
    if field.default_factory is not msgspec.NODEFAULT:
        return str(field.default_factory())
    return "?" if field.default is msgspec.NODEFAULT else repr(field.default)


def _limits() -> Any:
    """What every control accepts in each kind of table that it is given, and how its files are
    loaded."""
    found: dict[str, Any] = {}
    for name, (control, how) in HOW.items():
        controller, profile = controller_named(control), profile_of(control, **how)
        leaning = "chain" in str(how) or "products" in str(how)
        found[name] = plain.attempted(
            partial(_of_plan, controller, profile, LEANING if leaning else PLAIN)
        )
    return found


def _of_plan(controller: Any, profile: Any, result: Result) -> Any:
    fit = fitted(result, profile.machine.functions, profile.machine.squareness_into)
    plan = (
        controller.plan_products(fit.curves, fit.products, profile)
        if hasattr(controller, "plan_products")
        else controller.plan(fit.curves, profile)
    )
    settled = replace(profile, options=plan.options or profile.options)
    by_kind = {
        f"{table.kind} {table.input_axis}": str(controller.limits(table, settled))
        for table in (*plan.tables, *plan.listed)
    }
    return {
        "limits": by_kind,
        "steps": len(controller.instructions(settled)),
        "findings": [said(item) for item in plan.findings],
    }


def _nets() -> Any:
    """What acts at the points of a table beside angles whose levers count from the zero of the
    axes; limits without a survey."""
    ends = np.array([-200.0, 100.0])
    angle = replace(
        table_of((0.0, 30.0, -20.0, 60.0), "EYX", kind="volcomp-angle"),
        multiplier=Multiplier(
            axis="Z", position_mm=ends, value=ends / 100.0, ends="extended"
        ),
    )
    base = limited(profile_of("siemens"), value_um=64.0, warn_value_um=32.0, slope_um_mm=0.4)
    column = table_of((0.0, 20.0, -12.0, 37.0), "EYX", kind="volcomp")
    along = table_of(
        (0.0, 30.0, 60.0), "EYZ", kind="volcomp", at=(-150.0, -60.0, 30.0), reference=-150.0
    )
    found = {
        "beside an angle": checked([column, angle], profile=base, own=Limits()),
        "along its lever": checked([along, angle], profile=base, own=Limits()),
        "of another axis": checked(
            [replace(column, output_axis="Z"), angle], profile=base, own=Limits()
        ),
        "beside a held lever": checked(
            [column, replace(angle, multiplier=replace(angle.multiplier, ends="held"))],
            profile=base,
            own=Limits(),
        ),
        "far away": checked(
            [
                replace(column, value_um=-angle.value_um * 50.0),
                replace(angle, value_um=angle.value_um * 80.0),
            ],
            profile=base,
            own=Limits(),
        ),
        "two columns": checked(
            [column, replace(column, place={"n": 2}), angle], profile=base, own=Limits()
        ),
        "an empty one first": checked(
            [table_of((0, 0, 0, 0), "EYX", kind="cec"), table_of((0, 1, 60, 3))],
            before=[table_of((0, 1, 2, 3)), table_of((0, 5, 2, 3), "EYX", kind="cec")],
            profile=base,
        ),
    }
    control = controller_named("siemens")
    for name, tables in {
        "right": [table_of((0, 1, 2, 0))],
        "nan": [table_of((0, 1, np.nan, 0))],
        "large": [table_of((0, 1, 70, 0), "EYX", kind="cec")],
        "steep": [table_of((0, 1, 45, 0))],
    }.items():
        inch = replace(base, machine=msgspec.structs.replace(base.machine, units="inch"))
        for unit, profile in (("", base), (", inch", inch)):
            case = Case(controller=control, profile=profile, result=PLAIN, tables=tables)
            found[f"limits alone, {name}{unit}"] = [
                said(item) for item in run_checks(case, LIMITS)
            ]
    return found


def _worth() -> Any:
    """Which curves and products get the tables that there are."""
    at = (-200.0, -100.0, 0.0, 100.0)
    curves = [
        curve_of("EYX", (0, 3, 1, 0), 0.3, at),
        curve_of("EXX", (0, 9, 1, 0), 0.3, at),
        curve_of("EZX", (0, 9, -8, 4), 0.3, at),
    ]
    curves += [
        curve_of("EXY", (0, 6, -5, 4), 0.3, at),
        curve_of("EZY", (0, 0.5, 0.25, 0), 0.3, at),
    ]
    takes = {"EYX": 1, "EXX": 0, "EZX": 2, "EXY": 1, "EZY": 1}

    def product(name: str, rms: float) -> Product:
        return Product(
            output_axis=name[1],
            input_axis=name[2],
            by_axis=name[4],
            position_mm=np.array(at),
            value_um=np.array([0.0, 1.0, 2.0, 3.0]),
            u_um=np.zeros(4),
            middle_mm=0.0,
            half_mm=50.0,
            rms_um=rms,
        )

    some = [
        product("EYX*Z", 5.0),
        product("EXX*Z", 4.0),
        product("EYX*Y", 2.0),
        product("EXY*Z", 1.5),
        product("EZZ*X", 0.0),
    ]
    found: dict[str, Any] = {}
    for room in (None, -1, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 12):
        for what, products in (
            ("none", []),
            ("some", some),
            ("equal", [replace(each, rms_um=2.0) for each in some]),
        ):
            made = chosen(curves, takes, products, room)
            found[f"{room} for {what}"] = [
                list(made.curves),
                [each.name for each in made.products],
                list(made.left_out),
            ]
    many = [
        product(f"E{a}{b}*{c}", 3.0 + n / 8)
        for n, (a, b, c) in enumerate(
            (a, b, c) for a in "XYZ" for b in "XY" for c in "XYZ" if b != c
        )
    ]
    for room in (None, 5, 11):
        made = chosen(curves[:1], takes, many, room)
        found[f"{room} for many"] = [
            list(made.curves),
            [each.name for each in made.products],
            list(made.left_out),
        ]
    return found


def _unchanged() -> Any:
    one, other = table_of((0, 4, 2, 0)), table_of((1, 1, 2, 2), at=(-250, -150, 50, 100))
    pairs: dict[str, tuple[list[Table], list[Table]]] = {
        "itself": ([one], [one]),
        "halves": ([one, other], [other, one]),
    }
    for um in (1.75, 2.0, 2.25, -2.0, -2.25):
        pairs[f"moved by {um}"] = (
            [replace(one, value_um=one.value_um + np.array([0.0, 0.0, um, 0.0]))],
            [one],
        )
        pairs[f"an origin of {um}"] = ([replace(one, value_um=one.value_um + um)], [one])
        pairs[f"one way by {um}"] = (
            [
                replace(one, direction=1),
                replace(
                    one, direction=-1, value_um=one.value_um + np.array([0.0, um, 0.0, 0.0])
                ),
            ],
            [one],
        )
        pairs[f"of a coarser one by {um}"] = (
            [replace(one, value_um=one.value_um + np.array([0, um, 0, 0]))],
            [replace(one, quantum_um=1.125)],
        )
    pairs["one way only"] = ([replace(one, direction=1)], [replace(one, direction=1)])
    pairs["turned"] = ([replace(one, law=Law(sense="as-compensation"))], [one])
    return {name: unchanged(now, then) for name, (now, then) in pairs.items()}


def _free_names() -> Any:
    """The restore files of a machine that has files of the usual names."""
    control = controller_named("siemens")
    found: dict[str, Any] = {}
    made, settled = planned(
        "siemens", PLAIN, profile_of("siemens", machine='functions = ["EXX", "EYX"]')
    )
    own = {file.name: file.data for file in made}
    texts: dict[str, dict[str, bytes]] = {
        "nothing": {},
        "data": {name: data for name, data in own.items() if name.endswith("INI")},
        "programs": {name: data for name, data in own.items() if name.endswith("MPF")},
        "small letters": {name.lower(): data for name, data in own.items()},
        "zeros": {
            "NC_CEC_ZERO.INI": own["NC_CEC.INI"],
            "LOAD_CEC.MPF": b"; nothing\n",
            "LOAD_CEC_2.MPF": b"; nothing\n",
            "AX_EEC.INI": own["AX_EEC.INI"],
        },
        "two": {
            "A.INI": own["NC_CEC.INI"],
            "B.INI": own["NC_CEC.INI"].replace(b"0.00", b"0.01"),
        },
    }
    for what, files in texts.items():
        profile = profile_of("siemens", files=files, machine='functions = ["EXX", "EYX"]')
        tables = control.parse(
            [ControlFile(name=file.name, data=file.data) for file in made], settled
        )
        elsewhere = [
            replace(table, place={**table.place, "table": 5})
            if table.kind == "cec"
            else table
            for table in tables
        ]
        for where, some in (("there", tables), ("elsewhere", elsewhere)):

            def act(some: Any = some, profile: Any = profile) -> Any:
                return {
                    file.name: [len(file.data), plain.lines(file.data)[-4:]]
                    for file in control.restore(some, profile)
                }

            found[f"{what}, {where}"] = plain.attempted(act)
    return found


def _before() -> Any:
    """Old tables beside new ones in both directions of travel."""
    old = [table_of((0, 1, 2, 3), direction=1), table_of((0, 2, 2, 5), direction=-1)]
    profile = limited(profile_of("siemens"), change_um=2.0)
    return {
        f"{um:g} µm, {way}": checked(
            [table_of((0, 1, um, 3), direction=way)],
            before=old,
            profile=profile,
            result=TURNING,
        )
        for um in (2, 3, 4, 5)
        for way in (0, 1, -1)
    }
