"""Rates of the proof run: ``python -m benchmarks.proofs [MACHINES]``, and the last row of
`benchmarks.honesty`.

Machines of `benchmarks.honesty` are surveyed and compensated by an export for a SINUMERIK. The
virtual control, which shares no code with the product, loads its files as they are and with each
fault put into their text, and drives a diagonal and a line again; and a diagonal alone on machines
that arrive at their targets within 1 um.
"""

import re
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.honesty import BOX, NOISE_UM, TILT_MRAD, Case, drive, machine_of
from stepdiag.base.readings.readings import Readings, make_readings
from stepdiag.base.volume import Volume
from stepdiag.exporters.export.export import export
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.naming import is_restore
from stepdiag.exporters.files.sets import read_set
from stepdiag.exporters.profiles.file import quick_profile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.proof.judge import Proof, prove
from stepdiag.exporters.tables.tables import Table
from stepdiag.solver.methods.solve import solve
from stepdiag.virtual.control.siemens import load_siemens
from stepdiag.virtual.drive.setups import Alignment
from stepdiag.virtual.physics.machine import Machine
from testkit.ordinary.arrivals import Scatter
from testkit.ordinary.measured import Conditions, simulate_pass

CASE = Case(name="a diagonal and a line", angle_urad=10.0, passes=(1, 2))
ALONE = replace(CASE, name="a diagonal alone, arrivals within 1 um", repeatability_um=1.0)
SETUPS = {CASE.name: ("ppp", "linear-x"), ALONE.name: ("ppp",)}
MACHINES, FIRST_SEED = 60, 7000
PASSES = (1, 2, 3, 4)
SIEMENS = controller_named("siemens")
VOLUME = Volume(origin_mm=BOX.origin_mm, size_mm=BOX.size_mm, increments=BOX.increments)
ACCEPTED = (
    "change-large",
    "slope-steep",
    "value-large",
    "correction-small",
    "travel-not-covered",
    "profile-assumed",
)
FACTORS = {
    "turned": ("sign-turned", -1.0),
    "not active": ("missing", 0.0),
    "half": ("scaled", 0.5),
    "twice": ("scaled", 2.0),
}
AXES = {"X": "AX1", "Y": "AX2", "Z": "AX3"}
_VALUE = re.compile(r"^\$(AA_ENC_COMP|AN_CEC)\[(\d+),(\d+)(?:,(\w+))?\]=(\S+)$", re.MULTILINE)


@dataclass(frozen=True, kw_only=True)
class Tried:
    """A state of the control: what it is called, the texts that were loaded, and the code of each
    function that is wrong."""

    name: str
    texts: Sequence[str]
    wrong: dict[str, str]


def again(case: Case, machine: Machine, seed: int) -> Readings:
    """Return the readings of a proof run: mirror and beam set up anew."""
    rng = np.random.default_rng((3, seed))
    parts, start_s = [], 0.0
    for setup in SETUPS[case.name]:
        mirror, beam = (
            tuple(TILT_MRAD * np.array([np.cos(turn), np.sin(turn)]))
            for turn in rng.uniform(0, 2 * np.pi, 2)
        )
        linear = setup.startswith("linear")
        how = Alignment(mirror_mrad=mirror, beam_mrad=(0.0, 0.0) if linear else beam)
        for number in PASSES:
            noise, scatter = (
                NOISE_UM["linear" if linear else "diagonal"],
                Scatter(arrival_um=(case.repeatability_um,) * 3),
            )
            taken = Conditions(
                noise_um=noise,
                seed=int(rng.integers(1 << 31)),
                start_s=start_s,
                scatter=scatter,
            )
            parts.append(
                (
                    setup,
                    number,
                    simulate_pass(
                        machine, BOX, setup, number, alignment=how, conditions=taken
                    ),
                )
            )
            start_s = float(parts[-1][2].time_s[-1]) + 60.0
    return make_readings(
        setup=[setup for setup, _, one in parts for _ in one.stop],
        pass_number=[number for _, number, one in parts for _ in one.stop],
        stop=np.concatenate([one.stop for *_, one in parts]),
        position_mm=np.concatenate([one.position_mm for *_, one in parts]),
        reading_mm=np.concatenate([one.reading_mm for *_, one in parts]),
    )


def states(texts: Sequence[str], tables: Sequence[Table], seed: int) -> Iterator[Tried]:
    """Yield the files as exported, and with each fault: of one table, of one kind of table, and two
    axes taken for each other."""
    rng = np.random.default_rng(seed)
    kind, pair = (
        str(rng.choice(["eec", "cec"])),
        [str(axis) for axis in rng.permutation(list("XYZ"))[:2]],
    )
    groups = {
        "one table": [tables[int(rng.integers(len(tables)))]],
        "a kind": [table for table in tables if table.kind == kind],
    }
    yield Tried(name="as exported", texts=texts, wrong={})
    for (name, some), (fault, (code, factor)) in (
        (group, item) for group in groups.items() for item in FACTORS.items()
    ):
        yield Tried(
            name=f"{name} {fault}",
            texts=[_scaled(text, some, factor) for text in texts],
            wrong={table.name: code for table in some},
        )
    names = {AXES[one]: AXES[other] for one, other in (pair, pair[::-1])}
    swapped = [
        re.sub(r"AX\d", lambda found: names.get(found[0], found[0]), text) for text in texts
    ]
    one_kind = [
        new if "AA_ENC" in new else old for new, old in zip(swapped, texts, strict=True)
    ]
    for name, changed, kinds in (
        ("measuring system of two axes", one_kind, ("eec",)),
        ("axes of all", swapped, ("eec", "cec")),
    ):
        moved = {
            table.name
            for table in tables
            if table.kind in kinds and {table.input_axis, table.output_axis} & set(pair)
        }
        yield Tried(name=name, texts=changed, wrong=dict.fromkeys(moved, "axes-swapped"))


def _scaled(text: str, tables: Sequence[Table], factor: float) -> str:
    """Return a file with the values of some tables times a factor."""
    seats = {
        ("AN_CEC", str(table.place["table"]))
        if table.kind == "cec"
        else ("AA_ENC_COMP", AXES[table.output_axis])
        for table in tables
    }

    def value(found: re.Match[str]) -> str:
        kind, index, point, axis, number = found.groups()
        if (kind, axis or index) not in seats:
            return found[0]
        return f"${kind}[{index},{point}{f',{axis}' if axis else ''}]={factor * float(number):.6f}"

    return _VALUE.sub(value, text)


def proofs(case: Case, seed: int) -> Iterator[tuple[Tried, Proof]]:
    """Yield the verdict on each state of the control of one machine."""
    machine = machine_of(case, seed)
    readings = drive(case, machine, seed)
    result = solve(readings, chain=case.chain)
    with tempfile.TemporaryDirectory() as folder:
        export(result, "siemens", None, accept=ACCEPTED, out_dir=Path(folder) / "files")
        files = [
            file
            for file in read_set(Path(folder) / "files")
            if file.name.endswith(".INI") and not is_restore(file.name)
        ]
    tables = SIEMENS.parse(
        [ControlFile(name=file.name, data=file.data) for file in files],
        quick_profile(SIEMENS, VOLUME),
    )
    for tried in states([file.data.decode("ascii") for file in files], tables, seed):
        loaded = [table for text in tried.texts for table in load_siemens(text)]
        yield (
            tried,
            prove(
                result,
                readings,
                again(case, replace(machine, compensations=loaded), seed),
                tables,
            ),
        )


def print_rates(machines: int, first: int = FIRST_SEED) -> None:
    """Print the rates of both cases."""
    for case in (CASE, ALONE):
        print(f"\n{case.name}\n")
        _print_rates(case, machines, first)


def _print_rates(case: Case, machines: int, first: int) -> None:
    """Print, for each state of the control, what the proof runs come to, and the verdicts on the
    wrong tables."""
    actions: dict[str, Counter[str]] = {}
    verdicts: dict[str, Counter[str]] = {}
    for seed in range(first, first + machines):
        for tried, proof in proofs(case, seed):
            actions.setdefault(tried.name, Counter())[proof.action] += 1
            named = verdicts.setdefault(tried.name, Counter())
            for each in proof.tables:
                true = tried.wrong.get(each.function, "right")
                if each.function in tried.wrong or not tried.wrong:
                    named[
                        "named"
                        if each.code == true
                        else "undecided"
                        if each.code is None
                        else f"taken for {each.code}"
                    ] += 1
    print(
        "| control after loading | keep | restore | undecided | verdicts on its tables "
        "|\n|---|---|---|---|---|"
    )
    for name, counted in actions.items():
        shown = ", ".join(f"{what} {count}" for what, count in verdicts[name].most_common())
        print(
            f"| {name} | {counted['keep']} | {counted['restore']} | {counted['undecided']} | "
            f"{shown} |"
        )


if __name__ == "__main__":
    print_rates(int(sys.argv[1]) if len(sys.argv) > 1 else MACHINES)
