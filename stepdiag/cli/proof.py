"""``stepdiag proof``: a proof run after loading (a diagonal and a line, ten minutes of driving),
with a verdict on each table."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.cli.certificate import JUDGED_WRONG, UNDECIDED
from stepdiag.cli.completion import TABLES, AsJson, Verbose, tables
from stepdiag.terminal.viewer import empty_table, print_words

if TYPE_CHECKING:
    from datetime import date

    from stepdiag.daq.survey.models import Survey
    from stepdiag.exporters.proof.judge import Proof
    from stepdiag.exporters.proof.plan import ProofPlan


MINUTES = 10.0
EXIT_CODES = {"keep": 0, "restore": JUDGED_WRONG, "undecided": UNDECIDED}
"""Exit codes of contract 5 for a file that is judged wrong, and for data that do not support the
request."""


def register(app: typer.Typer) -> None:
    app.command("proof")(proof)


def proof(
    file: Path,
    controller: Annotated[str, typer.Option(autocompletion=tables)] = "",
    loaded: Path | None = None,
    profile: Path | None = None,
    minutes: float = MINUTES,
    out: Path | None = None,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Prove that loaded tables act as exported."""
    from stepdiag.daq.survey.file import load_survey

    survey = load_survey(file)
    options = {
        "--controller": controller,
        "--loaded": loaded,
        "--profile": profile,
        "--minutes": minutes != MINUTES,
        "--out": out,
    }
    if survey.proof is not None:
        if given := [name for name, value in options.items() if value]:
            raise UsageError(
                ", ".join(given),
                expected=message("with-option", option=message("survey-file-of-machine")),
                found=message("a-proof-run", name=file.name),
            )
        _judge(file, survey, verbose=verbose, as_json=as_json)
        return
    if not controller:
        raise UsageError(
            "--controller", expected=message("one-of", names=TABLES), found=message("none")
        )
    if not 0 < minutes < float("inf"):
        raise UsageError(
            "--minutes", expected=message("number-above-0"), found=f"{minutes:g}"
        )
    _plan(file, survey, controller, loaded, profile, minutes, out, as_json=as_json)


def _plan(
    file: Path,
    survey: "Survey",
    controller: str,
    loaded: Path | None,
    profile: Path | None,
    minutes: float,
    out: Path | None,
    *,
    as_json: bool,
) -> None:
    from stepdiag.base.files import write_atomically
    from stepdiag.completion.proof import ProofFiles, planned
    from stepdiag.daemon.survey_state import standing_of
    from stepdiag.daq.records.survey_folder import EXPORTS

    found = standing_of(file).result
    if found is None:
        raise UsageError(
            file.name,
            expected=message("expects-result"),
            found=message("none-yet"),
            remedy=message("complete-first"),
        )
    folder = loaded or found.parent / EXPORTS / controller
    known = profile or next(
        (
            file.parent / each.profile
            for each in survey.exports
            if each.controller == controller
        ),
        None,
    )
    given = ProofFiles(
        survey=file, round=found.parent, loaded=folder, profile=known, controller=controller
    )
    plan, text = planned(given, _acting(folder), minutes)
    target = file.with_name(f"{file.stem}-proof.toml")
    write_atomically(target, text.encode("utf-8"))
    programs = _programs(target, controller, known, out)
    if as_json:
        from dataclasses import asdict

        typer.echo(
            json.dumps(
                {**asdict(plan), "survey": str(target), "programs": programs}, indent=2
            )
        )
        return
    _print_plan(plan)
    print_words(message("proof-survey", path=str(target)))
    for name in programs:
        print_words(message("program-in", path=name))
    print_words(message("run-then-proof", path=str(target)))


def _acting(folder: Path) -> list[Path]:
    from stepdiag.cli.control import tables_among

    return [folder / each.name for each in tables_among([folder])[0]]


def _programs(
    target: Path, controller: str, profile: Path | None, out: Path | None
) -> list[str]:
    from stepdiag.cli.completion import PROGRAMS
    from stepdiag.daemon.driving import programs_of
    from stepdiag.daq.survey.file import load_survey
    from stepdiag.exporters.files.control_file import ControlFile
    from stepdiag.exporters.files.sets import write_set

    if out is None or controller not in PROGRAMS:
        return []
    made, beside = programs_of(load_survey(target), controller, profile)
    write_set(
        out,
        [
            *(ControlFile(name=each.name, data=each.data, role="program") for each in made),
            *beside,
        ],
    )
    return [str(out / each.name) for each in made]


def _print_plan(plan: "ProofPlan") -> None:
    from rich.console import Console

    named = [message("setup-named", setup=setup) for setup in plan.setups]
    table = empty_table(
        message("table-proof", setups=named, repeats=plan.repeats, minutes=plan.minutes)
    )
    for each in plan.foreseen:
        table.add_row(each.function, f"{each.seen_um:.2f}", f"{each.expanded_um:.2f}")
    Console().print(table)


def _judge(file: Path, survey: "Survey", *, verbose: bool, as_json: bool) -> None:
    from stepdiag.base.files import read_bytes
    from stepdiag.base.readings.readings import parse_readings
    from stepdiag.completion.proof import loaded_in, proof_of, sign_records
    from stepdiag.daemon.survey_state import standing_of
    from stepdiag.daq.records.survey_folder import READINGS
    from stepdiag.daq.survey.bundle import read_bundle

    found = standing_of(file).result
    if found is None:
        raise UsageError(
            file.name,
            expected=message("complete-survey"),
            found=message("state-to-do"),
            remedy=message("command-says", command=f"stepdiag status {file}"),
        )
    runs, files = read_bytes(found.parent / READINGS), read_bundle(file, survey)
    held, verdict = (
        loaded_in(survey, files),
        proof_of(survey, files, parse_readings(runs.decode("utf-8"))),
    )
    if held is None or verdict is None:
        return
    records = [record.as_toml() for record in sign_records(held, verdict, runs, _day(found))]
    if as_json:
        typer.echo(
            json.dumps(
                {
                    "action": verdict.action,
                    "tables": _tables_json(verdict),
                    "further": verdict.further,
                    "sign_tests": records,
                },
                indent=2,
            )
        )
    else:
        restore = _restore_files(file, survey) if verdict.action == "restore" else []
        print_verdict(verdict, restore, records, verbose=verbose)
    raise typer.Exit(EXIT_CODES[verdict.action])


def print_verdict(
    verdict: "Proof", restore: list[Path], records: list[str], *, verbose: bool
) -> None:
    """Print the next action and the files to restore. With ``verbose``, also print each table and
    the profile entries that replace sign tests."""
    from stepdiag.completion.proof import action_words, words_of

    print_words(action_words(verdict))
    for path in restore:
        typer.echo(f"  {path}")
    if verbose:
        print_words(*map(words_of, verdict.tables))
    if records and not verbose:
        print_words(message("sign-test-records", count=len(records)))
    elif records:
        print_words(message("in-place-of-sign-test"))
        typer.echo("\n".join(records))


def _day(result: Path) -> "date":
    from datetime import date

    from stepdiag.cli.report import read_result

    facts = read_result(result).survey
    return date.fromisoformat(facts.date) if facts is not None else date.min


def _restore_files(file: Path, survey: "Survey") -> list[Path]:
    from stepdiag.exporters.files.naming import is_restore

    folder = (file.parent / survey.machine.active[0]).parent
    return sorted(path for path in folder.iterdir() if is_restore(path.name))


def _tables_json(verdict: "Proof") -> list[dict[str, object]]:
    from dataclasses import asdict

    return [{**asdict(each), "state": each.state} for each in verdict.tables]
