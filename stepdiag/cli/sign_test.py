"""``stepdiag signtest``: a test that shows whether a control adds or subtracts the values of its
tables (controllers.md 11)."""

import json
import shlex
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import Words, message
from stepdiag.cli.completion import AsJson, tables
from stepdiag.terminal.viewer import print_words, shown

if TYPE_CHECKING:
    from stepdiag.exporters.safety.sign_run import SignRun
    from stepdiag.exporters.safety.sign_test import Bump

NOTE = "SIGNTEST.txt"


def register(app: typer.Typer) -> None:
    app.command("signtest")(signtest)


def signtest(
    controller: Annotated[str, typer.Option(autocompletion=tables)],
    profile: Annotated[Path, typer.Option()],
    function: str = "EXX",
    result: Path | None = None,
    out: Path | None = None,
    off: Path | None = None,
    on: Path | None = None,
    run: Path | None = None,
    day: Annotated[datetime | None, typer.Option("--date", formats=["%Y-%m-%d"])] = None,
    as_json: AsJson = False,
) -> None:
    """Try the sign of a table on this machine."""
    from stepdiag.cli.report import read_result
    from stepdiag.exporters.files.sets import read_given
    from stepdiag.exporters.profiles.file import load_profile
    from stepdiag.exporters.profiles.registry import controller_named
    from stepdiag.exporters.safety.identity import require_same_machine
    from stepdiag.exporters.safety.sign_evidence import (
        known_um,
        record,
        require_sound,
        subject,
    )
    from stepdiag.exporters.safety.sign_test import bump, verdict

    control, measured = (
        controller_named(controller),
        None if result is None else read_result(result),
    )
    known = load_profile(profile, control, None if measured is None else measured.volume)
    test = bump(control, known, function)
    if out is not None and off is None and on is None and run is None:
        for name, given in (("--date", day is not None), ("--json", as_json)):
            if given:
                raise UsageError(
                    name,
                    expected=message(
                        "with-option", option="--off FILE --on FILE (--run FILE)"
                    ),
                    found="--out",
                )
        _write_bump(test, out, controller, profile, result)
        return
    if out is not None:
        raise UsageError(
            "signtest", expected=message("bump-or-verdict"), found=message("both")
        )
    driven = _sign_run(test, off, on, run)
    if measured is None:
        raise UsageError(
            "--result", expected=message("result-of-survey"), found=message("none")
        )
    require_same_machine(measured, known)
    require_sound(test, driven, known_um(measured, control, known, test, driven.position_mm))
    shown = verdict(test, driven.position_mm, driven.off_um, driven.on_um)
    when = (day or datetime.now(tz=UTC)).date()
    if as_json:
        facts = {
            "kind": shown.kind,
            "date": f"{when}",
            "sense": shown.sense,
            "moved_um": shown.moved_um,
            "text": shown.text,
        }
        typer.echo(json.dumps(facts, indent=2))
        return
    kept = record(
        test,
        shown,
        subject(controller, known),
        when,
        read_given([each for each in (off, on, run) if each is not None]),
    )
    print_words(
        message(
            "bump-expected",
            expected_um=test.expected_um,
            top_mm=test.top_mm,
            what=shown.words,
        )
    )
    typer.echo("")
    print_words(message("append-to", name=str(profile)))
    typer.echo(f"\n{kept.as_toml()}")
    if shown.sense != (stated := test.tables[-1].law.sense):
        print_words(
            message("sign-differs", sense=shown.sense or message("none"), stated=stated)
        )


def _write_bump(
    test: "Bump", out: Path, controller: str, profile: Path, result: Path | None
) -> None:
    from stepdiag.exporters.files.control_file import ControlFile
    from stepdiag.exporters.files.sets import write_set

    note = ControlFile(
        name=NOTE, data=_steps(test, controller, profile, result).encode(), role="note"
    )
    write_set(out, [*test.files, *test.restore, note])
    for file in (*test.files, *test.restore, note):
        typer.echo(str(out / file.name))


def _steps(test: "Bump", controller: str, profile: Path, result: Path | None) -> str:
    from stepdiag.exporters.safety.sign_evidence import FEWEST

    moving, measured = test.function[2], test.function[1]
    along = moving == measured
    decisive = [
        test.reference_mm,
        test.top_mm,
        *([] if test.beyond_mm is None else [test.beyond_mm]),
    ]
    drive = message(
        "bump-drive",
        laser=message("bump-laser" if along else "bump-dial", axis=measured),
        moving=moving,
        places=[f"{at:g}" for at in decisive],
        fewest=FEWEST,
    )
    aside = (
        []
        if test.lever is None
        else [message("bump-aside", axis=test.lever[0], at_mm=test.lever[1])]
    )
    ends = f" --result {'result.json' if result is None else shlex.quote(str(result))}"
    reading = "--off OFF.csv --on ON.csv" if along else "--run RUN.csv"
    steps: tuple[Words, ...] = (
        *aside,
        message("bump-before", drive=drive),
        message("bump-load", files=[file.name for file in test.files if file.role != "note"]),
        message("bump-reference", at_mm=test.reference_mm),
        message(
            "bump-after",
            moving=moving,
            measured=measured,
            expected_um=test.expected_um,
            top_mm=test.top_mm,
        ),
        message("bump-restore", files=[file.name for file in test.restore]),
        message("bump-readings" if along else "bump-run"),
        (
            f"stepdiag signtest --controller {controller} --profile {shlex.quote(str(profile))}"
            f"{ends} --function {test.function} {reading}"
        ),
    )
    title = shown(message("bump-title", function=test.function, controller=controller))
    return (
        "\n".join(
            [
                title,
                *(f"{number}. {shown(step)}" for number, step in enumerate(steps, start=1)),
            ]
        )
        + "\n"
    )


def _sign_run(test: "Bump", off: Path | None, on: Path | None, run: Path | None) -> "SignRun":
    from stepdiag.base.files import read_text
    from stepdiag.base.readings.readings import parse_readings
    from stepdiag.exporters.files.sets import read_given
    from stepdiag.exporters.safety.sign_run import from_readings, read_sign_run

    if run is not None and off is None and on is None:
        return read_sign_run(read_given([run])[0])
    if off is None or on is None or run is not None:
        raise UsageError(
            "signtest",
            expected=message("bump-or-verdict"),
            found=message("neither" if run is None else "both"),
        )
    moving, measured = test.function[2], test.function[1]
    if moving != measured:
        found = message("option-pair", one="--off", other="--on")
        raise UsageError("signtest", expected=message("run-for-cross"), found=found)
    before, after = (parse_readings(read_text(path), path.name) for path in (off, on))
    return from_readings(before, after, moving)
