"""Runs measured by other programs: ``--run`` of solve, ``--diagonal`` of verify, tables of
``import``, and ``stepdiag rtl``."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import typer

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.messages import message
from stepdiag.terminal.viewer import print_words

if TYPE_CHECKING:
    from stepdiag.base.readings.readings import Readings
    from stepdiag.base.result.result import Result


class Compared(NamedTuple):
    """A straight diagonal: its name, its targets, and the mean error along it, predicted and
    measured, in um."""

    diagonal: str
    target_mm: list[float]
    predicted_um: list[float]
    measured_um: list[float]

    @property
    def largest_um(self) -> float:
        return max(
            abs(a - b) for a, b in zip(self.predicted_um, self.measured_um, strict=True)
        )


def register(app: typer.Typer) -> None:
    app.command("rtl")(rtl)


def rtl(
    readings: Path,
    out: Path = Path(),
    machine: str = "",
) -> None:
    """Write linear runs as Renishaw .rtl files."""
    from stepdiag.base.files import read_text, refuse_file_name, write_together
    from stepdiag.base.names import LINEAR_RUNS
    from stepdiag.base.readings.readings import parse_readings
    from stepdiag.base.readings.rtl import render_rtl

    taken = parse_readings(read_text(readings), readings.name)
    setups = [setup for setup in LINEAR_RUNS if setup in taken.setup]
    if not setups:
        raise DataError(
            str(readings),
            expected=message("linear-runs"),
            found=", ".join(sorted(set(taken.setup))),
        )
    texts = {"Machine": machine} if machine else {}
    refuse_file_name(out)
    rendered = {
        out / f"{setup}.rtl": render_rtl(taken, setup, texts).encode("utf-8")
        for setup in setups
    }
    write_together(rendered, over=False)
    for path in rendered:
        typer.echo(str(path))


def with_files(readings: "Readings", runs: Sequence[str], source: str) -> "Readings":
    """Return readings with the runs of these files added. Raises DataError or UsageError for a
    wrong file or a file without a setup."""
    from stepdiag.base.files import read_text
    from stepdiag.base.readings.rtl import parse_rtl, rtl_readings, with_runs

    found = []
    for option in runs:
        setup, path, at_mm = _placed(option)
        rows, name = rtl_readings(
            parse_rtl(read_text(path), path.name),
            setup,
            at_mm or readings.position_mm.min(axis=0),
            path.name,
        )
        found.append((name, rows))
    return with_runs(readings, found, source)


def files_of(runs: Sequence[str]) -> list[Path]:
    """Return the files of the runs. Raises UsageError for a run in the wrong form."""
    return [_placed(option)[1] for option in runs]


def compared(result: "Result", diagonals: Sequence[str]) -> list[Compared]:
    """Return the predicted and the measured error for each straight diagonal: the mean of its runs,
    less the value at the first target."""
    import numpy as np

    from stepdiag.base.files import read_text
    from stepdiag.base.readings.rtl import parse_rtl
    from stepdiag.base.result.field import along_diagonal_um

    found = []
    for option in diagonals:
        diagonal, separator, name = option.partition("=")
        if not separator:
            raise UsageError(
                "--diagonal",
                expected=message(
                    "such-as", what=message("diagonal-file"), example="ppp=d1.rtl"
                ),
                found=repr(option),
            )
        file = parse_rtl(read_text(Path(name)), name)
        order = np.argsort(file.targets_mm)
        target, measured = file.targets_mm[order], file.deviations_um.mean(axis=0)[order]
        predicted = along_diagonal_um(result, diagonal, target)
        found.append(
            Compared(
                diagonal,
                target.tolist(),
                predicted.tolist(),
                (measured - measured[0]).tolist(),
            )
        )
    return found


def print_compared(each: Compared) -> None:
    print_words(
        message("diagonal-difference", diagonal=each.diagonal, largest_um=each.largest_um)
    )
    typer.echo("  target_mm  predicted_um  measured_um")
    for target, predicted, measured in zip(
        each.target_mm, each.predicted_um, each.measured_um, strict=True
    ):
        typer.echo(f"  {target:9.3f}  {predicted:12.2f}  {measured:11.2f}")


def _placed(option: str, where: str = "--run") -> tuple[str, Path, list[float]]:
    from stepdiag.base.names import LINEAR_RUNS

    rest, at, place = option.rpartition("@")
    if not at:
        rest, place = option, ""
    setup, separator, name = rest.partition("=")
    if not separator:
        setup, name = "", rest
    if (setup or where != "--run") and setup not in LINEAR_RUNS:
        raise UsageError(
            where, expected=message("before-equals", names=LINEAR_RUNS), found=repr(setup)
        )
    try:
        at_mm = [float(part or "nan") for part in place.split(",")] if place else []
    except ValueError:
        at_mm = [0.0]
    if len(at_mm) not in (0, 3):
        expected = message(
            "such-as", what=message("coordinates-after-at"), example="@0,200,150"
        )
        raise UsageError(where, expected=expected, found=repr(place))
    return setup, Path(name), [0.0 if each != each else each for each in at_mm]  # noqa: PLR0124 - the one along the axis may be left out


def import_tables(tables: Sequence[str], columns: Sequence[str], out: Path) -> None:
    """Read tables of other programs (linear-x=FILE[@X,Y,Z]), and write their readings, angles and
    straightness into a folder. Raises DataError or UsageError."""
    import numpy as np

    from stepdiag.base.files import hashed, read_text, write_together
    from stepdiag.base.readings.readings import render_readings
    from stepdiag.fourdof.tables import (
        angles_of,
        columns_named,
        parse_run,
        readings_of,
        straightness_of,
    )
    from stepdiag.solver.model.angles import render_angles
    from stepdiag.solver.model.straightness_file import render_straightness

    named = columns_named(columns)
    placed = [_placed(table, "TABLES") for table in tables]
    runs = [parse_run(read_text(path), setup, named, path.name) for setup, path, _ in placed]
    readings = readings_of(
        runs, named, [np.array(at_mm or [0.0, 0.0, 0.0]) for _, _, at_mm in placed]
    )
    angles, straightness = angles_of(runs, named), straightness_of(runs, named)
    texts = {
        "readings.csv": render_readings(readings) if readings is not None else "",
        "angles.csv": render_angles(angles) if angles else "",
        "straightness.csv": render_straightness(straightness) if straightness else "",
    }
    write_together(
        hashed({out / name: text for name, text in texts.items() if text}), over=False
    )
    for name, text in texts.items():
        if text:
            typer.echo(str(out / name))
