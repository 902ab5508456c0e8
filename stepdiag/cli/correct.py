"""``stepdiag correct``: a corrected survey file applied to the existing logs."""

from pathlib import Path
from typing import Annotated

import typer

from stepdiag.base.messages import message
from stepdiag.terminal.viewer import print_words, shown


def register(app: typer.Typer) -> None:
    app.command("correct")(correct)


def correct(
    survey: Path,
    name: str = "",
    yes: Annotated[bool, typer.Option("--yes")] = False,
) -> None:
    """Read existing logs with a corrected survey file."""
    import getpass
    import time

    from stepdiag.base.errors import UsageError
    from stepdiag.daq.passes.pass_book import PassBook
    from stepdiag.daq.recording.corrections import (
        Correction,
        compared,
        must_reread,
        note_correction,
        text_of,
    )
    from stepdiag.daq.recording.rounds import is_recording, noted_round, round_folders
    from stepdiag.daq.records.survey_folder import RESULT
    from stepdiag.daq.replay import begun_logs
    from stepdiag.daq.survey.file import load_survey, parse_survey, read_text

    known, text = load_survey(survey), read_text(survey)
    folder = known.folder(survey)
    rounds = round_folders(folder)
    logs = begun_logs(rounds[-1]) if rounds else []
    if not logs:
        raise UsageError(
            str(survey),
            expected=message("recorded-survey"),
            found=message("nothing-recorded-yet"),
        )
    if is_recording(folder):
        remedy = message("stop-then-correct")
        raise UsageError(
            str(folder),
            expected=message("no-other"),
            found=message("found-running"),
            remedy=remedy,
        )
    last = rounds[-1]
    if (last / RESULT).exists():
        raise UsageError(
            str(last),
            expected=message("unsolved-round"),
            found=RESULT,
            remedy=message("solve-corrected"),
        )
    recorded = text_of(last, logs)
    changed = compared(recorded, text)
    if changed is None or any(each.begins_round for each in changed):
        driven = [str(each) for each in changed or () if each.begins_round]
        found, remedy = "; ".join(driven) or message("another-one"), message("run-new-round")
        raise UsageError(
            str(survey), expected=message("driven-as-logs"), found=found, remedy=remedy
        )
    if not changed:
        print_words(message("nothing-to-correct"))
        return
    print_words(*map(str, changed))
    if must_reread(logs, text):
        for title, by_file in (
            (message("as-recorded"), recorded),
            (message("as-corrected"), text),
        ):
            noted, book = (
                noted_round(last, logs, by_file),
                PassBook(parse_survey(by_file, str(title))),
            )
            book.add_all(noted.stops)
            whole = sum(one.whole for one in book.passes)
            errors = sum(one.severity == "error" for one in noted.findings)
            print_words(
                message(
                    "passes-counted",
                    title=title,
                    whole=whole,
                    stops=len(noted.stops),
                    errors=errors,
                )
            )
    if not yes:
        typer.confirm(shown(message("ask-correct")), abort=True)
    done = Correction(
        time_s=time.time(),
        name=name or getpass.getuser(),
        changes=tuple(map(str, changed)),
        survey_text=text,
    )
    note_correction(last, done)
    print_words(message("corrected-round", folder=str(last)))
