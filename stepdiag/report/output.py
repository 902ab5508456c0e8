"""Writing of a report: HTML, its figures as CSV, and a PDF if chromium is installed."""

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from stepdiag.base.errors import DeviceError
from stepdiag.base.files import refuse_file_name, write_atomically, write_together
from stepdiag.base.messages import message
from stepdiag.report.document import Report

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
PRINT_TIMEOUT_S = 120.0
"""Longest time in s for the browser to print."""


def write_report(report: Report, out: Path, *, pdf: bool = False) -> list[Path]:
    """Write the report and return the written files.

    An ``out`` with the ending ``.html`` is the HTML file, which contains its figures as CSV links.
    An ``out`` with the ending ``.pdf`` is the printed document. Any other ``out`` is a folder for
    ``report.html`` and ``figures/<name>.csv``. With ``pdf`` the PDF is written beside the HTML. The
    HTML and its figures are written together or not at all. Raises UsageError if ``out`` is an
    existing file, DeviceError for a PDF if chromium is missing or fails.
    """
    if out.suffix.lower() == ".pdf" and not out.is_dir():
        write_atomically(out, printed(report.html.encode()))
        return [out]
    alone = out.suffix.lower() in {".html", ".htm"}
    if not alone:
        refuse_file_name(out, "FILE.html, FILE.pdf, or a folder")
    document = out if alone else out / "report.html"
    files = {document: report.html.encode()}
    if not alone:
        files |= {
            out / "figures" / f"{figure.name}.csv": figure.table.encode()
            for figure in report.figures
        }
    write_together(files, over=True)
    return [*files, *([print_pdf(document)] if pdf else [])]


def printed(html: bytes) -> bytes:
    """Return an HTML file printed as PDF; no file stays on the disk. Raises the DeviceError of
    `print_pdf`."""
    with tempfile.TemporaryDirectory(prefix="stepdiag-print-") as folder:
        document = Path(folder) / "report.html"
        document.write_bytes(html)
        return print_pdf(document).read_bytes()


def browser() -> str | None:
    return next((found for name in BROWSERS if (found := shutil.which(name))), None)


def print_pdf(document: Path) -> Path:
    """Print an HTML file to a PDF beside it, without network and with a temporary browser profile;
    return the path of the PDF."""
    program = browser()
    if program is None:
        raise DeviceError(
            "--pdf",
            expected="chromium",
            found=message("none"),
            remedy=message("print-from-browser"),
        )
    target = document.with_suffix(".pdf")
    with tempfile.TemporaryDirectory(prefix="stepdiag-print-") as profile:
        draft = Path(profile) / "report.pdf"
        command = [
            program,
            *_switches(profile),
            f"--print-to-pdf={draft}",
            document.resolve().as_uri(),
        ]
        try:
            done = subprocess.run(
                command, capture_output=True, timeout=PRINT_TIMEOUT_S, check=False
            )
        except subprocess.TimeoutExpired as why:
            raise DeviceError(
                program,
                expected=message("pdf-within", seconds_s=PRINT_TIMEOUT_S),
                found=message("none"),
                remedy=message("print-from-browser"),
            ) from why
        if not draft.is_file():
            lines = done.stderr.decode(errors="replace").strip().splitlines()
            found = lines[-1] if lines else message("exit-code", code=done.returncode)
            raise DeviceError(
                program,
                expected=message("a-pdf"),
                found=found,
                remedy=message("print-from-browser"),
            )
        write_atomically(target, draft.read_bytes())
    return target


def _switches(profile: str) -> list[str]:
    quiet = [
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        "--no-first-run",
        "--disable-quic",
    ]
    sandbox = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    return [
        "--headless",
        "--disable-gpu",
        f"--user-data-dir={profile}",
        "--no-pdf-header-footer",
        *quiet,
        *sandbox,
    ]
