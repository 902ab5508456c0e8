"""``stepdiag solve``, ``replay`` and ``plan``: from readings or logs to a result, and what a survey will be able to say."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stepdiag.base.errors import DataError, UsageError
from stepdiag.cli.runs import Runs, files_of, with_files
from stepdiag.cli.stated import Active, ActiveDate, ActiveSource, Compensation, active_files, with_compensation

if TYPE_CHECKING:
    from collections.abc import Mapping

    from stepdiag.base.result.result import Result

Sources = Annotated[list[Path], typer.Argument(help="A readings CSV, or the logs of one survey (files or their folder).")]
AsJson = Annotated[bool, typer.Option("--json", help="Print for programs.")]


MOST_TRIALS = 2_000_000
CLOSED = ("least-squares", "wang2000")
"""Methods that take the readings alone."""
CHAIN = "FXYZ"
"""The chain of readings that come without one."""


def register(app: typer.Typer) -> None:
    """Add the commands to the application."""
    app.command("solve")(solve)
    app.command("replay")(replay)


def solve(
    sources: Sources,
    out: Annotated[Path | None, typer.Option(help="Where to write the result (JSON).")] = None,
    method: Annotated[str, typer.Option(help="estimate, least-squares or wang2000.")] = "estimate",
    chain: Annotated[
        str | None, typer.Option(help=f"Kinematic chain from workpiece to tool, {CHAIN} without it; logs bring their own.")
    ] = None,
    angles: Annotated[
        Path | None, typer.Option(help="Angular functions of the axes (CSV), from a 4-DOF head or a level; logs bring their own.")
    ] = None,
    straightness: Annotated[
        Path | None, typer.Option(help="Straightness functions (CSV), as `fourdof show` writes them; logs bring their own.")
    ] = None,
    compensation: Compensation = None,
    active: Active = None,
    active_date: ActiveDate = None,
    active_source: ActiveSource = "",
    environment: Annotated[
        Path | None, typer.Option(help="Air and material that count in place of what was recorded in logs (TOML, [environment]).")
    ] = None,
    uncertainty: Annotated[
        Path | None, typer.Option(help="What is taken for granted about the machine (TOML, [uncertainty]); logs bring their own.")
    ] = None,
    tolerance: Annotated[Path | None, typer.Option(help="What the machine is to keep (TOML, [tolerance]); logs bring their own.")] = None,
    run: Runs = None,
    monte_carlo: Annotated[int, typer.Option(help="Draw so many surveys (JCGM 101) and say how they scatter; 200000 are usual.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Solve readings or logs.

    Error functions, squareness and scale with their uncertainty, and what is not identified.
    """
    from stepdiag.completion.readings_file import Beside, solve_readings_file, source_of
    from stepdiag.terminal.tables import result_table

    handed = active_files(active)
    if len(sources) == 1 and sources[0].suffix.lower() == ".csv":
        if environment is not None:
            raise UsageError("--environment", expected="logs: readings are put right already", found=sources[0].name)
        if uncertainty is not None and method in CLOSED:
            raise UsageError("--uncertainty", expected="--method estimate, which weighs what is assumed", found=method)
        _refuse_angles(angles, handed)
        if monte_carlo and not 1000 <= monte_carlo <= MOST_TRIALS:
            raise UsageError("--monte-carlo", expected=f"1000 to {MOST_TRIALS} surveys", found=str(monte_carlo))
        beside = Beside(
            angles=angles, straightness=straightness, uncertainty=uncertainty, tolerance=tolerance,
            runs=tuple(source_of("run", file) for file in files_of(run or ())),
            add=partial(with_files, runs=run, source=sources[0].name) if run else None,
        )  # fmt: skip
        result = solve_readings_file(sources[0], beside, method=method, chain=chain or CHAIN, monte_carlo=monte_carlo)
    else:
        given = {
            "--chain": chain, "--angles": angles, "--straightness": straightness,
            "--uncertainty": uncertainty, "--tolerance": tolerance, "--monte-carlo": monte_carlo, "--run": run,
        }  # fmt: skip
        option = next((name for name, value in given.items() if value), None)
        if option is not None:
            raise UsageError(option, expected="one readings file (*.csv)", found="logs", remedy="solve the readings.csv beside the result")
        result = _solve_logs(sources, method, environment)
    result = with_compensation(result, compensation, handed, active_date, active_source)
    if out is not None:
        _write_result(out, result)
    if as_json:
        typer.echo(result.to_json(), nl=False)
    else:
        result_table(result, out)
        for line in concluded(result):
            typer.echo(line)


def concluded(result: "Result") -> list[str]:
    """Return the conclusion of a result alone, as lines of a terminal."""
    from stepdiag.conclusion import conclude, conclusion_document

    return in_lines(conclusion_document(conclude(result)))


def in_lines(document: "Mapping[str, Any]") -> list[str]:
    """Return the JSON of a conclusion as lines of a terminal."""
    from stepdiag.conclusion import titles_of, words_of
    from stepdiag.terminal.tables import conclusion_lines
    from stepdiag.terminal.viewer import viewers_language

    language = viewers_language()
    return list(conclusion_lines(words_of(document, language), titles_of(language)))


def _refuse_angles(angles: Path | None, active: "dict[str, bytes]") -> None:
    """Raise UsageError for angles whose levers were compensated while measuring."""
    from stepdiag.exporters.safety.levers import left_out

    found = left_out(active) if angles is not None else None
    if angles is not None and found is not None:
        raise UsageError("--angles", expected=f"no angles: {found.words}", found=angles.name)


def _solve_logs(paths: list[Path], method: str, environment: Path | None) -> "Result":
    """Return the result of logs. Raises UsageError for a file that is named like none: readings are one file, named *.csv."""
    from stepdiag.base.files import read_text
    from stepdiag.completion.completion import replay_judged, solve_logs
    from stepdiag.completion.readings_file import source_of
    from stepdiag.daq.survey.environment import parse_environment

    for path in paths:
        if path.is_file() and ".mcap" not in path.suffixes:
            raise UsageError(str(path), expected="one readings file (*.csv), or logs (*.mcap)", found=f"{len(paths)} file(s), {path.name}")
    if environment is None:
        return solve_logs(replay_judged(paths), method)[0]
    result = solve_logs(replay_judged(paths), method, parse_environment(read_text(environment), environment.name))[0]
    return replace(result, sources=(*(result.sources or ()), source_of("environment", environment)))


def _write_result(out: Path, result: "Result") -> None:
    from stepdiag.base.files import write_once

    target = out / "result.json" if out.is_dir() else out
    write_once(target, result.to_json())


def replay(
    logs: Annotated[list[Path], typer.Argument(help="The logs of one survey, or their folder.")],
    out: Annotated[Path | None, typer.Option(help="Where to write the results again; default a folder `replay` beside the logs.")] = None,
    survey: Annotated[
        Path | None, typer.Option("--survey", help="A survey file in place of the one in the logs, where that cannot be used any more.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Make result and files again from the logs.

    And compare them with what the live run wrote, byte for byte; another processor may write a last digit otherwise, which is reported.
    """
    from stepdiag.daemon.replay import replay_and_compare

    compared = replay_and_compare(logs, out, survey)
    if as_json:
        typer.echo(json.dumps(compared.as_json(), indent=2))
    else:
        typer.echo(compared.in_words())
    if compared.different:
        raise DataError(
            str(compared.live),
            expected="the bytes of the live run",
            found=f"others in {', '.join(compared.different)}",
            remedy=f"compare with {compared.out}: another version of stepdiag, or a file that was changed",
        )
