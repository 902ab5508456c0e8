"""``stepdiag solve`` and ``replay``: from readings or logs to a result."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.messages import message
from stepdiag.cli.completion import AsJson, Verbose
from stepdiag.cli.runs import files_of, with_files
from stepdiag.cli.stated import ActiveDate, active_files, with_compensation
from stepdiag.terminal.viewer import print_words, viewers_language

if TYPE_CHECKING:
    from collections.abc import Mapping

    from stepdiag.base.result.result import Result


MOST_TRIALS = 2_000_000
CLOSED = ("least-squares", "wang2000")
"""Solution methods whose only input is the readings."""
DETAILS = frozenset({"unknown_usual", "unknown_slip_passes"})
"""Keys of the sentences about unidentified values, which only `--verbose` and the report show."""
CHAIN = "FXYZ"
"""Default kinematic chain of a readings file."""


def register(app: typer.Typer) -> None:
    app.command("solve")(solve)
    app.command("replay")(replay)


def solve(
    sources: list[Path],
    out: Path | None = None,
    method: str = "estimate",
    chain: str | None = None,
    angles: Path | None = None,
    straightness: Path | None = None,
    compensation: str | None = None,
    active: list[Path] | None = None,
    active_date: ActiveDate = None,
    active_source: str = "",
    environment: Path | None = None,
    uncertainty: Path | None = None,
    tolerance: Path | None = None,
    run: list[str] | None = None,
    monte_carlo: int = 0,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Solve readings or logs."""
    from stepdiag.completion.readings_file import Beside, solve_readings_file, source_of
    from stepdiag.terminal.tables import print_findings, print_tables

    handed = active_files(active)
    if len(sources) == 1 and sources[0].suffix.lower() == ".csv":
        if environment is not None:
            raise UsageError(
                "--environment", expected=message("logs-not-readings"), found=sources[0].name
            )
        if uncertainty is not None and method in CLOSED:
            raise UsageError("--uncertainty", expected="--method estimate", found=method)
        _refuse_angles(angles, handed)
        if monte_carlo and not 1000 <= monte_carlo <= MOST_TRIALS:
            raise UsageError(
                "--monte-carlo",
                expected=message(
                    "number-from-to", kind=message("whole-number"), low=1000, high=MOST_TRIALS
                ),
                found=str(monte_carlo),
            )
        beside = Beside(
            angles=angles,
            straightness=straightness,
            uncertainty=uncertainty,
            tolerance=tolerance,
            runs=tuple(source_of("run", file) for file in files_of(run or ())),
            add=partial(with_files, runs=run, source=sources[0].name) if run else None,
        )
        result = solve_readings_file(
            sources[0], beside, method=method, chain=chain or CHAIN, monte_carlo=monte_carlo
        )
    else:
        given = {
            "--chain": chain,
            "--angles": angles,
            "--straightness": straightness,
            "--uncertainty": uncertainty,
            "--tolerance": tolerance,
            "--monte-carlo": monte_carlo,
            "--run": run,
        }
        option = next((name for name, value in given.items() if value), None)
        if option is not None:
            raise UsageError(
                option,
                expected=message("one-readings-file"),
                found=message("the-logs"),
                remedy=message("solve-readings"),
            )
        result = _solve_logs(sources, method, environment)
    result = with_compensation(result, compensation, handed, active_date, active_source)
    if out is not None:
        _write_result(out, result)
    if as_json:
        typer.echo(result.to_json(), nl=False)
    else:
        print_words(*concluded(result, verbose=verbose))
        if verbose:
            print_tables(result)
        print_findings(result.findings, verbose=verbose)
        if out is not None:
            print_words(message("written-to", path=str(out)))


def concluded(result: "Result", *, verbose: bool = True) -> list[str]:
    """Return the conclusion of a result as lines for a terminal; without ``verbose``, as many as
    fit a screen."""
    from stepdiag.conclusion import conclude, conclusion_document

    found = conclude(result)
    if not verbose:
        first = [one for one in found.unknown if one.key not in DETAILS]
        found = replace(found, basis=(), unknown=tuple(first))
    return in_lines(conclusion_document(found))


def in_lines(document: "Mapping[str, Any]") -> list[str]:
    from stepdiag.conclusion import titles_of, words_of
    from stepdiag.terminal.tables import conclusion_lines

    language = viewers_language()
    return list(conclusion_lines(words_of(document, language), titles_of(language)))


def _refuse_angles(angles: Path | None, active: "dict[str, bytes]") -> None:
    from stepdiag.exporters.safety.levers import left_out

    found = left_out(active) if angles is not None else None
    if angles is not None and found is not None:
        raise UsageError(
            "--angles", expected=message("no-angles", why=found.words), found=angles.name
        )


def _solve_logs(paths: list[Path], method: str, environment: Path | None) -> "Result":
    from stepdiag.base.files import read_text
    from stepdiag.completion.completion import replay_judged, solve_logs
    from stepdiag.completion.readings_file import source_of
    from stepdiag.daq.survey.environment import parse_environment

    for path in paths:
        if path.is_file() and ".mcap" not in path.suffixes:
            raise UsageError(str(path), expected=message("readings-or-logs"), found=path.name)
    if environment is None:
        return solve_logs(replay_judged(paths), method)[0]
    result = solve_logs(
        replay_judged(paths),
        method,
        parse_environment(read_text(environment), environment.name),
    )[0]
    return replace(
        result, sources=(*(result.sources or ()), source_of("environment", environment))
    )


def _write_result(out: Path, result: "Result") -> None:
    from stepdiag.base.files import write_hashed

    write_hashed(out / "result.json" if out.is_dir() else out, result.to_json())


def replay(
    logs: list[Path],
    out: Path | None = None,
    survey: Annotated[Path | None, typer.Option("--survey")] = None,
    as_json: AsJson = False,
) -> None:
    """Compute the result and the files again from the logs."""
    from stepdiag.daemon.replay import replay_and_compare

    compared = replay_and_compare(logs, out, survey)
    if as_json:
        typer.echo(json.dumps(compared.as_json(), indent=2))
    else:
        for line in compared.in_words():
            print_words(line)
    if compared.different:
        raise DataError(
            str(compared.live),
            expected=message("bytes-of-live-run"),
            found=message("several-others", names=compared.different),
            remedy=message("compare-with", folder=str(compared.out)),
        )
