"""``stepdiag fourdof``: commissioning and tests of the 4-DOF head, live or from recordings."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.cli.completion import AsJson
from stepdiag.head.source import (
    curves_of_logs,
    head_of_logs,
    head_record,
    read_calibration,
    stage_run,
    write_calibration,
)
from stepdiag.terminal.viewer import print_words, shown, viewers_language

if TYPE_CHECKING:
    from stepdiag.daq.survey.head_file import AxisName, DetectorName

Seconds = Annotated[float | None, typer.Option(min=0.1)]
ALIGN_S, STABILITY_S = 3600.0, 960.0
"""Default recording times in s of a live head."""

commands = typer.Typer(no_args_is_help=True)


def register(app: typer.Typer) -> None:
    app.add_typer(commands, name="fourdof")


@commands.command()
def align(source: Path, seconds: Seconds = None) -> None:
    """Show spots and sums of the detectors while you align."""
    from stepdiag.head.view import AlignView

    view = AlignView()
    if source.suffix.lower() != ".toml":
        view.show_last(head_record(source, ALIGN_S, stated_s=seconds))
        return
    from stepdiag.daq.survey.file import load_survey
    from stepdiag.fourdof.record import listen_to_head

    with view.live():
        listen_to_head(load_survey(source), source.name, seconds or ALIGN_S, view.take)


@commands.command()
def new(
    head_id: Annotated[str, typer.Option("--id")],
    psd1_focal_mm: Annotated[float, typer.Option(min=1.0)],
    psd2_focal_mm: Annotated[float, typer.Option(min=1.0)],
    out: Annotated[Path, typer.Option()],
) -> None:
    """Write the file of a head that is not calibrated yet."""
    from stepdiag.daq.survey.head_file import HeadFile, HeadIdentity

    identity = HeadIdentity(
        id=head_id,
        format="fourdof",
        date=_today(),
        psd1_focal_length_mm=psd1_focal_mm,
        psd2_focal_length_mm=psd2_focal_mm,
        version=2,
    )
    write_calibration(out, HeadFile(head=identity))
    print_words(
        message("written-next", path=str(out), what=message("fourdof-commission-next"))
    )


@commands.command()
def calibrate(
    run: Annotated[list[str], typer.Option()],
    base: Annotated[Path, typer.Option()],
    out: Annotated[Path, typer.Option()],
    reference: str = "",
    u_reference: Annotated[float, typer.Option(min=0.0)] = 0.0,
    degree: Annotated[int, typer.Option(min=1, max=9)] = 5,
    plot: Path | None = None,
    as_json: AsJson = False,
) -> None:
    """Fit detector curves against a reference stage."""
    import msgspec

    from stepdiag.fourdof.commissioning import calibrate_axis, with_curve
    from stepdiag.head.view import calibration_charts, calibration_table

    file = read_calibration(base)
    file = msgspec.structs.replace(
        file,
        head=msgspec.structs.replace(
            file.head, date=_today(), reference=reference or file.head.reference
        ),
    )
    fits = {}
    for text in run:
        detector, axis, source = _stage(text)
        fitted = calibrate_axis(
            stage_run(source, detector, axis),
            detector,
            file,
            degree=degree,
            u_reference=u_reference,
        )
        fits[f"{detector}.{axis}"] = fitted
        file = with_curve(file, detector, axis, fitted).with_measured(
            "fourdof calibrate", _today(), f"{detector}.{axis}"
        )
    write_calibration(out, file)
    if plot is not None:
        _draw(plot, calibration_charts(fits), shown(message("sheet-residuals")))
    if as_json:
        figures = {
            name: {
                "unit": each.run.unit,
                "residual": each.limits,
                "u_um": each.fit.curve.u_um,
            }
            for name, each in fits.items()
        }
        typer.echo(json.dumps(figures, indent=2))
        return
    calibration_table(fits)
    print_words(message("written-to", path=str(out)))


@commands.command()
def commission(
    sources: list[Path],
    out: Annotated[Path, typer.Option()],
    controller: str | None = None,
    profile: Path | None = None,
    calibration: Path | None = None,
    as_json: AsJson = False,
) -> None:
    """Calibrate the head with the machine as its stage."""
    if len(sources) == 1 and sources[0].suffix.lower() == ".toml":
        if controller is None or calibration is not None:
            raise UsageError(
                "fourdof commission",
                expected=message("commission-program-options"),
                found=sources[0].name,
            )
        _commission_program(sources[0], controller, profile, out)
        return
    if calibration is None or controller is not None or profile is not None:
        raise UsageError(
            "fourdof commission",
            expected=message("commission-logs-options"),
            found=sources[0].name,
        )
    _commission_logs(sources, calibration, out, as_json=as_json)


def _commission_program(file: Path, controller: str, profile: Path | None, out: Path) -> None:
    from stepdiag.daemon.driving import programs_of
    from stepdiag.daq.survey.file import load_survey
    from stepdiag.exporters.files.control_file import ControlFile
    from stepdiag.exporters.files.sets import write_set

    programs, beside = programs_of(load_survey(file), controller, profile, commission=True)
    write_set(
        out,
        [
            *(
                ControlFile(name=each.name, data=each.data, role="program")
                for each in programs
            ),
            *beside,
        ],
    )
    for each in programs:
        typer.echo(f"{each.setup:<12}{out / each.name}")
    print_words(message("run-then-commission", name=file.name))


def _commission_logs(
    logs: list[Path], calibration: Path, out: Path, *, as_json: bool
) -> None:
    from stepdiag.daq.replay import find_logs, replay
    from stepdiag.fourdof.commission import commission as commissioned
    from stepdiag.fourdof.stands import commissioning_run
    from stepdiag.head.view import commission_table

    seen = commissioning_run(replay(find_logs(logs)))
    done = commissioned(
        seen.standings, read_calibration(calibration), seen.run, seen.axis, _today()
    )
    write_calibration(out, done.file)
    if as_json:
        table = done.file.uncertainty
        fields = {
            name: {"value": value, "u": u}
            for name, value, u in zip(
                table.of, done.found.value.tolist(), table.u, strict=True
            )
        }
        typer.echo(
            json.dumps(
                {
                    "fields": fields,
                    "u_jog_um": done.found.u_jog_um,
                    "stands": done.stands,
                    "dark": done.dark,
                },
                indent=2,
            )
        )
        return
    commission_table(done)
    print_words(message("written-next", path=str(out), what=message("name-calibration")))


@commands.command()
def stability(
    source: Path,
    calibration: Annotated[Path, typer.Option()],
    distance_mm: Annotated[float, typer.Option(min=0.0)],
    seconds: Seconds = None,
    interval_s: Annotated[float, typer.Option(min=0.01)] = 1.0,
    record: Path | None = None,
    plot: Path | None = None,
    as_json: AsJson = False,
) -> None:
    """Test the stability."""
    from dataclasses import asdict

    from stepdiag.base.files import write_new
    from stepdiag.fourdof.commissioning import stability_of
    from stepdiag.fourdof.record import render_head_csv
    from stepdiag.head.view import allan_charts, stability_table

    heard = head_record(source, STABILITY_S, stated_s=seconds)
    if record is not None:
        write_new(record, render_head_csv(heard))
    found = stability_of(heard, read_calibration(calibration), distance_mm, interval_s)
    if plot is not None:
        _draw(plot, allan_charts(found), "Allan deviation")
    if as_json:
        plain = {
            name: {
                key: value if isinstance(value, float) else value.tolist()
                for key, value in asdict(each).items()
            }
            for name, each in found.items()
        }
        typer.echo(json.dumps(plain, indent=2))
        return
    stability_table(found)


@commands.command()
def compare(
    measured: list[Path],
    reference: Annotated[Path, typer.Option()],
    plot: Path | None = None,
    as_json: AsJson = False,
) -> None:
    """Compare the head with a reference instrument."""
    from stepdiag.base.files import read_text
    from stepdiag.fourdof.commissioning import arms_of, compare_curves, parse_curves
    from stepdiag.head.view import arm_lines, comparison_charts, comparison_table

    ours = (
        parse_curves(read_text(measured[0]), measured[0].name)
        if measured[0].suffix.lower() == ".csv"
        else curves_of_logs(measured)
    )
    found = compare_curves(ours, parse_curves(read_text(reference), reference.name))
    arms = arms_of(ours, found)
    if plot is not None:
        _draw(plot, comparison_charts(found), shown(message("sheet-head-reference")))
    if as_json:
        figures: dict[str, object] = {
            name: {"lowest": one.lowest, "highest": one.highest, "rms": one.rms}
            for name, one in found.items()
        }
        typer.echo(
            json.dumps(
                figures | {"arms": {axis: arm.as_json() for axis, arm in arms.items()}},
                indent=2,
            )
        )
        return
    comparison_table(found)
    print_words(*arm_lines(arms))


@commands.command()
def show(
    logs: list[Path],
    out: Path | None = None,
) -> None:
    """Print the head's own results."""
    from stepdiag.base.files import refuse_file_name, write_together
    from stepdiag.fourdof.runs import over_passes
    from stepdiag.head.view import head_table
    from stepdiag.solver.model.angles import render_angles
    from stepdiag.solver.model.straightness_file import render_straightness
    from stepdiag.terminal.tables import finding_lines

    if out is not None:
        refuse_file_name(out)
    measured = head_of_logs(logs)
    straight = over_passes(measured)
    head_table(straight, measured.angles)
    print_words(*finding_lines(measured.findings))
    if out is not None:
        texts = {
            out / "straightness.csv": render_straightness(straight),
            out / "angles.csv": render_angles(measured.angles),
        }
        write_together(
            {path: text.encode("utf-8") for path, text in texts.items()}, over=False
        )
        print_words(message("written-to", path=", ".join(map(str, texts))))


def _today() -> str:
    from datetime import UTC, datetime

    return datetime.now(UTC).date().isoformat()


def _stage(text: str) -> "tuple[DetectorName, AxisName, Path]":
    name, _, source = text.partition("=")
    detector, _, axis = name.partition(".")
    if detector not in ("qd", "psd1", "psd2") or axis not in ("x", "y") or not source:
        raise UsageError("--run", expected="qd.x=FILE, psd2.y=FILE ..", found=repr(text))
    return detector, axis, Path(source)  # type: ignore[return-value]


def _draw(path: Path, charts: list[str], title: str) -> None:
    from stepdiag.base.files import write_atomically
    from stepdiag.report.drawings.effect import SUFFIXES, sheet

    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise UsageError(
            "--plot",
            expected=message("file-named", endings=[f"*{suffix}" for suffix in SUFFIXES]),
            found=path.name,
        )
    write_atomically(path, sheet(charts, title, suffix, viewers_language()).encode("utf-8"))
