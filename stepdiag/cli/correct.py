"""``stepdiag correct``: a corrected survey file applied to the logs that exist."""

from pathlib import Path
from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("correct")(correct)


def correct(
    survey: Path,
    name: str = "",
    yes: Annotated[bool, typer.Option("--yes")] = False,
) -> None:
    """Read existing logs by a corrected survey file."""
    import getpass
    import time

    from stepdiag.base.errors import UsageError
    from stepdiag.daq.passes.pass_book import PassBook
    from stepdiag.daq.recording.corrections import Correction, compared, must_reread, note_correction, text_of
    from stepdiag.daq.recording.rounds import is_recording, noted_round, round_folders
    from stepdiag.daq.records.survey_folder import RESULT
    from stepdiag.daq.replay import begun_logs
    from stepdiag.daq.survey.file import load_survey, parse_survey, read_text
    from stepdiag.terminal.printable import printable

    known, text = load_survey(survey), read_text(survey)
    folder = known.folder(survey)
    rounds = round_folders(folder)
    logs = begun_logs(rounds[-1]) if rounds else []
    if not logs:
        raise UsageError(str(survey), expected="a survey that was recorded", found="nothing recorded yet")
    if is_recording(folder):
        raise UsageError(str(folder), expected="no daemon that records", found="one that runs", remedy="stop it, correct, start it again")
    last = rounds[-1]
    if (last / RESULT).exists():
        raise UsageError(str(last), expected="a round without a result", found=RESULT, remedy="solve the corrected logs beside it")
    recorded = text_of(last, logs)
    changed = compared(recorded, text)
    if changed is None or any(each.begins_round for each in changed):
        driven = [str(each) for each in changed or () if each.begins_round]
        raise UsageError(str(survey), expected="the volume, targets and program of the logs", found="; ".join(driven) or "another one",
                         remedy="start `stepdiag run` for a new round")  # fmt: skip
    if not changed:
        typer.echo("nothing to correct: the logs were recorded, or corrected, with this file")
        return
    for each in changed:
        typer.echo(printable(str(each)))
    if must_reread(logs, text):
        for title, by_file in (("as recorded", recorded), ("corrected", text)):
            noted, book = noted_round(last, logs, by_file), PassBook(parse_survey(by_file, title))
            book.add_all(noted.stops)
            whole = sum(one.whole for one in book.passes)
            errors = sum(one.severity == "error" for one in noted.findings)
            typer.echo(f"{title}: {whole} whole passes, {len(noted.stops)} stops, {errors} errors")
    if not yes:
        typer.confirm("apply this to the logs?", abort=True)
    done = Correction(time_s=time.time(), name=name or getpass.getuser(), changes=tuple(map(str, changed)), survey_text=text)
    note_correction(last, done)
    typer.echo(f"corrected: {last}")
