"""Files judged by ``verify``: right ones and such as people mistake for them, with every figure
that is promised of each."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from stepdiag.base.result.result import Quantity, Result
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.safety.verify import Verification, verify_files
from stepdiag.exporters.tables import lattice
from stepdiag.exporters.tables.fit import fitted
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table
from testkit import references
from testkit.recorded import plain
from testkit.recorded.exported import BOTH, LISTS, exported_files, measured_on, own_of, said
from testkit.recorded.profiles import profile_of
from testkit.recorded.results import (
    ANGLES,
    LEANING,
    PLAIN,
    SHAPES,
    TURNING,
    expecting,
    result_of,
    told,
)

FINE = {"X": 25.0, "Y": 20.0, "Z": 15.0}
Change = Callable[[Table], Table]


def verified(result: Result, files: Sequence[ControlFile], profile: Profile | None) -> Any:
    """Return all that ``verify`` says."""

    def act() -> dict[str, Any]:
        found = verify_files(result, files, profile)
        return _as_data(found)

    return plain.attempted(act)


def _as_data(found: Verification) -> dict[str, Any]:
    figures = [
        number
        for rigid in (True, False)
        for each in found.prediction.figures(rigid_motion=rigid)
        for number in (each.largest_um, each.rms_um)
    ]
    states = {
        "assumed": found.assumed,
        "right": found.right,
        "worse": found.prediction.worse,
        "clearly worse": found.prediction.clearly_worse,
    }
    return {
        "is": [found.controller, *(word for word, holds in states.items() if holds)],
        "figures": figures,
        "judgements": [
            f"{each.code}: {references.plain(each.words)}"
            for each in found.judgements
            if each.code != "right"
        ],
        "factors": [each.factor for each in found.judgements],
        "findings": [said(item) for item in found.findings],
    }


def _planned(control: str, result: Result, profile: Profile) -> tuple[list[Table], Profile]:
    controller = controller_named(control)
    fit = fitted(result, profile.machine.functions, profile.machine.squareness_into)
    plan = (
        controller.plan_products(fit.curves, fit.products, profile)
        if hasattr(controller, "plan_products")
        else controller.plan(fit.curves, profile)
    )
    return list(plan.tables), replace(profile, options=plan.options or profile.options)


def mistaken(
    control: str,
    change: Callable[[list[Table]], list[Table]],
    *,
    result: Result = PLAIN,
    asked: Result | None = None,
    **how: Any,
) -> Callable[[], Any]:
    """Return a case: the tables that a result asks for, changed, written, and judged by the result
    that is ``asked``."""

    def act() -> Any:
        tables, settled = _planned(control, result, profile_of(control, **how))
        files = [
            file
            for file in controller_named(control).render(change(tables), settled)
            if file.role == "data"
        ]
        return verified(asked or result, files, settled)

    return act


def of(name: str, change: Change) -> Callable[[list[Table]], list[Table]]:
    """Return a change of the tables of one function; ``""`` of all."""
    return lambda tables: [
        change(table) if name in ("", table.name) else table for table in tables
    ]


def scaled(factor: float) -> Change:
    return lambda table: replace(
        table,
        value_um=np.round(table.value_um * factor / table.quantum_um) * table.quantum_um,
    )


def shifted(mm: float) -> Change:
    return lambda table: replace(table, position_mm=table.position_mm + mm)


def added(um: Sequence[float]) -> Change:
    """Return a change by values that repeat along the table."""
    return lambda table: replace(
        table, value_um=table.value_um + np.resize(np.asarray(um), table.value_um.shape)
    )


def put_for(one: str, other: str) -> Callable[[list[Table]], list[Table]]:
    """Return a change that gives the values of one function to another one."""

    def change(tables: list[Table]) -> list[Table]:
        (taken,) = (table for table in tables if table.name == one)
        grid = np.linspace(0.0, 1.0, len(taken.value_um))
        return [
            replace(
                table,
                value_um=np.round(
                    np.interp(
                        np.linspace(0.0, 1.0, len(table.value_um)), grid, taken.value_um
                    ),
                    1,
                ),
            )
            if table.name == other
            else table
            for table in tables
        ]

    return change


def _swapped(one: str, other: str) -> Callable[[list[Table]], list[Table]]:
    """Return a change that puts each of two tables, with its own grid, into the place of the
    other."""

    def change(tables: list[Table]) -> list[Table]:
        a, b = (
            next(table for table in tables if table.name == name) for name in (one, other)
        )
        return [
            replace(a, input_axis=b.input_axis, output_axis=b.output_axis),
            replace(b, input_axis=a.input_axis, output_axis=a.output_axis),
        ]

    return change


def cases() -> dict[str, Callable[[], Any]]:
    """Return what is judged, by its name."""
    found: dict[str, Callable[[], Any]] = {
        "right": mistaken("siemens", lambda tables: tables, steps=FINE)
    }
    for factor in (-1.0, 0.1, 0.45, 0.6, 1.4, 1.8, 2.0, -2.0, -0.5, 10.0, 0.02):
        found[f"all-times-{factor:g}"] = mistaken(
            "siemens", of("", scaled(factor)), steps=FINE
        )
    for name in ("EXX", "EZY", "EXZ"):
        for factor in (-1.0, 2.5, -3.0, 0.0):
            found[f"{name}-times-{factor:g}"] = mistaken(
                "siemens", of(name, scaled(factor)), steps=FINE
            )
        for mm in (250.0, -5000.0, 30.0):
            found[f"{name}-by-{mm:g}-mm"] = mistaken(
                "siemens", of(name, shifted(mm)), steps=FINE
            )
        found[f"{name}-with-waves"] = mistaken(
            "siemens", of(name, added((9.0, -7.0, 4.0))), steps=FINE
        )
        found[f"{name}-with-an-origin"] = mistaken(
            "siemens", of(name, added((5.0,))), steps=FINE
        )
        found[f"{name}-with-a-slope"] = mistaken(
            "siemens",
            of(
                name,
                lambda table: replace(
                    table, value_um=np.round(table.value_um + 0.02 * table.position_mm, 1)
                ),
            ),
            steps=FINE,
        )
    for one, other in (
        ("EXX", "EYY"),
        ("EYX", "EXY"),
        ("EXY", "EYX"),
        ("EZX", "EYX"),
        ("EXZ", "EYZ"),
    ):
        found[f"{one}-for-{other}"] = mistaken("siemens", put_for(one, other), steps=FINE)
    for one, other in (("EYX", "EXY"), ("EXX", "EYY"), ("EYX", "EZX")):
        found[f"{one}-and-{other}-swapped"] = mistaken(
            "siemens", _swapped(one, other), steps=FINE
        )
    found["of-another-machine"] = mistaken(
        "siemens", lambda tables: tables, result=told(), asked=LEANING, steps=FINE
    )
    small = result_of(shapes={"EXX": (0.0, 0.31, 0.13, 0.27)}, squareness={"C0Y": 0.5})
    found["of-small-errors"] = mistaken(
        "siemens", of("EXX", scaled(3.0)), result=small, steps=FINE
    )
    unknown = result_of(shapes={**SHAPES, "EZZ": None})
    found["not-identified"] = mistaken(
        "siemens", lambda tables: tables, asked=unknown, steps=FINE
    )
    unsquare = replace(
        PLAIN, squareness={**PLAIN.squareness, "C0Y": Quantity(value=None, u=None)}
    )
    found["squareness-not-identified"] = mistaken(
        "siemens", lambda tables: tables, asked=unsquare, steps=FINE
    )
    found["measuring-system"] = mistaken(
        "siemens",
        of(
            "",
            lambda t: replace(
                t, place={**t.place, **({"measuring system": 2} if t.kind == "eec" else {})}
            ),
        ),
        steps=FINE,
    )
    found["both-directions"] = mistaken(
        "siemens",
        lambda tables: tables,
        result=TURNING,
        machine=BOTH,
        axes="backlash_um = 0.0",
        steps=FINE,
    )
    found["one-direction"] = mistaken(
        "siemens",
        lambda tables: [t for t in tables if t.direction >= 0],
        result=TURNING,
        machine=BOTH,
        axes="backlash_um = 0.0",
        steps=FINE,
    )
    for name, change in (
        ("right", lambda tables: tables),
        ("turned", of("EYX*Z", scaled(-1.0))),
        (
            "doubled",
            of(
                "",
                lambda table: scaled(2.0)(table) if table.multiplier is not None else table,
            ),
        ),
        (
            "slightly",
            of(
                "",
                lambda table: scaled(1.3)(table) if table.multiplier is not None else table,
            ),
        ),
        (
            "fivefold-turned",
            of(
                "",
                lambda table: scaled(-5.0)(table) if table.multiplier is not None else table,
            ),
        ),
        (
            "empty",
            of(
                "",
                lambda table: scaled(0.001)(table) if table.multiplier is not None else table,
            ),
        ),
        (
            "bent",
            of(
                "",
                lambda table: (
                    added((4.0, -6.0))(table) if table.multiplier is not None else table
                ),
            ),
        ),
    ):
        found[f"products-{name}"] = mistaken(
            "siemens", change, more="products = true", result=LEANING, steps=FINE
        )
    found["products-unasked"] = mistaken(
        "siemens",
        lambda tables: tables,
        more="products = true",
        result=LEANING,
        asked=PLAIN,
        steps=FINE,
    )
    found["products-expected"] = mistaken(
        "siemens",
        lambda tables: tables,
        more="products = true",
        result=LEANING,
        asked=expecting(),
        steps=FINE,
    )
    for control, how in (
        ("heidenhain", {}),
        ("linuxcnc", {}),
        ("beckhoff", {}),
        ("mitsubishi", {}),
        ("fagor", {}),
        ("neutral", {}),
        (
            "beckhoff",
            {
                "section": LISTS + 'cross_sense = "as-error"',
                "machine": 'functions = ["EXX", "EYY", "EZZ", "EYX", "EXZ"]',
            },
        ),
        ("beckhoff", {"more": 'chain = "FXYZ"', "result": LEANING}),
        (
            "heidenhain",
            {
                "section": '[heidenhain]\ngeneration = "itnc530"\nchain = "FXYZ"',
                "result": LEANING,
            },
        ),
    ):
        tag = control + ("-lists" if "machine" in how else "-chain" if len(how) > 1 else "")
        found[f"{tag}-right"] = mistaken(control, lambda tables: tables, steps=FINE, **how)
        found[f"{tag}-turned"] = mistaken(control, of("", scaled(-1.0)), steps=FINE, **how)
        found[f"{tag}-EXX-doubled"] = mistaken(
            control, of("EXX", scaled(2.0)), steps=FINE, **how
        )
    _without_a_profile(found)
    _loaded(found)
    _lattices(found)
    return found


def _without_a_profile(found: dict[str, Callable[[], Any]]) -> None:
    for control in (
        "siemens",
        "heidenhain",
        "linuxcnc",
        "beckhoff",
        "mitsubishi",
        "fagor",
        "neutral",
    ):
        found[f"{control}-alone"] = lambda control=control: verified(
            PLAIN, exported_files(PLAIN, control, None, step_mm=60.0), None
        )
    found["nobody's"] = lambda: verified(
        PLAIN, [ControlFile(name="a.txt", data=b"1 2 3\n")], None
    )
    found["nothing"] = lambda: verified(PLAIN, [], None)
    found["two-controls"] = lambda: verified(
        PLAIN,
        [
            *exported_files(PLAIN, "siemens", None, step_mm=60.0),
            *exported_files(PLAIN, "fagor", None, step_mm=60.0),
        ],
        None,
    )
    found["measured-on-alone"] = lambda: verified(
        measured_on({"a": b"b"}), exported_files(PLAIN, "siemens", None, step_mm=60.0), None
    )
    found["another-machine"] = lambda: verified(
        result_of(survey={"machine": "other", "compensation": "off", "active_files": []}),
        exported_files(PLAIN, "siemens", profile_of("siemens")),
        profile_of("siemens"),
    )


def _loaded(found: dict[str, Callable[[], Any]]) -> None:
    """Judge files beside those that the control holds."""
    few = 'functions = ["EXX", "EYX"]'

    def beside(
        new: Callable[[], Sequence[ControlFile]],
        result: Callable[[dict[str, bytes]], Result],
        more: str = "",
        state: str = "off",
        **how: Any,
    ) -> Any:
        own = own_of("siemens", more, **how)
        return verified(
            result(own),
            new(),
            profile_of("siemens", more, machine=f'measured_with = "{state}"', files=own),
        )

    def made(more: str = "", machine: str = "") -> list[ControlFile]:
        return exported_files(PLAIN, "siemens", profile_of("siemens", more, machine=machine))

    for state, result in (("on", measured_on), ("off", lambda _: PLAIN)):
        found[f"beside-{state}"] = partial(
            beside, partial(made, machine=few), result, state=state
        )
        found[f"again-{state}"] = partial(
            beside,
            lambda: [ControlFile(name=n, data=d) for n, d in own_of("siemens").items()],
            result,
            state=state,
        )
        found[f"elsewhere-{state}"] = partial(
            beside, partial(made, "first_cec_table = 3"), result, state=state
        )
        found[f"products-stay-{state}"] = partial(
            beside, partial(made, machine=few), result, "products = true", state=state
        )
    shape = lambda _: result_of(shape_only=("EXX",), squareness={"C0Y": None})  # noqa: E731 - made when it is asked for
    found["shape-over-slope"] = partial(beside, partial(made, machine=few), shape)
    wide = {"X": "start_mm = -400.0\nend_mm = 400.0", "Y": "start_mm = -40.0\nend_mm = 440.0"}
    found["shrunk"] = partial(beside, made, lambda _: PLAIN, axis=wide)


def _lattices(found: dict[str, Callable[[], Any]]) -> None:
    held = lattice.lattice_of(LEANING, 30.0)

    def judged(
        change: Callable[[lattice.Lattice], lattice.Lattice], result: Result = LEANING
    ) -> Callable[[], Any]:
        return lambda: verified(result, [lattice.render(change(held))], None)

    found["lattice-right"] = judged(lambda each: each)
    found["lattice-unknown-angles"] = judged(lambda each: each, PLAIN)
    found["lattice-expected-angles"] = judged(lambda each: each, expecting())
    for factor in (-1.0, 0.0, 0.5, 2.0, -3.0, 25.4):
        found[f"lattice-times-{factor:g}"] = judged(
            lambda each, factor=factor: replace(each, vectors_um=each.vectors_um * factor)
        )
    found["lattice-turned-axes"] = judged(
        lambda each: replace(each, vectors_um=each.vectors_um[..., [1, 2, 0]])
    )
    found["lattice-shifted"] = judged(
        lambda each: replace(each, axes_mm=(each.axes_mm[0] + 200.0, *each.axes_mm[1:]))
    )
    found["lattice-mirrored"] = judged(
        lambda each: replace(each, vectors_um=each.vectors_um[::-1])
    )
    found["lattice-of-one-axis"] = judged(
        lambda each: replace(each, vectors_um=each.vectors_um * np.array([1.0, 0.0, 0.0]))
    )
    own = {
        "lattice.csv": lattice.render(
            replace(held, vectors_um=np.round(0.4 * held.vectors_um, 3))
        ).data
    }
    found["lattice-over-lattice"] = lambda: verified(
        measured_on(own),
        [lattice.render(held)],
        profile_of(
            "linuxcnc", 'way = "kinematics"', machine='measured_with = "on"', files=own
        ),
    )
    found["lattice-beside-lattice"] = lambda: verified(
        LEANING,
        [lattice.render(held)],
        profile_of("linuxcnc", 'way = "kinematics"', files=own),
    )
    rest = result_of(
        shapes={name: values for name, values in SHAPES.items() if name != "EYY"},
        squareness={"C0Y": None, "B0Z": 3.0},
        angles=ANGLES,
    )
    found["lattice-unknown"] = lambda: verified(
        rest, [lattice.render(held)], profile_of("linuxcnc", 'way = "kinematics"', files=own)
    )
