"""The report as chromium prints it."""

import re
import shutil
from pathlib import Path

import pytest

from stepdiag.report.document import build_report
from stepdiag.report.output import print_pdf, write_report
from testkit.exact.madeup import made_up_result


@pytest.mark.page
def test_the_report_prints_as_pdf(tmp_path: Path) -> None:
    """Chromium prints it on A4 pages, offline."""
    assert shutil.which("chromium"), "chromium is needed: apt-get install chromium"
    document, *_ = write_report(build_report(made_up_result(), source="r"), tmp_path / "report.html")
    pdf = print_pdf(document).read_bytes()
    assert pdf.startswith(b"%PDF-")
    assert re.search(rb"/MediaBox \[0 0 59[45][.\d]* 84[12]", pdf)
