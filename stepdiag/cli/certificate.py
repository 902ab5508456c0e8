"""``stepdiag certificate``: a result as a digital calibration certificate; and the verification of
a certificate."""

from pathlib import Path
from typing import Annotated

import typer

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.cli.fleet import extra_needed
from stepdiag.terminal.viewer import print_words

JUDGED_WRONG, UNDECIDED = 5, 3
MOST_CERTIFICATES = 100
"""Largest number in the file names of a survey's certificates."""


def register(app: typer.Typer) -> None:
    app.command("certificate")(certificate)


def certificate(
    result: Path,
    files: Annotated[list[Path] | None, typer.Argument()] = None,
    out: Path = Path("certificate.xml"),
    laboratory: Path | None = None,
    after: Annotated[Path | None, typer.Option("--as-left")] = None,
    report: Annotated[Path | None, typer.Option("--report")] = None,
    letterhead: Path | None = None,
    profile: Path | None = None,
    pdf: Path | None = None,
    key: Path | None = None,
    key_certificate: Path | None = None,
) -> None:
    """Write a result as a calibration certificate."""
    from stepdiag.certificate.written import Beside, write_certificate
    from stepdiag.cli.report import read_result, result_file

    if out.suffix.lower() != ".xml":
        raise UsageError(
            "--out", expected=message("file-named", endings=["*.xml"]), found=str(out)
        )
    if (key is None) != (key_certificate is None):
        raise UsageError(
            "--key, --key-certificate", expected=message("both"), found=message("one-of-both")
        )
    files = [
        path
        for each in files or ()
        for path in ([each] if each.is_file() else sorted(each.rglob("*")))
        if path.is_file()
    ]
    if pdf is not None and (report is None or report.suffix.lower() not in {".html", ".htm"}):
        raise UsageError(
            "--pdf",
            expected=message("with-option", option="--report FILE.html"),
            found=message("none"),
        )
    if pdf is not None and pdf.suffix.lower() != ".pdf":
        raise UsageError(
            "--pdf", expected=message("file-named", endings=["*.pdf"]), found=str(pdf)
        )
    left = None if after is None else result_file(after)
    beside = Beside(
        laboratory=laboratory,
        files=files,
        report=report,
        letterhead=letterhead,
        profile=profile,
        left=left,
        key=key,
        key_certificate=key_certificate,
    )
    found = read_result(result)
    links = write_certificate(result_file(result), found, out, beside, pdf)
    print_words(message("certificate-rests", path=str(out), count=links))


def certify_folder(folder: Path) -> Path:
    """Write the certificate of a finished survey beside its logs; return its path.

    The certificate contains the files of every export. A separate report (``certificate.html``) is
    written too. Certificate and report contain the data of ``laboratory.toml`` in the folder of the
    survey or the folder above it. If a certificate exists, the new file name gets a number.
    """
    from stepdiag.base.files import read_text
    from stepdiag.base.result.result import result_in
    from stepdiag.certificate.reports import language_of
    from stepdiag.certificate.written import Beside, write_certificate
    from stepdiag.daq.records.survey_folder import RESULT
    from stepdiag.report.from_files import ReportFiles, report_from
    from stepdiag.report.output import write_report

    laboratory = next(
        (
            path
            for at in (folder, folder.parent)
            if (path := at / "laboratory.toml").is_file()
        ),
        None,
    )
    files = [path for path in sorted((folder / "exports").rglob("*")) if path.is_file()]
    names = (
        "certificate.xml",
        *(f"certificate-{number}.xml" for number in range(2, MOST_CERTIFICATES)),
    )
    out = next(
        (folder / name for name in names if not (folder / name).exists()), folder / names[-1]
    )
    completed = folder / "report.html"
    language = language_of(read_text(completed)) if completed.is_file() else "en"
    made = report_from(
        ReportFiles(result=folder / RESULT, laboratory=laboratory, language=language)
    )
    (report,) = write_report(made, out.with_suffix(".html"))
    result = folder / RESULT
    beside = Beside(laboratory=laboratory, files=files, report=report)
    write_certificate(result, result_in(result), out, beside)
    return out


def verify_file(path: Path, custody: str, key_certificate: Path | None = None) -> None:
    """Verify a certificate and print its first broken link. A broken link gives exit code 5.

    ``custody`` is the folder with the sources or the address of a store, by default the folder of
    the certificate.
    """
    from stepdiag.certificate.custody import verify_archived, verify_certificate

    archived = path.suffix.lower() == ".pdf"
    if archived and (is_store(custody) or key_certificate is not None):
        raise UsageError(path.name, expected=message("archived-in-folder"), found=custody)
    if key_certificate is not None:
        from stepdiag.certificate.signature import require_signature

        require_signature(path, key_certificate)
    if is_store(custody):
        with extra_needed("fleet"):
            from stepdiag.fleet.custody import verify_in_store
        found = verify_in_store(path, custody)
    else:
        found = (verify_archived if archived else verify_certificate)(
            path, Path(custody or path.parent)
        )
    if found.broken is not None:
        print_words(message("certificate-wrong", name=path.name, what=found.broken))
        raise typer.Exit(JUDGED_WRONG)
    print_words(
        message("certificate-holds", name=path.name, links=found.links, figures=found.figures)
    )
    if found.signed and key_certificate is None:
        print_words(message("signature-unchecked"))


def is_store(custody: str) -> bool:
    """Return whether a path is a store: a folder with the mark file of a store, or an address of a
    remote file system."""
    return "://" in custody or (Path(custody) / "stepdiag-store.json").is_file()
