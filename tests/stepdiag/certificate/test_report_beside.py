"""The report beside a certificate: rendered again to the byte, and its print as PDF/A-3 with the
certificate attached."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pikepdf
import pytest
from pypdf import PdfReader

from stepdiag.base.readings.readings import render_readings
from stepdiag.certificate.archival import archival
from testkit.cli import stepdiag
from testkit.exact.surveys import Bench
from testkit.examples import spread
from testkit.forgeries import rehashed, solve_once

LABORATORY = (
    '[certificate]\nnumber = "2026-0042"\nbegun = 2026-05-30\nended = '
    '2026-05-31\n[laboratory]\nname = "Lab"\n'
)
LETTERHEAD = 'company = "Lab"\naddress = "Street 1"\n'
TOLERANCE = "[tolerance]\nvolumetric_rms_um = 20.0\nsquareness_urad = 30.0\n"
SETTINGS = ("--laboratory", "laboratory.toml", "--letterhead", "letterhead.toml")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Readings, result, export, report, certificate and the PDF of both."""
    folder = tmp_path_factory.mktemp("report")
    readings = Bench(seed=3, increments=2).survey(passes=(1, 2), joined=True)
    for name, text in (
        ("readings.csv", render_readings(readings)),
        ("laboratory.toml", LABORATORY),
        ("letterhead.toml", LETTERHEAD),
        ("tolerance.toml", TOLERANCE),
    ):
        (folder / name).write_text(text, encoding="utf-8")
    done(
        folder,
        "solve",
        "readings.csv",
        "--tolerance",
        "tolerance.toml",
        "--out",
        "result.json",
    )
    done(
        folder,
        "export",
        "result.json",
        "--controller",
        "linuxcnc",
        "--step-mm",
        "50",
        "--out",
        "exports",
    )
    report(folder)
    done(
        folder,
        "certificate",
        "result.json",
        "exports",
        *SETTINGS,
        "--report",
        "report.html",
        "--pdf",
        "c.pdf",
        "--out",
        "c.xml",
    )
    return folder


def at(folder: Path, words: tuple[str, ...]) -> list[object]:
    return [folder / word if "." in word or word == "exports" else word for word in words]


def done(folder: Path, *words: str) -> None:
    told = stepdiag(*at(folder, words))
    assert told.code == 0, told.refusal


def report(folder: Path, *more: str) -> None:
    done(folder, "report", "result.json", "exports", *SETTINGS, *more, "--out", "report.html")


@pytest.fixture(autouse=True)
def solved_once(monkeypatch: pytest.MonkeyPatch) -> None:
    solve_once(monkeypatch)


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    return shutil.copytree(made, tmp_path / "case")


def test_report_and_pages_hold_and_nothing_is_left_behind(folder: Path) -> None:
    before = sorted(folder.rglob("*"))
    for name in ("c.xml", "c.pdf"):
        told = stepdiag("verify", folder / name)
        assert (told.code, "is correct" in told.out) == (0, True), told.out
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize(
    "more", [("--language", "de"), ("--readings", "readings.csv")], ids=["german", "readings"]
)
def test_report_in_other_words_is_of_the_same_result(
    folder: Path, more: tuple[str, ...]
) -> None:
    report(folder, *more)
    done(
        folder,
        "certificate",
        "result.json",
        "exports",
        *SETTINGS,
        "--report",
        "report.html",
        "--out",
        "d.xml",
    )
    assert stepdiag("verify", folder / "d.xml").code == 0


def _altered(old: str, new: str) -> Callable[[str], str]:
    return lambda text: text.replace(old, new, 1)


FORGERIES = {
    "a figure": _altered(" ± ", " ± 0"),
    "a verdict": _altered("conform (", "not conform ("),
    "a name": _altered("Street 1", "Street 2"),
    "a remark": _altered("</main>", "<!-- passed --></main>"),
    "a sentence": _altered("</main>", "<p>The machine conforms.</p></main>"),
    "a language": _altered('lang="en"', 'lang="de"'),
}


@pytest.mark.parametrize("name", spread([*FORGERIES], 2))
def test_altered_report_is_refused_and_found(name: str, folder: Path) -> None:
    """Nobody gets a certificate for it, and a certificate whose hash was altered too does not
    hold."""
    path = folder / "report.html"
    before, text = path.read_bytes(), path.read_text(encoding="utf-8")
    assert FORGERIES[name](text) != text
    path.write_text(FORGERIES[name](text), encoding="utf-8", newline="")
    told = stepdiag(
        *at(
            folder,
            (
                "certificate",
                "result.json",
                "exports",
                *SETTINGS,
                "--report",
                "report.html",
                "--out",
                "d.xml",
            ),
        )
    )
    assert (told.code, (folder / "d.xml").exists()) == (3, False)
    rehashed(folder, before, "report.html")
    told = stepdiag("verify", folder / "c.xml")
    assert (told.code, "report report.html: this file differs from" in told.out) == (
        5,
        True,
    ), told.out


@pytest.mark.parametrize(
    "name", spread(["report.xhtml", "report.HTM", "report", "report.svg"], 2)
)
def test_forged_report_by_another_name_is_no_report(name: str, folder: Path) -> None:
    text = (folder / "report.html").read_text(encoding="utf-8")
    (folder / name).write_text(text.replace(" ± ", " ± 0", 1), encoding="utf-8")
    settings = at(folder, SETTINGS)
    told = stepdiag(
        "certificate",
        folder / "result.json",
        folder / "exports",
        *settings,
        "--report",
        folder / name,
        "--out",
        folder / "d.xml",
    )
    assert (told.code, (folder / "d.xml").exists()) == (3, False)


def test_letterhead_that_the_certificate_does_not_name_is_refused(folder: Path) -> None:
    told = stepdiag(
        "certificate",
        folder / "result.json",
        folder / "exports",
        "--laboratory",
        folder / "laboratory.toml",
        "--report",
        folder / "report.html",
        "--out",
        folder / "d.xml",
    )
    assert (told.code, "letterhead" in told.refusal) == (3, True)


def test_pdf_is_an_archive_by_an_independent_reader(folder: Path) -> None:
    """What ISO 19005-3 level B asks of a document like this one, read by pypdf: identification,
    colours, fonts, attachment, no secrets."""
    reader = PdfReader(folder / "c.pdf")
    assert (reader.xmp_metadata.pdfaid_part, reader.xmp_metadata.pdfaid_conformance) == (
        "3",
        "B",
    )
    assert reader.xmp_metadata.dc_title["x-default"] == reader.metadata.title
    assert (reader.is_encrypted, len(reader.trailer["/ID"])) == (False, 2)
    root = reader.trailer["/Root"]
    (intent,) = root["/OutputIntents"]
    assert (intent["/S"], intent["/DestOutputProfile"]["/N"]) == ("/GTS_PDFA1", 3)
    assert intent["/DestOutputProfile"].get_data()[36:40] == b"acsp"
    assert not {"/AA", "/OpenAction", "/JavaScript"} & {*root, *root["/Names"]}
    assert reader.attachments["c.xml"] == [(folder / "c.xml").read_bytes()]
    (attached,) = root["/AF"]
    assert (attached["/AFRelationship"], attached["/F"], attached["/UF"]) == (
        "/Alternative",
        "c.xml",
        "c.xml",
    )
    assert attached["/EF"]["/F"]["/Subtype"] == "/text/xml"
    assert attached["/EF"]["/F"]["/Params"]["/ModDate"] == "D:20260531000000Z"
    fonts = [font for page in reader.pages for font in page["/Resources"]["/Font"].values()]
    assert fonts
    for font in fonts:
        (inside,) = font["/DescendantFonts"]
        assert {"/FontFile2", "/FontFile3"} & set(inside["/FontDescriptor"])
        assert inside["/CIDToGIDMap"] == "/Identity"
    for page in reader.pages:
        assert all(note["/F"] & 4 for note in page.get("/Annots", ()))
        assert "/AA" not in page
    text = " ".join(page.extract_text() for page in reader.pages)
    assert "2026-0042" in text
    assert "C0Y" in text


def test_pages_of_another_report_are_found(folder: Path) -> None:
    """The right certificate in a PDF with other pages: a figure drawn over, a page left out,
    another print."""
    whole = (folder / "c.pdf").read_bytes()
    with pikepdf.open(folder / "c.pdf") as document:
        del document.pages[-1]
        document.save(folder / "short.pdf")
    with pikepdf.open(folder / "c.pdf") as document:
        document.pages[0].contents_add(b"0 0 100 100 re f")
        document.save(folder / "drawn.pdf")
    for name in ("short.pdf", "drawn.pdf"):
        told = stepdiag("verify", folder / name)
        assert (told.code, "the pages of the PDF differ" in told.out) == (5, True), told.out
    with pikepdf.open(folder / "c.pdf") as document:
        document.docinfo.Producer = "Another"
        document.save(folder / "another.pdf")
    told = stepdiag("verify", folder / "another.pdf")
    assert (told.code, "printed by Another" in told.out) == (5, True)
    flipped = bytearray(whole)
    flipped[whole.index(b"pdfaid:part") + 3] ^= 1
    (folder / "c.pdf").write_bytes(flipped)
    assert stepdiag("verify", folder / "c.pdf").code == 5


@pytest.mark.parametrize("data", [b"", b"%PDF-1.7", b"<xml/>"])
def test_other_files_are_no_pdf_with_a_certificate(data: bytes, tmp_path: Path) -> None:
    (tmp_path / "c.pdf").write_bytes(data)
    assert stepdiag("verify", tmp_path / "c.pdf").code == 3


def test_print_without_attachment_or_font_is_refused(folder: Path) -> None:
    done(folder, "report", "result.json", "--out", "plain.pdf")
    assert stepdiag("verify", folder / "plain.pdf").code == 3
    with pikepdf.open(folder / "plain.pdf") as document:
        font = next(
            one
            for one in document.objects
            if isinstance(one, pikepdf.Dictionary) and one.get("/Type") == "/FontDescriptor"
        )
        del font["/FontFile2"]
        document.save(folder / "poor.pdf")
    with pytest.raises(Exception, match="fonts"):
        archival((folder / "poor.pdf").read_bytes(), "c.xml", b"")


def test_an_equal_file_of_another_export_does_not_change_the_report(folder: Path) -> None:
    """Its folder comes first by its name; the report names the folder of each file."""
    name = next(path.name for path in sorted((folder / "exports").iterdir()))
    (folder / "earlier").mkdir()
    shutil.copy(folder / "exports" / name, folder / "earlier" / name)
    told = stepdiag("verify", folder / "c.xml")
    assert told.code == 0, told.out
