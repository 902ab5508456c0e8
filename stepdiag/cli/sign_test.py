"""``stepdiag signtest``: the experiment that tells in which sense a control applies its tables (controllers.md 11)."""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.cli.completion import AsJson, tables
from stepdiag.terminal.viewer import print_words

if TYPE_CHECKING:
    from stepdiag.exporters.safety.sign_run import SignRun
    from stepdiag.exporters.safety.sign_test import Bump

NOTE = "SIGNTEST.txt"


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
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
    from stepdiag.exporters.safety.sign_evidence import known_um, record, require_sound, subject
    from stepdiag.exporters.safety.sign_test import bump, verdict

    control, measured = controller_named(controller), None if result is None else read_result(result)
    known = load_profile(profile, control, None if measured is None else measured.volume)
    test = bump(control, known, function)
    if out is not None and off is None and on is None and run is None:
        for name, given in (("--date", day is not None), ("--json", as_json)):
            if given:
                raise UsageError(name, expected=message("with-option", option="--off FILE --on FILE (--run FILE)"), found="--out")
        _write(test, out, controller, profile, result)
        return
    if out is not None:
        raise UsageError("signtest", expected=message("bump-or-verdict"), found=message("both"))
    driven = _run(test, off, on, run)
    if measured is None:
        raise UsageError("--result", expected=message("result-of-survey"), found=message("none"))
    require_same_machine(measured, known)
    require_sound(test, driven, known_um(measured, control, known, test, driven.position_mm))
    shown = verdict(test, driven.position_mm, driven.off_um, driven.on_um)
    when = (day or datetime.now(tz=UTC)).date()
    if as_json:
        facts = {"kind": shown.kind, "date": f"{when}", "sense": shown.sense, "moved_um": shown.moved_um, "text": shown.text}
        typer.echo(json.dumps(facts, indent=2))
        return
    kept = record(test, shown, subject(controller, known), when, read_given([each for each in (off, on, run) if each is not None]))
    print_words(message("bump-expected", expected_um=test.expected_um, top_mm=test.top_mm, what=shown.words))
    typer.echo("")
    print_words(message("append-to", name=str(profile)))
    typer.echo(f"\n{kept.as_toml()}")
    if shown.sense != (stated := test.tables[-1].law.sense):
        print_words(message("sign-differs", sense=shown.sense or message("none"), stated=stated))


def _write(test: "Bump", out: Path, controller: str, profile: Path, result: Path | None) -> None:
    """Write the bump, what restores the control, and the steps of the test."""
    from stepdiag.exporters.files.control_file import ControlFile
    from stepdiag.exporters.files.sets import write_set

    note = ControlFile(name=NOTE, data=_steps(test, controller, profile, result).encode(), role="note")
    write_set(out, [*test.files, *test.restore, note])
    for file in (*test.files, *test.restore, note):
        typer.echo(str(out / file.name))


def _steps(test: "Bump", controller: str, profile: Path, result: Path | None) -> str:
    """Return the test as steps for the person who makes it."""
    from stepdiag.exporters.safety.sign_evidence import FEWEST

    moving, measured = test.function[2], test.function[1]
    along = moving == measured
    laser = f"a laser along {measured}" if along else f"a dial or a straightness laser that sees {measured}"
    decisive = [test.reference_mm, test.top_mm, *([] if test.beyond_mm is None else [test.beyond_mm])]
    places = f"{', '.join(f'{at:g}' for at in decisive)} mm and positions between them, {FEWEST} at least"
    reading = "--off OFF.csv --on ON.csv (readings of linear runs)" if along else "--run RUN.csv (position_mm,off_um,on_um)"
    ends = f" --result {'result.json' if result is None else result.name}"
    expected = f"{measured} moves {test.expected_um:+.1f} µm at {test.top_mm:g} mm"
    aside = "" if test.lever is None else f" {test.lever[0]} stands at {test.lever[1]:g} mm all the time."
    steps = (
        f"Back the control's tables up. Put up {laser}; drive {moving} to {places}, with the table off. Note the readings.{aside}",
        f"Load {', '.join(file.name for file in test.files if file.role != 'note')} as EXPORT_REPORT.txt of an export says; switch on.",
        f"Reference the axes. At {test.reference_mm:g} mm nothing may jump; if it does, switch off and stop here.",
        f"Drive {moving} to the same positions.{aside} If the stated sign is right, {expected}.",
        f"Load the restore files ({', '.join(file.name for file in test.restore)}) or your backup.",
        f"stepdiag signtest --controller {controller} --profile {profile.name}{ends} --function {test.function} {reading}",
    )
    lines = [f"SIGN TEST of {test.function} on {controller}", *(f"{number}. {step}" for number, step in enumerate(steps, start=1))]
    return "\n".join(lines) + "\n"


def _run(test: "Bump", off: Path | None, on: Path | None, run: Path | None) -> "SignRun":
    from stepdiag.base.files import read_text
    from stepdiag.base.readings.readings import parse_readings
    from stepdiag.exporters.files.sets import read_given
    from stepdiag.exporters.safety.sign_run import from_readings, read_sign_run

    if run is not None and off is None and on is None:
        return read_sign_run(read_given([run])[0])
    if off is None or on is None or run is not None:
        raise UsageError("signtest", expected=message("bump-or-verdict"), found=message("neither" if run is None else "both"))
    moving, measured = test.function[2], test.function[1]
    if moving != measured:
        found = message("option-pair", one="--off", other="--on")
        raise UsageError("signtest", expected=message("run-for-cross"), found=found)
    before, after = (parse_readings(read_text(path), path.name) for path in (off, on))
    return from_readings(before, after, moving)
