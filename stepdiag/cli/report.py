"""``stepdiag report`` and ``stepdiag compare``."""

import json
import shlex
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.cli.completion import AsJson, languages
from stepdiag.cli.granted import say_granted
from stepdiag.terminal.viewer import language_named, print_words, viewers_language

if TYPE_CHECKING:
    from stepdiag.base.result.result import Result
    from stepdiag.conclusion import Conclusion
    from stepdiag.report.certificate import AsLeft
    from stepdiag.report.exported import Exported


def register(app: typer.Typer) -> None:
    app.command("report")(report)
    app.command("compare")(compare)


def report(
    result: Path,
    files: Annotated[list[Path] | None, typer.Argument()] = None,
    out: Path = Path("report.html"),
    readings: Path | None = None,
    profile: Path | None = None,
    after: Annotated[Path | None, typer.Option("--as-left")] = None,
    letterhead: Path | None = None,
    laboratory: Path | None = None,
    pdf: Annotated[bool, typer.Option("--pdf")] = False,
    language: Annotated[str, typer.Option(autocompletion=languages)] = "en",
    as_json: AsJson = False,
) -> None:
    """Write the readable report of a result."""
    from stepdiag.report.from_files import ReportFiles, report_from
    from stepdiag.report.output import write_report

    chosen = language_named(language)
    if profile is not None and not files:
        raise UsageError(
            "--profile",
            expected=message("with-option", option=message("files-of-export")),
            found=message("none"),
        )
    found = read_result(result)
    if after is not None:
        _require_alike(found, read_result(after))
    made_of = ReportFiles(
        result=result_file(result),
        files=files or (),
        profile=profile,
        left=None if after is None else result_file(after),
        letterhead=letterhead,
        laboratory=laboratory,
        readings=readings,
        language=chosen,
    )
    built = report_from(made_of)
    written = write_report(built, out, pdf=pdf)
    if as_json:
        typer.echo(json.dumps({"written": [str(path) for path in written]}))
    else:
        more = message("more-files", path=str(written[0]), count=len(written) - 1)
        print_words(
            message("report-written", what=more if len(written) > 1 else str(written[0]))
        )


def _require_alike(before: "Result", after: "Result") -> None:
    from stepdiag.comparing.compare import require_alike, require_same_volume

    require_alike(before, after)
    require_same_volume(before, after)


def _as_left(before: "Result", exported: "list[Exported]", after: "Result") -> "AsLeft":
    from stepdiag.conclusion import conclude
    from stepdiag.report.certificate import as_left

    _require_alike(before, after)
    return as_left(after.source, conclude(after), _concluded(before, exported).reach, after)


def result_file(path: Path) -> Path:
    """Return the path of a result: the given file, or the result's file in the given folder of a
    survey."""
    from stepdiag.daq.records.survey_folder import RESULT

    return path / RESULT if path.is_dir() else path


def _concluded(before: "Result", exported: "list[Exported]") -> "Conclusion":
    from stepdiag.conclusion import conclude

    return conclude(before, [one.concluded for one in exported if one.concluded is not None])


def read_result(path: Path, name: str = "") -> "Result":
    """Return the result in a file or in the folder of a survey. Error messages contain ``name`` as
    the name of the result, by default the file name.

    Raises ``UsageError`` for a missing or unreadable file, ``DataError`` for a file that is not a
    result.
    """
    from stepdiag.base.result.result import result_in
    from stepdiag.daq.records.survey_folder import RESULT

    file = result_file(path)
    if path.is_dir() and not file.exists():
        remedy = message(
            "command-says", command=shlex.join(["stepdiag", "status", str(path)])
        )
        raise UsageError(
            str(path),
            expected=message("folder-with", what=RESULT),
            found=message("none"),
            remedy=remedy,
        )
    if {".csv", ".mcap"} & set(path.suffixes):
        remedy = message(
            "command-writes",
            command=shlex.join(["stepdiag", "solve", str(path), "--out", RESULT]),
        )
        raise UsageError(
            str(path),
            expected=message("result-in-file", name=RESULT),
            found=message("source-of-result"),
            remedy=remedy,
        )
    return result_in(file, name)


def _distinct(paths: list[Path]) -> list[str]:
    """Return the names of files. For equal names return the paths as given, because the result of
    every survey is called result.json."""
    return [
        path.name if len({other.name for other in paths}) == len(paths) else str(path)
        for path in paths
    ]


def compare(
    results: list[Path],
    loaded: Annotated[list[Path] | None, typer.Option("--loaded")] = None,
    profile: Path | None = None,
    out: Path | None = None,
    letterhead: Path | None = None,
    pdf: Annotated[bool, typer.Option("--pdf")] = False,
    language: Annotated[str, typer.Option(autocompletion=languages)] = "en",
    as_json: AsJson = False,
) -> None:
    """Print the changes between results of a machine."""
    from stepdiag.base.result.typed import written
    from stepdiag.comparing import compare as comparing
    from stepdiag.comparing.tables import which
    from stepdiag.report.exported import exported_in

    if len(results) < 2:
        raise UsageError("compare", expected=message("two-results"), found=str(len(results)))
    if profile is not None and not loaded:
        raise UsageError(
            "--profile",
            expected=message("with-option", option="--loaded"),
            found=message("no-files"),
        )
    page = {
        "--letterhead": letterhead,
        "--pdf": pdf,
        "--language": language_named(language) != "en",
    }
    if out is None and any(page.values()):
        raise UsageError(
            next(name for name, given in page.items() if given),
            expected=message("with-option", option="--out FILE.html"),
            found=message("no-report-page"),
        )
    read = [
        read_result(path, name)
        for path, name in zip(results, _distinct(results), strict=True)
    ]
    comparison = comparing.compare(read[0], read[-1])
    trends = comparing.trend(read) if len(read) > 2 else ()
    exported = [exported_in(read[0], loaded, profile)] if loaded else []
    left = _as_left(read[0], exported, read[-1]) if exported or out is not None else None
    if out is not None and left is not None:
        _write_as_left(
            read[0],
            read[-1],
            left,
            exported,
            out,
            letterhead=letterhead,
            pdf=pdf,
            language=language,
        )
    if as_json:
        changes = [
            {
                **asdict(change),
                "difference": change.difference,
                "significant": change.significant,
            }
            for change in comparison.changes
        ]
        volumetric = {
            "before_um": comparison.rms_before_um,
            "after_um": comparison.rms_after_um,
            "before": written(comparison.before),
            "after": written(comparison.after),
        }
        beside = (
            {}
            if left is None
            else {"as_left": _left_json(left, _concluded(read[0], exported))}
        )
        document = {
            "results": [{"file": one.source, **which(one)} for one in read],
            "changes": changes,
            "volumetric_rms": volumetric,
            "trend": [asdict(one) for one in trends],
            **beside,
        }
        typer.echo(json.dumps(document, indent=2))
        return
    _print(comparison, trends, read)
    if left is not None:
        _print_left(left, _concluded(read[0], exported))


def _write_as_left(
    before: "Result",
    after: "Result",
    left: "AsLeft",
    exported: "list[Exported]",
    out: Path,
    *,
    letterhead: Path | None,
    pdf: bool,
    language: str,
) -> None:
    from stepdiag.report.as_left import build_as_left
    from stepdiag.report.certificate import read_letterhead
    from stepdiag.report.output import write_report

    if out.suffix.lower() not in {".html", ".htm"}:
        raise UsageError(
            "--out", expected=message("file-named", endings=["*.html"]), found=str(out)
        )
    page = build_as_left(
        before,
        after,
        left,
        _concluded(before, exported),
        exported=exported,
        language=language_named(language),
        letterhead=read_letterhead(letterhead) if letterhead is not None else None,
    )
    for path in write_report(page, out, pdf=pdf):
        print_words(message("as-left-written", path=str(path)), err=True)


def _left_json(left: "AsLeft", concluded: "Conclusion") -> dict[str, Any]:
    predicted = None if concluded.reach is None else concluded.reach.rms_after
    return {
        "predicted_rms": None if predicted is None else asdict(predicted),
        "measured_rms": asdict(left.rms),
        "kept": left.kept,
        "gain": left.gain,
    }


def _print_left(left: "AsLeft", concluded: "Conclusion") -> None:
    from stepdiag.report.certificate import interval_words
    from stepdiag.texts.texts import catalogue

    words = catalogue("report", viewers_language())
    kept = words[{True: "left_kept", False: "left_broken", None: "left_unknown"}[left.kept]]
    predicted = None if concluded.reach is None else concluded.reach.rms_after
    print_words(
        message(
            "predicted-and-left",
            predicted=interval_words(predicted),
            left=interval_words(left.rms),
        )
    )
    print_words(f"{kept} {words[f'left_gain_{left.gain}']}")


def _print(comparison: Any, trends: Any, read: "list[Result]") -> None:
    from rich.console import Console

    from stepdiag.comparing.tables import comparison_table, sources, trend_table

    console = Console()
    names = [result.source for result in read]
    console.print(sources(read), soft_wrap=True)
    console.print(comparison_table(comparison, names[0], names[-1]))
    what = (
        message("effect-of-volume") if comparison.common.solid else message("effect-of-axes")
    )
    print_words(
        message(
            "before-then-after",
            what=what,
            before=comparison.before.words(),
            after=comparison.after.words(),
        )
    )
    for each in (*comparison.remarks, message("changed-by-chance")):
        print_words(each)
    if trends:
        console.print(trend_table(trends, names))
    say_granted(read)
