"""The report as chromium prints it: what a customer holds in his hands, page by page."""

from collections.abc import Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pypdfium2 as pdfium
import pytest

from stepdiag.base.result.result import Result
from stepdiag.conclusion import conclude
from stepdiag.exporters.export.export import export
from stepdiag.report.as_left import build_as_left
from stepdiag.report.certificate import as_left
from stepdiag.report.document import build_report
from stepdiag.report.exported import exported_of
from stepdiag.report.output import print_pdf, write_report
from stepdiag.solver.methods.solve import solve
from stepdiag.texts.texts import LANGUAGES, Language, catalogue
from testkit.exact.madeup import made_up_result
from testkit.exact.members import members
from testkit.exact.surveys import Bench

A4_PT = (595, 842)
HALF = 0.6
"""Of a page's height: a page before the last one that ends above it is a half-empty one."""
SURVEY = {
    "customer": "Gebr. Kunde",
    "machine": "VM 500",
    "machine_serial": "M-4711",
    "survey": "spring 2026",
    "operator": "A. Bediener",
    "begun": "2026-01-01 08:00 UTC",
    "ended": "2026-01-01 10:12 UTC",
    "date": "2026-01-01",
    "instrument": "XD 1",
    "instrument_serial": "L-0815",
    "instrument_certificate": "K-2026-7",
    "wavelength_nm": 632.991,
    "compensation": "off",
    "active_files": [],
}
"""What page 1 has to say, as a survey file says it."""


@pytest.fixture(scope="module")
def measured() -> tuple[Result, object]:
    readings = Bench(increments=4, angle_urad=3.0).survey()
    return replace(solve(readings), **members(survey=SURVEY)), readings


def printed(page: pdfium.PdfPage) -> float:
    """Return where the last thing on a page stands, as a share of its height."""
    pixels = page.render(scale=0.5, grayscale=True).to_numpy()
    rows = np.nonzero((pixels < 200).any(axis=1))[0]
    return float(rows[-1] + 1) / len(pixels) if len(rows) else 0.0


def pages_of(document: Path) -> tuple[list[str], list[float]]:
    """Return of each page as chromium prints it what it says, and where the last thing on it
    stands; every one is A4."""
    pdf = pdfium.PdfDocument(print_pdf(document))
    try:
        pages = list(pdf)
        assert {tuple(round(side) for side in page.get_size()) for page in pages} == {A4_PT}
        return [" ".join(page.get_textpage().get_text_bounded().split()) for page in pages], [
            printed(page) for page in pages
        ]
    finally:
        pdf.close()


def torn(texts: Sequence[str], *tables: Sequence[str]) -> list[Sequence[str]]:
    """Return the tables whose rows stand on no page all together."""
    return [
        rows for rows in tables if not any(all(row in text for row in rows) for text in texts)
    ]


@pytest.mark.page
@pytest.mark.parametrize("language", LANGUAGES)
def test_the_certificates_last_page(
    tmp_path: Path, measured: tuple[Result, object], language: Language
) -> None:
    """Verdict and effect on page 1, no table torn and no page half empty, however many files were
    loaded."""
    before, _ = measured
    out, accept, today = tmp_path / "files", ("slope-steep",), date(2026, 1, 1)
    exported = exported_of(
        export(before, "siemens", None, step_mm=25.0, accept=accept, out_dir=out, today=today)
    )
    assert exported.concluded is not None
    concluded = conclude(before, [exported.concluded])
    left = as_left("after.json", conclude(before), concluded.reach)
    page = build_as_left(
        before, before, left, concluded, exported=[exported], language=language
    )
    document, *_ = write_report(page, tmp_path / "left.html")
    texts, filled = pages_of(document)
    words = catalogue("report", language)
    assert [
        text
        for text in (words["as_left_title"], words["left_gain_same"], words["predicted"])
        if text not in texts[0]
    ] == []
    assert torn(texts, ("C0Y", "B0Z", "A0Z"), [file.name for file in exported.files]) == [], (
        texts
    )
    assert min([1.0, *filled[:-1]]) > HALF, filled


@pytest.mark.page
@pytest.mark.parametrize("language", LANGUAGES)
def test_the_report_page_by_page(
    tmp_path: Path, measured: tuple[Result, object], language: Language
) -> None:
    """A4, no half-empty page, page 1 says who, what, with what and how it ends; what U rests on is
    said once; figures can be read."""
    result, readings = measured
    document, *_ = write_report(
        build_report(result, source="r.json", readings=readings, language=language),
        tmp_path / "report.html",
    )
    texts, filled = pages_of(document)
    assert 6 <= len(texts) <= 9, texts
    assert torn(texts, ("C0Y", "B0Z", "A0Z"), ("ppp", "npp", "pnp", "ppn")) == []
    assert min(filled[:-1]) > HALF, filled
    said = [
        str(value)
        for name, value in SURVEY.items()
        if name not in ("compensation", "active_files", "date", "wavelength_nm")
    ]
    words = catalogue("conclusion", language)
    headings = [words[name] for name in ("reached", "wrong", "load", "next_step")]
    assert [text for text in (*said, *headings) if text not in texts[0]] == []
    assert "632,991" in texts[0] if language == "de" else "632.991" in texts[0]
    assert sum(text.count("[uncertainty]") for text in texts) == 1


@pytest.mark.page
def test_a_table_that_goes_on_has_its_head_again_and_no_row_torn(tmp_path: Path) -> None:
    """The one table that may go on over pages, longer than two of them and each row some lines
    high: every row is whole on one page."""
    names = [f"R{row:02d}" for row in range(24)]
    by = "ISO 230-6 " + "steps one after the other " * 9
    rows = {
        name: [
            {
                "standard": f"{name}a {by} {name}z",
                "source_status": "",
                "runs": 5,
                "E": 10.0 + row,
                "U": {"E": 1.0},
                "lengths": "as measured",
            }
        ]
        for row, name in enumerate(names)
    }
    document, *_ = write_report(
        build_report(made_up_result(standards=rows), source="r.json"),
        tmp_path / "report.html",
    )
    texts, _ = pages_of(document)
    held = [[name for name in names if name in text] for text in texts]
    over = [page for page, found in enumerate(held) if found]
    assert len(over) > 2
    assert sorted(name for found in held for name in found) == names, (
        "every row stands on one page"
    )
    for page in over:
        assert [
            name
            for name in held[page]
            if not {f"{name}a", f"{name}z"} <= set(texts[page].split())
        ] == []
        assert "Setup By Runs E / µm" in texts[page], (
            "the head stands above the rows of every page"
        )


def test_a_report_named_as_a_pdf_is_one(
    tmp_path: Path, measured: tuple[Result, object]
) -> None:
    """`report --out x.pdf`: the print alone, under that name, and no folder."""
    written = write_report(
        build_report(measured[0], source="result.json"), tmp_path / "x.pdf"
    )
    assert written == [tmp_path / "x.pdf"]
    assert list(tmp_path.iterdir()) == written
    assert written[0].read_bytes().startswith(b"%PDF-")
