"""The demo: a survey of a virtual machine is recorded, solved and exported. The exported files are
loaded into the virtual machine, which is then verified at unmeasured points."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.messages import Message, message
from stepdiag.base.result.field import without_rigid_motion
from stepdiag.base.result.interval import Interval
from stepdiag.base.result.result import Result, result_in
from stepdiag.base.volume import Vector, Volume, anywhere_mm
from stepdiag.conclusion.intervals import reach_in
from stepdiag.demo.files import (
    INCREMENTS,
    PASSES,
    SETUPS,
    SIZE_MM,
    write_angles,
    write_bench,
    write_profiles,
    write_survey,
)
from stepdiag.demo.operator import Operator, daemon, words
from stepdiag.demo.operator import bench as running
from stepdiag.demo.processes import Talker
from stepdiag.demo.reach import WHOLE_FIELD, exported
from stepdiag.virtual.bench.building import build_machine
from stepdiag.virtual.bench.config import CompensationPart, read_config
from stepdiag.virtual.control.compensation import Control

LINE_POINTS = 21

Progress = Callable[[Message, int, int], None]
"""A function with three arguments: the present work, the number of captured stops, and the final
number of stops."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """Errors of the tool over the volume (um, rigid motion removed) and along a face diagonal.

    ``face_diagonal_um`` is the largest range of the deviation along one of six face diagonals.
    """

    rms_um: float
    largest_um: float
    face_diagonal_um: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Promise:
    """The interval (k = 2) of a result for the rms error of the volume, and the true error of the
    virtual machine."""

    of: Message
    stated: Interval
    true_um: float

    @property
    def kept(self) -> bool:
        """Whether an interval exists and contains the true error."""
        low_um, high_um = self.stated.low_um, self.stated.high_um
        return (
            low_um is not None and high_um is not None and low_um <= self.true_um <= high_um
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Demonstrated:
    """Results of the demo: the machine as found, and with the files of each control; ``seconds`` is
    the duration of the survey.

    ``after`` contains the errors with the files that the daemon exported, ``reach`` those with
    other forms of compensation. ``promises`` contains the intervals of the result beside the true
    errors.
    """

    folder: Path
    round: Path
    before: Figures
    after: dict[str, Figures]
    reach: dict[str, Figures]
    promises: tuple[Promise, ...]
    seconds: float

    def factor(self, control: str) -> float:
        """Return the factor by which the files of a control reduce the volumetric error (rms)."""
        return self.before.rms_um / {**self.after, **self.reach}[control].rms_um


def demonstrate(folder: Path, seed: int, progress: Progress) -> Demonstrated:
    """Run the demo in an empty folder and return its results; all its files stay.

    Raises UsageError for a folder with files, DeviceError or DataError for a failed process.
    """
    empty_folder(folder)
    began = time.monotonic()
    bench = write_bench(folder, seed)
    write_angles(folder, bench, seed)
    write_profiles(folder)
    with running(bench, folder) as hall:
        survey = write_survey(folder, hall.ready["plc_port"], hall.ready["laser_link"])
        with daemon(survey) as recording:
            round_folder = _survey(hall, survey, recording, progress)
    seconds = time.monotonic() - began
    progress(message("demo-verifying"), 1, 1)
    before = verify(bench, None, ())
    after = {
        control: verify(bench, control, _files(round_folder, control))
        for control in ("siemens", "fanuc")
    }
    result = result_in(round_folder / "result.json")
    reach = {
        str(form.name): verify(bench, form.control, files)
        for form, files in exported(folder / "reach", result)
    }
    promises = promises_of(result, before.rms_um, reach[str(WHOLE_FIELD)].rms_um)
    return Demonstrated(
        folder=folder,
        round=round_folder,
        before=before,
        after=after,
        reach=reach,
        promises=promises,
        seconds=seconds,
    )


def promises_of(result: Result, before_um: float, whole_um: float) -> tuple[Promise, ...]:
    """Return the intervals of a result beside the true rms errors in um: for the machine as found,
    and with all known errors corrected."""
    reach = reach_in(result)
    found = (
        (message("as-it-is"), reach.rms_before, before_um),
        (WHOLE_FIELD, reach.rms_after, whole_um),
    )
    return tuple(
        Promise(of=of, stated=stated, true_um=true_um)
        for of, stated, true_um in found
        if stated is not None
    )


def empty_folder(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    if any(folder.iterdir()):
        remedy = message("name-with-out")
        raise UsageError(
            str(folder),
            expected=message("folder-without-files"),
            found=message("folder-with-files"),
            remedy=remedy,
        )


def verify(bench: Path, control: Control | None, files: Sequence[Path]) -> Figures:
    """Return the true errors of the virtual machine after its control has loaded these compensation
    files (None: no files)."""
    config = read_config(bench)
    if control is not None:
        loaded = CompensationPart(control=control, files=tuple(str(file) for file in files))
        config = msgspec.structs.replace(config, compensation=(loaded,))
    machine = build_machine(config)
    volume = Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=SIZE_MM, increments=INCREMENTS)
    points = anywhere_mm(volume)
    left = without_rigid_motion(volume, points, machine.error_at(points))
    length = np.linalg.norm(left, axis=1)
    widest = max(_diagonal_range_um(machine.error_at, *ends) for ends in _face_diagonals())
    return Figures(
        rms_um=float(np.sqrt(np.mean(length**2))),
        largest_um=float(length.max()),
        face_diagonal_um=widest,
    )


def _diagonal_range_um(
    error_at: Callable[[Vector], Vector], start: Vector, end: Vector
) -> float:
    """Return the range of the deviation along a line between two points, as measured by a laser
    with a retroreflector."""
    points = start + np.linspace(0.0, 1.0, LINE_POINTS)[:, None] * (end - start)
    along = error_at(points) @ ((end - start) / np.linalg.norm(end - start))
    return float(np.ptp(along - along[0]))


def _face_diagonals() -> Iterator[tuple[Vector, Vector]]:
    size = np.array(SIZE_MM)
    for first, second in ((0, 1), (1, 2), (2, 0)):
        a, b = np.zeros(3), np.zeros(3)
        a[first], b[second] = size[first], size[second]
        yield np.zeros(3), a + b
        yield a, b


def _files(round_folder: Path, control: str) -> list[Path]:
    folder = round_folder / "exports" / control
    refused = folder / "REFUSED.txt"
    if refused.exists():
        raise DataError(
            str(folder),
            expected=message("compensation-files"),
            found=refused.read_text(encoding="utf-8").strip(),
        )
    listed = [
        line.split("  ", 1)[1].strip()
        for line in (folder / "SHA256SUMS").read_text(encoding="utf-8").splitlines()
    ]
    return [
        folder / name
        for name in listed
        if "_RESTORE" not in name and not name.endswith((".txt", ".MPF"))
    ]


def _survey(hall: Talker, survey: Path, recording: Talker, progress: Progress) -> Path:
    total = (
        sum((3 * INCREMENTS + 1 if len(setup) == 3 else INCREMENTS + 1) for setup in SETUPS)
        * PASSES
    )
    seen: set[tuple[str, str, str]] = set()
    for event in words(Operator(hall, survey), recording):
        if event["event"] == "stop":
            seen.add((event["setup"], event["outward"], event["stop"]))
            progress(
                message(
                    "demo-out" if event["outward"] else "demo-back", setup=event["setup"]
                ),
                len(seen),
                total,
            )
        elif event["event"] == "survey-open" and "exit_code" in event:
            raise DataError(
                event["folder"], expected=message("solvable-survey"), found=event["reason"]
            )
        elif event["event"] == "survey-complete":
            return Path(event["folder"])
        elif event["event"] == "pass-ended" and len(seen) >= total:
            progress(message("demo-solving"), len(seen), total)
    raise AssertionError("the daemon's words have no end")
