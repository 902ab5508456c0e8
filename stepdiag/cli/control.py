"""``stepdiag profile``, ``export``, ``import`` and ``verify``: files of a control and their
effect."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.messages import Words, message
from stepdiag.cli.certificate import JUDGED_WRONG, UNDECIDED, verify_file
from stepdiag.cli.completion import AsJson, Verbose, exported, tables
from stepdiag.cli.granted import say_granted
from stepdiag.cli.runs import Compared, compared, print_compared
from stepdiag.cli.stated import ActiveDate, active_files, with_compensation
from stepdiag.terminal.viewer import print_words, shown, viewers_language

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stepdiag.base.result.result import Result
    from stepdiag.base.volume import Volume
    from stepdiag.exporters.export.written import ExportReport
    from stepdiag.exporters.files.control_file import ControlFile
    from stepdiag.exporters.safety.read_back import ReadBack
    from stepdiag.exporters.safety.verify import Prediction, Verification
    from stepdiag.exporters.tables.profile import Profile

"""Exit code of ``verify`` for a file that must not be loaded (contract 5)."""


def register(app: typer.Typer) -> None:
    app.command("profile")(profile)
    app.command("export")(export)
    app.command("verify")(verify)
    app.command("import")(import_)


def profile(
    controller: Annotated[str, typer.Argument(autocompletion=tables)],
    out: Path | None = None,
) -> None:
    """Write a commented profile of a machine to fill in."""
    from stepdiag.base.files import write_new
    from stepdiag.exporters.profiles.registry import controller_named
    from stepdiag.exporters.profiles.template import profile_template

    text = profile_template(controller_named(controller))
    if out is None:
        typer.echo(text, nl=False)
        return
    write_new(out, text)
    print_words(message("profile-written", path=str(out), controller=controller))


def export(
    result: Path,
    controller: Annotated[str, typer.Option(autocompletion=exported)],
    out: Annotated[Path, typer.Option()],
    profile: Path | None = None,
    step_mm: float | None = None,
    accept: list[str] | None = None,
    compensation: str | None = None,
    active: list[Path] | None = None,
    active_date: ActiveDate = None,
    active_source: str = "",
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Write the compensation files of a result."""
    from stepdiag.cli.report import read_result
    from stepdiag.exporters.export.export import export as write_files
    from stepdiag.terminal.progress import working

    measured = with_compensation(
        read_result(result), compensation, active_files(active), active_date, active_source
    )
    with working(message("checking-tables")):
        known = (
            None if profile is None else read_profile(profile, controller, measured.volume)
        )
        written = write_files(
            measured,
            controller,
            known,
            step_mm=step_mm,
            accept=tuple(accept or ()),
            out_dir=out,
        )
    _name_unused(accept or (), written)
    if as_json:
        typer.echo(json.dumps(_export_json(written), indent=2, ensure_ascii=False))
    else:
        _print_export(written, verbose=verbose)
        if verbose:
            say_granted([measured])


def _name_unused(accept: "Sequence[str]", written: "ExportReport") -> None:
    """Print the accepted codes that match no finding of the export: they are mistyped or not
    needed."""
    if unused := [
        code
        for code in accept
        if not any(each.is_accepted([code]) for each in written.findings)
    ]:
        print_words(message("accept-unused", codes=unused), err=True)


def read_profile(path: Path, controller: str, volume: "Volume") -> "Profile":
    """Return the machine's profile for a control. Raises UsageError for a control without
    profiles."""
    from stepdiag.exporters.profiles.file import load_profile
    from stepdiag.exporters.profiles.registry import controller_named
    from stepdiag.exporters.tables import lattice

    if controller == lattice.NAME:
        raise UsageError(
            "--profile",
            expected="--step-mm alone: a lattice knows no control",
            found=path.name,
        )
    return load_profile(path, controller_named(controller), volume)


def _export_json(written: "ExportReport") -> dict[str, object]:
    from stepdiag.base.result.typed import written as json_of
    from stepdiag.exporters.files.sets import read_set

    return {
        "controller": written.controller,
        "out": str(written.out_dir),
        "files": [_file_json(file) for file in read_set(written.out_dir)],
        "findings": [finding.as_json() for finding in written.findings],
        "predicted": None
        if written.prediction is None
        else json_of(written.prediction.predicted),
    }


def _file_json(file: "ControlFile") -> dict[str, str]:
    import hashlib

    return {"name": file.name, "sha256": hashlib.sha256(file.data).hexdigest()}


def _print_export(written: "ExportReport", *, verbose: bool) -> None:
    from rich.console import Console

    from stepdiag.terminal.tables import effect_table, print_findings

    print_words(
        message("files-written", count=len(written.files), folder=str(written.out_dir))
    )
    for name in written.files if verbose else ():
        typer.echo(f"  {name}")
    print_findings(written.findings, verbose=verbose)
    if written.prediction is not None:
        Console().print(effect_table(written.prediction))
    _print_load(written)
    print_words(message("how-to-load"))


def _print_load(written: "ExportReport") -> None:
    from stepdiag.conclusion import export_of, loadable, render

    for sentence in loadable([export_of(written)]):
        print_words(render(sentence, viewers_language()))


def import_(
    files: list[str],
    out: Annotated[Path, typer.Option()],
    chain: str = "",
    columns: Annotated[list[str] | None, typer.Option("--map")] = None,
) -> None:
    """Read the measurements of other software."""
    if columns:
        from stepdiag.cli.runs import import_tables

        import_tables(files, columns, out)
        return
    if len(files) != 1 or not chain:
        raise UsageError("import", expected=message("import-options"), found=" ".join(files))
    file = Path(files[0])
    from stepdiag.base.files import read_bytes, write_hashed
    from stepdiag.exporters.files.control_file import ControlFile
    from stepdiag.exporters.neutral import etalon

    found = etalon.parse(ControlFile(name=file.name, data=read_bytes(file)), chain)
    write_hashed(out, found.to_json())
    print_words(message("imported-result", path=str(out)))


def verify(
    result: Path,
    files: Annotated[list[Path] | None, typer.Argument()] = None,
    profile: Path | None = None,
    diagonal: list[str] | None = None,
    out: Path | None = None,
    before: list[Path] | None = None,
    read_back: list[Path] | None = None,
    custody: str = "",
    key_certificate: Path | None = None,
    compensation: str | None = None,
    active: list[Path] | None = None,
    active_date: ActiveDate = None,
    active_source: str = "",
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Judge compensation files, or compute a certificate again."""
    if result.suffix.lower() in {".xml", ".pdf"}:
        verify_file(result, custody, key_certificate)
        return
    if custody or key_certificate is not None:
        raise UsageError(
            "--custody, --key-certificate",
            expected="a certificate (FILE.xml)",
            found=result.name,
        )
    from stepdiag.base.compensation import stated_in
    from stepdiag.cli.report import read_result
    from stepdiag.exporters.safety.verify import controller_for, verify_files
    from stepdiag.report.drawings.space import LATTICE

    measured = with_compensation(
        read_result(result), compensation, active_files(active), active_date, active_source
    )
    beside = compared(measured, diagonal or ())
    if not files:
        _diagonals_alone(beside, [*(before or []), *(read_back or [])], as_json=as_json)
        return
    given, aside = tables_among(files)
    known = (
        read_profile(profile, controller_for(given).name, measured.volume)
        if profile is not None
        else None
    )
    found = verify_files(measured, given, known)
    if out is not None:
        _draw(found, verify_files(measured, given, known, nodes=LATTICE).prediction, out)
    _refuse_both(before, read_back)
    held = _read_back(measured, given, read_back or before or [], known, before=bool(before))
    if as_json:
        parts = {
            **_verification_json(found, given, aside),
            **_read_back_json(held),
            **_diagonals_json(beside),
        }
        typer.echo(json.dumps(parts, indent=2, ensure_ascii=False))
    else:
        _print_verification(found, given, aside, stated_in(measured).words(), verbose=verbose)
        _caution(measured, found.prediction)
        say_granted([measured] if verbose else [])
        for each in beside:
            print_compared(each)
        _print_read_back(held, before=bool(before))
        if out is not None:
            typer.echo(f"picture: {out}")
    if not found.right or (held is not None and held.findings):
        raise typer.Exit(JUDGED_WRONG)
    if found.verdict == "undecided":
        raise typer.Exit(UNDECIDED)


def _refuse_both(before: list[Path] | None, read_back: list[Path] | None) -> None:
    if before and read_back:
        raise UsageError(
            "--before",
            expected=message("either-option", one="--before", other="--read-back"),
            found=message("both"),
        )


def _read_back(
    measured: "Result",
    given: "Sequence[ControlFile]",
    paths: list[Path],
    known: "Profile | None",
    *,
    before: bool,
) -> "ReadBack | None":
    """Return the comparison of the control's contents with the written files. With ``before``, the
    contents are compared with the machine's own files, because no file is loaded yet. Return None
    without files that were read out of the control. Raises DataError for files of another
    control."""
    from stepdiag.exporters.files.sets import read_given
    from stepdiag.exporters.profiles.file import quick_profile
    from stepdiag.exporters.safety.read_back import compare, compare_before
    from stepdiag.exporters.safety.verify import controller_for

    if not paths:
        return None
    control = controller_for(given)
    profile = known or quick_profile(control, measured.volume)
    if before:
        return compare_before(control, read_given(paths), profile)
    return compare(control, given, read_given(paths), profile)


def _read_back_json(held: "ReadBack | None") -> dict[str, object]:
    if held is None:
        return {}
    return {
        "read_back": {
            "numbers": held.numbers,
            "switches": held.switches,
            "findings": [each.as_json() for each in held.findings],
        }
    }


def _print_read_back(held: "ReadBack | None", *, before: bool) -> None:
    from stepdiag.terminal.tables import finding_lines

    if held is None:
        return
    if not held.findings:
        counts = {"numbers": held.numbers, "switches": held.switches}
        print_words(
            message("held-before-same", **counts)
            if before
            else message("read-back-same", **counts)
        )
    elif before:
        print_words(message("held-before-differs"))
    print_words(*finding_lines(held.findings))


def _diagonals_alone(
    beside: "list[Compared]", read_back: list[Path], *, as_json: bool
) -> None:
    if read_back:
        raise UsageError(
            "--read-back",
            expected=message("with-option", option=message("loaded-files")),
            found=message("none"),
        )
    if not beside:
        raise UsageError(
            "verify",
            expected=message(
                "either-option", one=message("control-files"), other="--diagonal"
            ),
            found=message("neither"),
        )
    if as_json:
        typer.echo(json.dumps(_diagonals_json(beside), indent=2))
        return
    for each in beside:
        print_compared(each)


def _diagonals_json(beside: "list[Compared]") -> dict[str, object]:
    return (
        {"diagonals": [{**each._asdict(), "largest_um": each.largest_um} for each in beside]}
        if beside
        else {}
    )


def tables_among(paths: list[Path]) -> "tuple[tuple[ControlFile, ...], tuple[str, ...]]":
    """Return the active files, and the names of the ignored files (notes, and restore files beside
    their originals).

    A folder stands for all files that an export wrote into the folder. Raises DataError for a file
    of no control, or without any file for a control. Raises SafetyError for a changed set.
    """
    from stepdiag.exporters.export.written import REPORT
    from stepdiag.exporters.files.naming import is_restore
    from stepdiag.exporters.files.sets import SUMS, read_given
    from stepdiag.exporters.linuxcnc import kinematics
    from stepdiag.exporters.linuxcnc.read_back import NAMES as READ_BACK_HAL
    from stepdiag.exporters.profiles.registry import CONTROLLERS
    from stepdiag.exporters.siemens.read_back import NAME as READ_BACK
    from stepdiag.exporters.tables import lattice

    def acts(file: "ControlFile") -> bool:
        known = lattice.recognises(file) or any(
            control.recognises(file) for control in CONTROLLERS.values()
        )
        return file.name not in (
            REPORT,
            SUMS,
            kinematics.SOURCE,
            kinematics.HAL,
            READ_BACK,
            *READ_BACK_HAL,
        ) and (known or not file.name.lower().endswith(".txt"))

    read = read_given(paths)
    acting = [file for file in read if acts(file)]
    new = [file for file in acting if not is_restore(file.name)]
    used = tuple(new or acting)
    if not used:
        raise DataError(
            ", ".join(map(str, paths)),
            expected=message("control-files"),
            found=", ".join(file.name for file in read) or message("folder-without-files"),
            remedy=message("give-export-folder"),
        )
    return used, tuple(file.name for file in read if file not in used)


def _verification_json(
    found: "Verification", given: "Sequence[ControlFile]", aside: "Sequence[str]"
) -> dict[str, object]:
    from stepdiag.base.result.typed import written as json_of

    return {
        "controller": found.controller,
        "files": [_file_json(file) for file in given],
        "left_aside": list(aside),
        "verdict": found.verdict,
        "tables": [each.as_json() for each in found.judgements],
        "findings": [finding.as_json() for finding in found.findings],
        "predicted": json_of(found.prediction.predicted),
    }


def _draw(found: "Verification", drawn: "Prediction", out: Path) -> None:
    from stepdiag.base.files import write_atomically
    from stepdiag.conclusion import reach_of
    from stepdiag.report.drawings.effect import SUFFIXES, TITLE, drawing_file, effect_drawing

    suffix = out.suffix.lower()
    if suffix not in SUFFIXES:
        raise UsageError(
            "--out",
            expected=message("file-named", endings=[f"*{suffix}" for suffix in SUFFIXES]),
            found=out.name,
        )
    reach = reach_of(found.prediction.predicted)
    language = viewers_language()
    drawing = drawing_file(
        effect_drawing(drawn, reach, language), suffix, shown(TITLE), language
    )
    write_atomically(out, drawing.encode("utf-8"))


def _print_verification(
    found: "Verification",
    given: "Sequence[ControlFile]",
    aside: "Sequence[str]",
    measured_with: str,
    *,
    verbose: bool,
) -> None:
    from rich.console import Console

    from stepdiag.terminal.tables import effect_table, print_findings

    names = [file.name for file in given]
    print_words(
        message(
            "files-read-as", controller=found.controller, names=names, state=measured_with
        )
    )
    if aside:
        print_words(message("files-left-aside", names=list(aside)))
    Console().print(effect_table(found.prediction))
    for each in sorted(found.judgements, key=lambda judgement: judgement.harmless):
        mark = "" if each.harmless else shown(message("mark-wrong")) + " "
        print_words(f"{mark}{each.code}: {shown(each.words)}")
    print_findings(found.findings, verbose=verbose)
    if verbose:
        for kind, law in dict.fromkeys((table.kind, table.law) for table in found.tables):
            print_words(message("labelled", name=kind, what=law.words))


def _caution(measured: "Result", prediction: "Prediction") -> None:
    unknown: list[Words] = [
        message("scale-of", axis=axis)
        for axis, scale in measured.scale.items()
        if not scale.identified
    ]
    unknown += [name for name, function in measured.errors.items() if function.value is None]
    if unknown:
        print_words(message("not-in-figures", names=unknown))
    if prediction.worse:
        mark, what = message("mark-warning"), message("errs-more")
        print_words(f"{shown(mark)} worse-after: {shown(what)}")
