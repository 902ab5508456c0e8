"""How often is a right table refused, and a wrong one taken for right? `benchmarks.wrong_tables`
prints the rates.

Machines are drawn with errors of their own and surveyed twice, with noise: tables are made from the
first survey and judged by the second. Every table of every machine is then spoiled in each of the
ways in which tables are wrong in practice, one at a time, and judged again. A mutant that leaves
less than half of the error is no wrong table and does not count: a bow shifted by one point is
nearly itself. Tables of products are counted by machines of their own, whose axes turn.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import msgspec
import numpy as np

from stepdiag.base.result.result import ROTATIONS, Function, Quantity, Result, Scale
from stepdiag.base.volume import Vector, Volume, rms
from stepdiag.exporters.profiles.file import quick_profile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.safety.standing import Standing
from stepdiag.exporters.safety.verdicts.judge import judge, judge_missing
from stepdiag.exporters.siemens.control import SiemensOptions
from stepdiag.exporters.tables.curves import FUNCTIONS
from stepdiag.exporters.tables.fit import fitted
from stepdiag.exporters.tables.tables import Multiplier, Table, summed_um

VOLUME = Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=(500.0, 400.0, 300.0), increments=10)
NOISE_UM, NOISE_URAD = 0.3, 1.0
SIZE_UM, LEAN_URAD, TURN_URAD = 6.0, 12.0, 20.0
MACHINES = 200
CONTROL = controller_named("siemens")
PROFILE = quick_profile(CONTROL, VOLUME)
OPTIONS = msgspec.structs.replace(PROFILE.options_as(SiemensOptions), products=True)
MULTIPLYING = replace(PROFILE, options=OPTIONS)
Change = Callable[[Table, Sequence[Table]], Table]


def _other(table: Table, tables: Sequence[Table]) -> Table:
    """Return the table of the next function in the place of this one, stretched over its travel."""
    own = [each.name for each in tables].index(table.name)
    other = tables[(own + 1) % len(tables)]
    along = [np.linspace(0.0, 1.0, len(each.value_um)) for each in (table, other)]
    return replace(table, value_um=np.interp(along[0], along[1], other.value_um))


MUTANTS: dict[str, Change] = {
    "turned": lambda table, _: replace(table, value_um=-table.value_um),
    "swapped": _other,
    "scaled by 10": lambda table, _: replace(table, value_um=10.0 * table.value_um),
    "scaled by 0.4": lambda table, _: replace(table, value_um=0.4 * table.value_um),
    "doubled": lambda table, _: replace(table, value_um=2.0 * table.value_um),
    "shifted by one point": lambda table, _: replace(
        table, position_mm=table.position_mm + table.position_mm[1] - table.position_mm[0]
    ),
    "wrong reference": lambda table, _: replace(
        table, position_mm=table.position_mm + 0.37 * np.ptp(table.position_mm)
    ),
    "zeros": lambda table, _: replace(table, value_um=0.0 * table.value_um),
    "lever turned": lambda table, _: replace(table, multiplier=_turned(table.multiplier)),
}


def _turned(lever: Multiplier | None) -> Multiplier | None:
    """Return a multiplier that rises where it falls; None for a curve."""
    return None if lever is None else replace(lever, value=lever.value[::-1])


@dataclass(kw_only=True)
class Counted:
    """How many were tried, how many of them were taken for right, and how many were named by their
    cause."""

    tried: int = 0
    passed: int = 0
    codes: dict[str, int] = field(default_factory=dict)


def surveys(seed: int, *, turning: bool = False) -> tuple[Result, Result]:
    """Return two surveys of one drawn machine; the axes of a ``turning`` machine have angles."""
    dice, along = (
        np.random.default_rng((42, seed)),
        np.linspace(0.0, 1.0, VOLUME.increments + 1),
    )
    truth = {
        name: np.zeros(along.shape)
        + SIZE_UM * sum(dice.normal() / k * np.sin(np.pi * k * along) for k in (1, 2, 3, 4))
        + (2.0 * SIZE_UM * dice.normal() * along if name[1] == name[2] else 0.0)
        for name in FUNCTIONS
    }
    leans = {name: LEAN_URAD * dice.normal() for name in ("C0Y", "B0Z", "A0Z")}
    turns = {
        name: TURN_URAD
        * sum(dice.normal() / k * np.sin(np.pi * k * along) for k in (0.5, 1, 2))
        for name in (ROTATIONS if turning else ())
    }

    def survey() -> Result:
        return Result(
            volume=VOLUME,
            chain="FXYZ",
            method="drawn",
            setups={},
            findings=(),
            errors={
                **{name: _function(name, values, dice) for name, values in truth.items()},
                **{name: _angle(name, values, dice) for name, values in turns.items()},
            },
            squareness={
                name: Quantity(value=urad + NOISE_URAD * dice.normal(), u=NOISE_URAD)
                for name, urad in leans.items()
            },
            scale={axis: Scale(value=None, u=None, identified=False) for axis in "XYZ"},
        )

    return survey(), survey()


def _function(name: str, values: Vector, dice: np.random.Generator) -> Function:
    noisy = values + NOISE_UM * dice.normal(size=values.shape)
    along = np.linspace(0.0, 1.0, len(noisy))
    noisy = noisy - noisy[0] - (along * (noisy[-1] - noisy[0]) if name[1] != name[2] else 0.0)
    return Function(
        position_mm=VOLUME.nodes_mm("XYZ".index(name[2])),
        value=noisy,
        u=np.full(noisy.shape, NOISE_UM),
        unit="um",
    )


def _angle(name: str, values: Vector, dice: np.random.Generator) -> Function:
    noisy = values + NOISE_URAD * dice.normal(size=values.shape)
    return Function(
        position_mm=VOLUME.nodes_mm("XYZ".index(name[2])),
        value=noisy - noisy[0],
        u=np.full(noisy.shape, NOISE_URAD),
        unit="urad",
    )


def judged(result: Result, tables: Sequence[Table]) -> dict[str, str]:
    """Return the verdict on every function."""
    found = judge(result, tables, Standing(after=tuple(tables), new=tuple(tables)), PROFILE)
    return {
        each.function: each.code
        for each in (*found, *judge_missing(result, CONTROL, tables, PROFILE))
    }


def mutants(
    result: Result, tables: Sequence[Table]
) -> Iterator[tuple[str, str, list[Table]]]:
    """Yield kind, function, and the set of tables with one that is wrong: a product where there
    are products, else a curve.
    """
    fit = fitted(result)
    parts = [(each.name, each.position_mm, each.mean_um) for each in fit.curves]
    if any(table.multiplier for table in tables):
        parts = [(each.name, each.position_mm, each.value_um) for each in fit.products]
    errors = {name: (at, um) for name, at, um in parts}
    alike = [table for table in tables if table.name in errors]
    for table in alike:
        at, error = errors[table.name]
        others = [each for each in tables if each is not table]
        for kind, change in MUTANTS.items():
            wrong = change(table, alike)
            lever = table.multiplier is not wrong.multiplier
            left = error + summed_um([wrong], at) * (-1.0 if lever else 1.0)
            if rms(left - np.mean(left)) > 0.5 * rms(error - np.mean(error)) > 0.5:
                yield kind, table.name, [*others, wrong]
        if table.multiplier is None and rms(error - np.mean(error)) > 1.0:
            yield "missing", table.name, others


def counted(
    machines: int, first: int = 0, *, turning: bool = False
) -> tuple[int, dict[str, Counted]]:
    """Return how many machines had a right table refused, and what became of every kind of mutant:
    of the products of ``turning`` machines, or of the curves of others."""
    refused, found = 0, {kind: Counted() for kind in (*MUTANTS, "missing")}
    for seed in range(first, first + machines):
        made_from, by = surveys(seed, turning=turning)
        fit = fitted(made_from)
        tables = CONTROL.plan_products(
            fit.curves, fit.products, MULTIPLYING if turning else PROFILE
        ).tables
        refused += any(code not in ("right", "empty") for code in judged(by, tables).values())
        for kind, name, wrong in mutants(by, tables):
            code = judged(by, wrong).get(name, "missing")
            one = found[kind]
            one.tried += 1
            one.passed += code in ("right", "empty", "kept", "unidentified")
            one.codes[code] = one.codes.get(code, 0) + 1
    return refused, found


def print_rates(machines: int) -> None:
    """Print the rates of curves, then of products."""
    for turning in (False, True):
        refused, found = counted(machines, turning=turning)
        print("products:" if turning else "curves:")
        print(f"right tables: {refused} of {machines} machines refused")
        for kind, one in found.items():
            codes = ", ".join(
                f"{code} {count}"
                for code, count in sorted(one.codes.items(), key=lambda each: -each[1])
            )
            print(f"{kind:22} {one.passed:5} of {one.tried:5} taken for right; {codes}")
