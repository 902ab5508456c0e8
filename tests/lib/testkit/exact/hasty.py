"""A hasty engineer at a machine with a SINUMERIK: what is measured, stated, exported, loaded and
read back, and what the machine errs by.

The control is `testkit.exact.sinumerik`; what its variables do to an axis is computed here from the
manual's words alone (a positive value moves the axis in -, linear between points, end values held),
so that no sign of the product can cancel itself.
"""

import itertools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import date
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from stepdiag.base.compensation import Statement, stated
from stepdiag.base.errors import StepdiagError
from stepdiag.base.names import BODY_DIAGONALS, LINEAR_RUNS
from stepdiag.base.readings.readings import Readings, make_readings
from stepdiag.base.readings.runs import Plan, Run
from stepdiag.base.result.members import Facts
from stepdiag.base.result.result import Result
from stepdiag.exporters.export.export import export
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.sets import read_set
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.proof.judge import prove
from stepdiag.exporters.proof.plan import plan_proof
from stepdiag.exporters.safety.read_back import compare
from stepdiag.exporters.safety.verify import acting_in, verify_files
from stepdiag.exporters.tables.curves import FUNCTIONS
from stepdiag.exporters.tables.profile import Profile
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME, made_result
from testkit.exact.sinumerik import Sinumerik

Values = NDArray[np.float64]
SIEMENS = controller_named("siemens")
AXES = {"X": "AX1", "Y": "AX2", "Z": "AX3"}
MACHINE_DATA = {
    "$MN_SCALING_SYSTEM_IS_METRIC": "1",
    "$MA_CEC_SCALING_SYSTEM_METRIC": "1",
    "$MA_MM_ENC_COMP_MAX_POINTS": "30",
    "$MN_MM_CEC_MAX_POINTS": "30",
    "$MA_CEC_MAX_SUM": "1",
}
SQUARE = {
    "C0Y": ("EXY", "EYX", -1.0),
    "B0Z": ("EXZ", "EZX", 1.0),
    "A0Z": ("EYZ", "EZY", -1.0),
}
"""By contract 1: the function that holds a squareness, the other one of the pair, and the sign of
their slopes."""
STEPS, MINUTES = 10, 10.0
"""Increments of the diagonals and lines, and the minutes of a proof run."""
SETUPS = (*BODY_DIAGONALS, *LINEAR_RUNS)
DRIVEN = Plan(
    volume=replace(VOLUME, increments=STEPS), runs=tuple(Run(setup=name) for name in SETUPS)
)
DONE = ("whole", "twice", "half", "another machine", "old files again", "a switch forgotten")
_NUMBER = re.compile(r"^(\$(?:AA_ENC_COMP|AN_CEC)\[[^\]]*\]=)(-?\d+\.?\d*)$", re.MULTILINE)


def _scaled(text: str, factor: float) -> str:
    return _NUMBER.sub(lambda found: f"{found[1]}{factor * float(found[2]):.4f}", text)


EDITED: Mapping[str, Callable[[str], str]] = {
    "second system": lambda text: re.sub(r"(ENC_COMP\w*\[)0,", r"\g<1>1,", text),
    "other numbers": lambda text: re.sub(
        r"(\$(?:AN|SN)_CEC\w*\[)(\d+)", lambda found: f"{found[1]}{int(found[2]) + 6}", text
    ),
    "exchanged axes": lambda text: (
        text.replace("AX1", "AX9").replace("AX2", "AX1").replace("AX9", "AX2")
    ),
    "a tenth": lambda text: _scaled(text, 0.1),
    "inches": lambda text: _scaled(text, 25.4),
}
"""What a hasty person makes of the loading programs before they are run."""
HELD = {
    "half weights": ("$SN_CEC_TABLE_WEIGHT[", "0.5"),
    "no weight": ("$SN_CEC_TABLE_WEIGHT[3]", "0"),
    "CEC off": ("$SN_CEC_TABLE_ENABLE[", "0"),
    "an axis off": ("$MA_CEC_ENABLE[AX2]", "0"),
    "a screw off": ("$MA_ENC_COMP_ENABLE[0,AX3]", "0"),
    "another start": ("$AA_ENC_COMP_MIN[0,AX1]", "-150.0"),
}
"""What is set in the control by hand after loading."""
LISTED: Mapping[str, Callable[[ControlFile], ControlFile | None]] = {
    "EEC alone": lambda file: file if "EEC" in file.name else None,
    "CEC alone": lambda file: file if "CEC" in file.name else None,
    "nothing": lambda file: None,
    "inches": lambda file: replace(file, data=_scaled(file.data.decode(), 1 / 25.4).encode()),
    "sign turned": lambda file: replace(
        file, data=_scaled(file.data.decode(), -1.0).encode()
    ),
    "micrometres": lambda file: replace(
        file, data=_scaled(file.data.decode(), 1000.0).encode()
    ),
}
"""What stands in ``machine.existing`` in place of the files that are in the control."""
READ_OUT = "read out"
"""There stands what the control held while it was measured, with its switches."""
NEEDED = "proof run needed"
"""End of a story whose read-back is right, and whose survey does not show which tables acted."""
ACCEPTED = (
    "change-large",
    "slope-steep",
    "value-large",
    "correction-small",
    "travel-not-covered",
)
"""What a hasty person accepts unread; nothing that asks about the compensation."""


@dataclass(frozen=True, kw_only=True)
class Story:
    """What stood in the control, which of it was on while measuring, what was stated of it, and
    what was done afterwards.

    ``size`` of the old tables against right ones, 0 for one drawn from 0.7 to 1.4; ``ready`` is
    what was switched on before loading; ``home_mm`` is how far the axes were referenced elsewhere
    after it.
    """

    old: bool
    on: str = "none"
    stated: str = "off"
    done: str = "whole"
    listed: str = "all"
    size: float = 0.0
    ready: str = "all"
    home_mm: float = 0.0

    @property
    def right(self) -> bool:
        """Return whether the statement is true, and the whole export is loaded as it is."""
        if self.listed == READ_OUT:
            return self.stated == "on" and self.ready == self.on and not self.size
        true = self.on == ("none" if self.stated == "off" else "all")
        loaded = self.done in ("whole", "twice") and self.listed == "all" and not self.home_mm
        return true and loaded and self.ready in (self.on, "all") and not self.size

    def __str__(self) -> str:
        words = {
            "old tables": self.old and (self.size or "drawn"),
            "on": self.on,
            "stated": self.stated,
            "ready": self.ready,
            "loading": self.done,
            "listed": self.listed,
            "home": self.home_mm,
        }
        return ", ".join(f"{name} {value}" for name, value in words.items())


@dataclass
class Hall:
    """A drawn machine with its control; errors in um at the nodes of the survey, slopes of the
    straightnesses within."""

    seed: int
    home_mm: float = 0.0
    control: Sinumerik = field(default_factory=lambda: Sinumerik(machine=MACHINE_DATA))
    truth: dict[str, Values] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.dice, along = np.random.default_rng((71, self.seed)), np.linspace(0.0, 1.0, 5)
        for name in FUNCTIONS:
            bow = 6.0 * self.dice.normal() * np.sin(
                np.pi * along
            ) + 3.0 * self.dice.normal() * np.sin(2.0 * np.pi * along)
            lean = (
                8.0 * self.dice.normal()
                if name[1] == name[2] or name in {held for held, _, _ in SQUARE.values()}
                else 0.0
            )
            self.truth[name] = bow + lean * along

    def added_um(self, name: str, at: Values | None = None) -> Values:
        """Return what the control adds at positions (the nodes where none are given), from its
        variables and switches."""
        at = (VOLUME.nodes_mm("XYZ".index(name[2])) if at is None else at) + self.home_mm
        held, added = self.control.held, np.zeros(at.shape)
        if name[1] == name[2] and held.get(f"$MA_ENC_COMP_ENABLE[0,{AXES[name[1]]}]") == "1":
            added = added - self._table(
                "$AA_ENC_COMP[0,{}," + AXES[name[1]] + "]",
                f"$AA_ENC_COMP_{{}}[0,{AXES[name[1]]}]",
                at,
            )
        if held.get(f"$MA_CEC_ENABLE[{AXES[name[1]]}]") == "1":
            for index in range(12):
                of = tuple(
                    held.get(f"$AN_CEC_{what}_AXIS[{index}]", "").strip("()")
                    for what in ("INPUT", "OUTPUT")
                )
                if (
                    of == (AXES[name[2]], AXES[name[1]])
                    and held.get(f"$SN_CEC_TABLE_ENABLE[{index}]") == "1"
                ):
                    weight = float(held.get(f"$SN_CEC_TABLE_WEIGHT[{index}]", "0"))
                    added = added - weight * self._table(
                        f"$AN_CEC[{index},{{}}]", f"$AN_CEC_{{}}[{index}]", at
                    )
        return added

    def _table(self, value: str, grid: str, at: Values) -> Values:
        low, high, step = (
            float(self.control.held.get(grid.format(name), "0"))
            for name in ("MIN", "MAX", "STEP")
        )
        if step <= 0.0:
            return 0.0 * at
        points = low + step * np.arange(round((high - low) / step) + 1)
        return np.interp(
            at,
            points,
            [
                1000.0 * float(self.control.held.get(value.format(n), "0"))
                for n in range(len(points))
            ],
        )

    def errs_um(self) -> float:
        """Return the rms of all functions, each about its mean; of two functions of a pair the
        common slope counts, no turn."""
        left = {name: self.truth[name] + self.added_um(name) for name in FUNCTIONS}
        for held, other, _ in SQUARE.values():
            slopes = {
                name: (left[name][-1] - left[name][0])
                / np.ptp(VOLUME.nodes_mm("XYZ".index(name[2])))
                for name in (held, other)
            }
            for name, turn in ((held, slopes[other]), (other, -slopes[other])):
                at = VOLUME.nodes_mm("XYZ".index(name[2]))
                left[name] = left[name] + turn * (at - at[0])
        return float(np.sqrt(np.mean([np.var(values) for values in left.values()])))

    def survey(self) -> Result:
        """Return what a survey finds, with 0.3 um of noise."""
        shapes, slopes = {}, {}
        for name, error in self.truth.items():
            found = error + self.added_um(name) + 0.3 * self.dice.normal(size=5)
            found = found - found[0]
            at = VOLUME.nodes_mm("XYZ".index(name[2]))
            slopes[name] = found[-1] / np.ptp(at) if name[1] != name[2] else 0.0
            shapes[name] = list(found - slopes[name] * (at - at[0]))
        square = {
            name: sign * 1000.0 * (slopes[one] + slopes[other])
            for name, (one, other, sign) in SQUARE.items()
        }
        return made_result(shapes, squareness=square, u_um=0.3)

    def readings(self, setups: Sequence[str] = SETUPS, repeats: int = 2) -> Readings:
        """Return what a laser reads along diagonals and lines, out and back, with 0.3 um of noise;
        the mirror leans anew each time."""
        rows, size = [], np.array(VOLUME.size_mm)
        for setup in setups:
            step = not setup.startswith("linear")
            nodes = np.arange(3 * STEPS + 1 if step else STEPS + 1)
            counts = [
                (nodes + 2 - axis) // 3 if step else nodes * (setup[-1] == "xyz"[axis])
                for axis in range(3)
            ]
            counts = [
                STEPS - count if step and setup[axis] == "n" else count
                for axis, count in enumerate(counts)
            ]
            out = np.array(VOLUME.origin_mm) + np.column_stack(counts) * size / STEPS
            along = (out[-1] - out[0]) / np.linalg.norm(out[-1] - out[0])
            lean = 5e-4 * self.dice.normal(size=3) * step
            error = np.zeros(out.shape)
            for name, truth in self.truth.items():
                axis = "XYZ".index(name[2])
                held = np.interp(out[:, axis], VOLUME.nodes_mm(axis), truth) + self.added_um(
                    name, out[:, axis]
                )
                error[:, "XYZ".index(name[1])] += held
            mean = out @ (along + lean - (lean @ along) * along) + 1e-3 * (error @ along)
            for number in range(1, 2 * repeats + 1):
                order = slice(None) if number % 2 else slice(None, None, -1)
                read = (mean + 3e-4 * self.dice.normal(size=len(out)))[order]
                rows += [
                    (setup, number, stop, at, one - read[0])
                    for stop, (at, one) in enumerate(zip(out[order], read, strict=True))
                ]
        setups, numbers, stops, places, values = zip(*rows, strict=True)
        return make_readings(
            setup=setups,
            pass_number=numbers,
            stop=stops,
            position_mm=np.array(places),
            reading_mm=values,
        )

    def switch(self, on: str) -> None:
        """Switch kinds of table: "all", "eec", "cec", "none"."""
        for name in list(self.control.held):
            for kind, marks in (
                ("eec", ("$MA_ENC_COMP_ENABLE",)),
                ("cec", ("$MA_CEC_ENABLE", "$SN_CEC_TABLE_ENABLE")),
            ):
                if name.startswith(marks):
                    self.control.held[name] = "1" if on in ("all", kind) else "0"


def stories() -> Iterator[Story]:
    """Yield everything that a hasty person did: 63 sequences, and 43 of tables of another size,
    switched over before loading, stated by what was read out, and of axes referenced elsewhere."""
    for done, old in itertools.product((*EDITED, *HELD), (False, True)):
        yield Story(
            old=old, on="all" if old else "none", stated="on" if old else "off", done=done
        )
    for listed in LISTED:
        yield Story(
            old=True, on="all", stated="off" if listed == "nothing" else "on", listed=listed
        )
    yield Story(old=True, on="none", stated="off", listed="nothing")
    for done in DONE:
        yield Story(old=False, done=done)
        for on, said in itertools.product(("none", "all", "eec", "cec"), ("off", "on")):
            if done == "whole" or said == ("on" if on == "all" else "off"):
                yield Story(old=True, on=on, stated=said, done=done)
    for size, on, said, ready in itertools.product(
        (0.5, 2.0), ("none", "all", "eec", "cec"), ("off", "on"), ("none", "all")
    ):
        yield Story(old=True, on=on, stated=said, size=size, ready=ready)
    for on, ready in itertools.product(("all", "eec", "cec"), repeat=2):
        yield Story(old=True, on=on, stated="on", listed=READ_OUT, ready=ready)
    for old in (False, True):
        yield Story(
            old=old, on="all" if old else "none", stated="on" if old else "off", home_mm=40.0
        )


def lived(
    story: Story, seed: int, folder: Path, *, proof: bool = False
) -> tuple[str, float, float]:
    """Return what stopped a story ("" where nothing did, with exit code 0 to its end), and the true
    rms before and after in um.

    Its last step is to read back what the control holds, or a ``proof`` run in its place.
    """
    hall, base = Hall(seed), profile_of("siemens", VOLUME)
    archive: tuple[ControlFile, ...] = ()
    if story.old:
        archive = _exported(hall.survey(), base, folder / "old")
        size = float(np.exp(hall.dice.uniform(np.log(0.7), np.log(1.4))))
        _load(hall, archive)
        size = 1.0 / story.size if story.size else size
        hall.truth = {name: size * error for name, error in hall.truth.items()}
        hall.switch("all")
    before = _as_it_was(hall, story.home_mm)
    hall.switch(story.on)
    along = hall.readings() if proof else None
    measured, data = (
        hall.survey(),
        tuple(
            file
            for file in archive
            if file.name.endswith(".INI") and "RESTORE" not in file.name
        ),
    )
    if story.listed == READ_OUT:
        data = (_read_out(hall, archive),)
    hall.switch(story.ready)
    data = tuple(
        file
        for each in data
        if (file := LISTED.get(story.listed, lambda file: file)(each)) is not None
    )
    profile = replace(
        base,
        existing=data,
        machine=msgspec.structs.replace(base.machine, measured_with=story.stated),
    )
    said = (
        stated("on", {file.name: file.data for file in data}, date(2026, 6, 1), "archive")
        if story.stated == "on"
        else Statement(state="off")
    )
    measured = replace(measured, survey=said.facts(Facts(machine="test machine")))
    try:
        files = _exported(measured, profile, folder / "new")
    except StepdiagError as error:
        return f"export: {getattr(error, 'code', 'refused')}", before, before
    if story.done == "another machine":
        files = _exported(Hall(seed + 1000).survey(), base, folder / "other")
    tables = [
        file for file in files if file.name.endswith(".INI") and "RESTORE" not in file.name
    ]
    judged = verify_files(measured, tables, profile)
    if not judged.right:
        return "verify", before, before
    edit = EDITED.get(story.done, str)
    edited = tuple(replace(file, data=edit(file.data.decode()).encode()) for file in files)
    _load(
        hall,
        archive if story.done == "old files again" and archive else edited,
        half=story.done == "half",
    )
    if hall.control.refused:
        return "loading", before, hall.errs_um()
    if story.done == "twice":
        _load(hall, files)
    mark, value = HELD.get(
        story.done,
        ("$SN_CEC_TABLE_ENABLE[2]" if story.done == "a switch forgotten" else "none", "0"),
    )
    hall.control.held |= {name: value for name in hall.control.held if name.startswith(mark)}
    hall.home_mm = story.home_mm
    if along is not None:
        acting, replaced = acting_in(measured, SIEMENS, tables, profile)
        ahead = plan_proof(measured, along, DRIVEN, acting, MINUTES)
        found = prove(
            measured, along, hall.readings(ahead.setups, ahead.repeats), acting, replaced
        )
        if found.action == "undecided" and found.further:
            found = prove(
                measured,
                along,
                hall.readings((*ahead.setups, *found.further), ahead.repeats),
                acting,
                replaced,
            )
        return (
            "" if found.action == "keep" else f"proof run: {found.action}",
            before,
            hall.errs_um(),
        )
    if compare(SIEMENS, tables, [_read_out(hall, files)], profile).findings:
        return "read back", before, hall.errs_um()
    if judged.verdict == "undecided":
        return NEEDED, before, hall.errs_um()
    return "", before, hall.errs_um()


def _as_it_was(hall: Hall, home_mm: float) -> float:
    """Return what a machine errs by with its old tables, its axes referenced as after loading."""
    hall.home_mm, measured = home_mm, hall.home_mm
    found = hall.errs_um()
    hall.home_mm = measured
    return found


def _read_out(hall: Hall, files: Sequence[ControlFile]) -> ControlFile:
    """Return what the control writes out by the program of an export."""
    (reader,) = (file for file in files if file.name == "READ_BACK.MPF")
    hall.control.run(reader.data.decode("ascii"))
    return ControlFile(name="STEPDIAG_BACK.INI", data=hall.control.read_out().encode("ascii"))


def _exported(result: Result, profile: Profile, folder: Path) -> tuple[ControlFile, ...]:
    export(result, "siemens", profile, accept=ACCEPTED, out_dir=folder)
    return read_set(folder)


def _load(hall: Hall, files: tuple[ControlFile, ...], *, half: bool = False) -> None:
    """Run the loading programs; ``half`` leaves the second one in its middle."""
    programs = [
        file for file in files if file.name.startswith("LOAD") and "RESTORE" not in file.name
    ]
    for number, file in enumerate(sorted(programs, key=lambda file: file.name, reverse=True)):
        text = file.data.decode("ascii")
        hall.control.stop_after = (
            len(text.splitlines()) // 2 if half and number == 0 else None
        )
        hall.control.run(text)
        hall.control.stop_after = None
