"""The report: whole, alone, escaped, the same bytes each time, and true to the result."""

import base64
import csv
import hashlib
import io
import re
from dataclasses import replace
from datetime import date
from hashlib import sha256
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from stepdiag.base.compensation import Statement, stated
from stepdiag.base.conformity import with_tolerance
from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.findings import Finding
from stepdiag.base.readings.readings import Readings, parse_readings
from stepdiag.base.result.field import error_field_um
from stepdiag.base.result.interval import with_expanded
from stepdiag.base.result.members import SetupReport, Source
from stepdiag.base.result.result import Result
from stepdiag.cli.app import build
from stepdiag.cli.report import read_result
from stepdiag.comparing.compare import require_alike
from stepdiag.conclusion import conclude
from stepdiag.report.certificate import as_left, effect_table, facts_table, read_letterhead
from stepdiag.report.document import build_report
from stepdiag.report.drawings import svg
from stepdiag.report.drawings.charts import ticks
from stepdiag.report.drawings.figure import Figure
from stepdiag.report.drawings.figures import field_of
from stepdiag.report.drawings.space import LATTICE, lattice_mm, view_matrix
from stepdiag.report.exported import Exported, ExportedFile
from stepdiag.report.laboratory import Equipment, Head, Item, Laboratory, Person, Place
from stepdiag.report.measured import layout_of, setup_figures
from stepdiag.report.output import write_report
from stepdiag.report.sections import budget_table, conditions_table
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.methods.standard_figures import standards_report
from stepdiag.solver.model.reported import SCALE_SUM, backlash, reversal, shape, sloped
from stepdiag.texts.texts import LANGUAGES, Language, catalogue
from testkit.catalogue import SECTIONS
from testkit.exact.madeup import VOLUME, made_up_result
from testkit.exact.members import members
from testkit.exact.surveys import solved


class Outline(HTMLParser):
    """What a browser would see: tags, addresses and text."""

    VOID = frozenset({"meta", "br", "link", "input"})

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.addresses: list[str] = []
        self.open: list[str] = []
        self.words = ""
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.addresses += [
            value or "" for name, value in attrs if name in {"src", "href", "xlink:href"}
        ]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words += data


def test_the_report_needs_nothing_else() -> None:
    """One file: no address but the CSV inside it, one script and one style sheet, admitted by their
    hashes."""
    html = build_report(made_up_result(), source="result.json").html
    outline = Outline(html)
    assert outline.open == []
    assert all(address.startswith("data:text/csv") for address in outline.addresses)
    assert outline.tags.count("script") == outline.tags.count("style") == 1
    assert "default-src 'none'" in html


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_same_result_gives_the_same_bytes(language: str) -> None:
    """No clock, no order of a set, no address of the machine goes into it."""
    first, second = (
        build_report(made_up_result(), source="result.json", language=language)
        for _ in range(2)
    )
    assert first.html == second.html
    assert f'<html lang="{language}">' in first.html


HOSTILE = "<script>alert(1)</script>\"'&<img src=x onerror=alert(1)>"


def test_what_a_stranger_wrote_stays_text() -> None:
    """Markup in any free text of a result, of a file name or of the source comes out as text."""
    result = made_up_result(
        survey={"machine": HOSTILE, "operator": [HOSTILE]},
        conditions={HOSTILE: {HOSTILE: HOSTILE}},
        budget={"shares": {HOSTILE: {HOSTILE: 1.0}}, "assumptions": {HOSTILE: HOSTILE}},
    )
    hostile = Finding(code=HOSTILE, severity="error", text=HOSTILE)
    result.setups[HOSTILE] = SetupReport(kind=HOSTILE)
    object.__setattr__(result, "findings", (hostile,))
    exported = [
        Exported(
            controller=HOSTILE,
            files=(ExportedFile(name=HOSTILE, size_bytes=1, sha256=HOSTILE),),
        )
    ]
    outline = Outline(build_report(result, source=HOSTILE, exported=exported).html)
    assert outline.tags.count("script") == 1
    assert "img" not in outline.tags
    assert outline.words.count(HOSTILE) > 8


FOREIGN = (
    3,
    "x",
    [1],
    {"shares": 1, "diagonals": 1, "x": 1},
    {"shares": {"EXX": 3}},
    {"shares": {"EXX": {"reading": "much"}}},
    {"x": [1, "y"]},
)


@pytest.mark.parametrize("value", FOREIGN)
def test_foreign_extras_are_left_out(value: object) -> None:
    """Entries that the contract does not fix may hold anything; the report is written all the
    same."""
    extras = dict.fromkeys(
        ("survey", "conditions", "budget", "fit", "closure_um", "scale_sum_um"), value
    )
    assert "<h1>" in build_report(made_up_result(**extras), source="r").html


def test_every_figure_says_its_numbers() -> None:
    """The CSV of a function holds its values and standard uncertainties to a femtometre, inside the
    HTML too."""
    result = made_up_result()
    report = build_report(result, source="r")
    figure = next(one for one in report.figures if one.name == "EYX")
    rows = list(csv.DictReader(io.StringIO(figure.table)))
    np.testing.assert_allclose(
        [float(row["EYX_um"]) for row in rows], result.errors["EYX"].value, rtol=0, atol=1e-9
    )
    np.testing.assert_allclose(
        [float(row["u_um"]) for row in rows], result.errors["EYX"].u, rtol=0, atol=1e-9
    )
    inside = [
        base64.b64decode(address.split(",")[1]).decode()
        for address in Outline(report.html).addresses
    ]
    assert inside == [one.table for one in report.figures]
    assert {"EXX", "field-before"} <= {one.name for one in report.figures}


KINDS = (sloped, shape, reversal, backlash)


def drawn_points(figure: Figure) -> int:
    """Return how many values the CSV of a figure has in its drawing: slices draw three of five
    layers."""
    rows = list(csv.DictReader(io.StringIO(figure.table)))
    if figure.name.endswith("-slices"):
        return len(rows) * 3 // LATTICE
    return max(len(rows), figure.drawing.count('class="dot'))


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_figure_says_its_values_under_the_pointer_and_as_csv(
    language: Language,
) -> None:
    """Whatever is drawn in the document has a value at each of its points, in the numbers of the
    language, and its CSV beside it."""
    result, readings = golden()
    result = replace(result, **members(closure_um={"x": [0.0, 1.0, 2.0]}))
    exported = [Exported(controller="siemens", files=(), correction=np.zeros_like)]
    report = build_report(
        result, source="r", readings=readings, exported=exported, language=language
    )
    kinds = {one.name.split("-")[0] for one in report.figures}
    assert {"EXX", "field", "setup", "closure"} <= kinds
    shown = re.findall(r'<figure id="figure-([^"]+)">(.*?)</figure>', report.html, re.DOTALL)
    figures = {one.name: one for one in report.figures}
    assert sorted(name for name, _ in shown) == sorted(figures)
    assert len(shown) == report.html.count("<svg"), "nothing is drawn outside a figure"
    for name, markup in shown:
        said = re.findall(r'class="titled"[^>]*><title>([^<]+)</title>', markup)
        assert len(said) == drawn_points(figures[name]) > 0, name
        assert all(re.search(r"\d", words) for words in said), name
        assert f'download="{name}.csv" href="data:text/csv' in markup
    ids = re.findall(r'\sid="([^"]*)"', report.html)
    assert len(ids) == len(set(ids)) >= len(figures), "no name stands twice"
    assert [one for one in ids if not one or re.search(r"\s", one)] == []
    referred = re.findall(
        r'\s(?:href="#|aria-(?:labelledby|describedby|controls)="|for=")([^"]*)"', report.html
    )
    assert set(" ".join(referred).split()) <= set(ids)
    told = next(markup for name, markup in shown if name == "EYX")
    assert ("± 0," in told or "± 1," in told) == (language == "de")


@pytest.mark.parametrize("language", LANGUAGES)
def test_budget_is_one_table_of_three_largest_sources(language: Language) -> None:
    """U is twice the root of the sum of squares; each source stands with its share of the square of
    U."""
    sources = {"reading": 0.4, "air": 0.3, "drift": 0.1, "wander": 0.05}
    budget = {
        "shares": dict.fromkeys(
            ("EXX", "X", SCALE_SUM, *(kind("EXX") for kind in KINDS)), sources
        )
    }
    result = replace(made_up_result(), **members(budget=budget))
    words = {**catalogue("common", language), **catalogue("report", language)}
    table = budget_table(result, {"EXX": "um", "X": "um/m", SCALE_SUM: "um"}, words)
    assert table is not None
    english = {
        "sloped EXX",
        "shape EXX",
        "reversal EXX",
        "backlash EXX",
        "scale of X",
        "scale sum",
    }
    assert english & {row[0] for row in table.rows} == (
        english if language == "en" else set()
    )
    assert sorted(row[1] for row in table.rows) == sorted(
        ["1.0 µm"] * (2 + len(KINDS)) + ["1.0 µm/m"]
    )
    assert {
        tuple(re.sub(r"\D+", " ", cell).strip() for cell in row[2:]) for row in table.rows
    } == {("61", "34", "4")}
    assert budget_table(made_up_result(), {}, words) is None


LABORATORY = Laboratory(
    certificate=Head(number="2026/'0042\\"),
    customer=Place(name="Works"),
    person=(Person(name="M. Muster", role="head"), Person(name="B")),
    equipment=(Equipment(name="laser", serial="L-17"), Equipment(name="PTU300")),
)


@pytest.mark.parametrize("language", LANGUAGES)
def test_report_to_be_signed_names_number_persons_and_what_is_not_stated(
    language: Language,
) -> None:
    words = catalogue("report", language)
    html = build_report(
        made_up_result(), source="r", laboratory=LABORATORY, language=language
    ).html
    seen = Outline(html).words
    for text in (
        "2026/'0042\\",
        "M. Muster",
        "head",
        "Works",
        "L-17",
        "PTU300",
        words["approval"],
        words["signature"],
    ):
        assert text in seen
    assert seen.count(words["compensation_unstated"]) >= 3, (
        "serial number, operator, role of B"
    )
    assert "content: '2026\\00002f\\0000270042\\00005c'" in html, (
        "no character of the number ends the string of the style"
    )
    assert hashlib.sha256(made_up_result().to_json().encode()).hexdigest() in seen


def test_report_states_who_and_what_as_the_certificate_does() -> None:
    """What the laboratory's file states stands in place of what the survey file states; a laser
    without a certificate has none."""
    survey = {
        "machine": "virtual",
        "customer": "Shop",
        "instrument": "old laser",
        "instrument_certificate": "D 1",
        "sensors": "hand-held",
    }
    words = {**catalogue("common", "en"), **catalogue("report", "en")}
    rows = dict(
        facts_table(
            made_up_result(survey=survey),
            words,
            Laboratory(
                item=Item(name="Mill 7"),
                customer=LABORATORY.customer,
                equipment=LABORATORY.equipment,
            ),
        ).rows
    )
    names = ("machine", "customer", "instrument", "instrument_certificate", "sensors")
    assert [rows[words[name]].strip() for name in names] == [
        "Mill 7",
        "Works",
        "laser",
        "not stated",
        "PTU300",
    ]
    rows = dict(facts_table(made_up_result(survey=survey), words).rows)
    assert [rows[words[name]] for name in names] == list(survey.values())


def test_report_without_a_laboratory_has_room_for_a_signature_and_no_number() -> None:
    html = build_report(made_up_result(), source="r").html
    assert "@top-left" not in html
    assert "not stated" in Outline(html).words


def test_every_state_stands_beside_its_tolerance(tmp_path: Path) -> None:
    """As found, predicted, as left, tolerance, verdict: one row a figure; the printed largest
    vector is that of the interval alone."""
    before = with_tolerance(
        solved(1), {"volumetric_rms_um": 5.0, "squareness_urad": 20.0, "EYX": 3.0}
    )
    later = with_tolerance(
        solved(2), {"volumetric_rms_um": 5.0, "squareness_urad": 20.0, "EYX": 3.0}
    )
    concluded = conclude(before)
    left = as_left("later", conclude(later), concluded.reach, later)
    words = {**catalogue("common", "en"), **catalogue("report", "en")}
    table = effect_table(before, concluded.reach, left, words, "en")
    assert table is not None
    assert [len(row) for row in table.rows] == [6] * len(table.rows)
    by_name = {row[0].partition(" /")[0]: row for row in table.rows}
    rms = by_name["Volumetric error, rms (k = 2)"]
    assert (rms[1], rms[4]) == (
        " … ".join(before.predicted.without_rigid_motion["before"].rms_um.shown()),
        "5",
    )
    assert rms[5].replace("\N{NO-BREAK SPACE}", " ") == (
        "as found: not conform (< 1 %); predicted: conform (> 99 %); as left: not conform (< 1 %)"
    )
    expanded = 2.0 * before.squareness["C0Y"].u
    assert by_name["C0Y"][2] == with_expanded(0.0, expanded)
    assert by_name["C0Y"][3] == with_expanded(
        later.squareness["C0Y"].value, 2 * later.squareness["C0Y"].u
    ).replace("-", "−")
    assert "Range of EYX" in by_name
    plain = effect_table(solved(1), conclude(solved(1)).reach, None, words, "en")
    assert plain is not None
    assert {len(row) for row in plain.rows} == {4}, (
        "without a tolerance there is no word of it"
    )
    html = build_report(before, source="r", left=left).html
    assert re.search(r"worst [0-9]", html) is None


def test_what_a_pointer_finds_is_what_was_computed() -> None:
    """At a node of a function: position, value and U (k = 2), never a minus nought; at a corner of
    the volume: place, vector and length."""
    result = made_up_result(amplitude_um=8.0, u_um=0.4)
    function = result.errors["EYX"]
    assert function.value is not None
    assert function.u is not None
    report = {one.name: one for one in build_report(result, source="r").figures}
    at, value, u = function.position_mm[3], function.value[3], function.u[3]
    assert f"X = {at:.5g} mm, EYX = {value:.2f} ± {2 * u:.2f} µm" in report["EYX"].drawing
    assert "X = 500 mm, EYX = 0.00 ± 0.00 µm" in report["EYX"].drawing
    first = next(csv.DictReader(io.StringIO(report["field-before"].table)))
    vector = [float(first[name]) for name in ("dx_um", "dy_um", "dz_um")]
    parts = "; ".join(svg.fixed(part) for part in vector)
    words = f"X; Y; Z = 0; 0; -300 mm: {parts} µm, |E| = {np.linalg.norm(vector):.2f} µm"
    assert words in report["field-before"].drawing
    assert words in report["field-before-slices"].drawing


def test_the_band_is_twice_the_standard_uncertainty() -> None:
    """On a chart 20 µm high, a u of 0.4 µm at the middle spans 1.6 µm from edge to edge."""
    report = build_report(made_up_result(amplitude_um=8.0, u_um=0.4), source="r")
    drawing = next(one.drawing for one in report.figures if one.name == "EYX")
    band = re.search(r'<path d="M([^Z"]+)Z" class="band', drawing)
    assert band is not None
    points = np.array([[float(v) for v in pair.split(" ")] for pair in band[1].split("L")])
    upper, lower = points[:11], points[:10:-1]
    pixels_per_um = (250 - 38 - 14) / 20
    assert lower[5, 1] - upper[5, 1] == pytest.approx(4 * 0.4 * pixels_per_um, abs=0.02)


def test_the_prediction_is_what_the_tables_leave() -> None:
    """A control that takes away 80 % of the error leaves a fifth of it; the rigid motion counts for
    nothing."""
    result = made_up_result()

    def four_fifths(points: np.ndarray) -> np.ndarray:
        return -0.8 * error_field_um(result, points) + np.array([3.0, -2.0, 1.0])

    field = field_of(result, four_fifths)
    before, after = (
        np.linalg.norm(field[when], axis=1) for when in ("before_um", "after_um")
    )
    assert after.max() == pytest.approx(before.max() / 5)
    html = build_report(
        result,
        source="r",
        exported=[Exported(controller="siemens", files=(), correction=four_fifths)],
    ).html
    assert "figure-field-after" in html


def golden() -> tuple[Result, Readings]:
    """Return the golden separable survey (reference data, section 11 of the theory) and its
    result."""
    path = Path(__file__).parents[2] / "data" / "golden_stepdiag_separable.csv"
    readings = parse_readings(path.read_text(encoding="utf-8"), path.name)
    return solve(readings, method="least-squares"), readings


def test_figures_of_the_standards_stand_in_the_report_with_their_uncertainty() -> None:
    """On the points of each step diagonal, one run outward: E_up is the range of reading less way;
    the machine's figure is the largest."""
    result, readings = golden()
    figures = standards_report(layout_of(readings, result))
    for name in ("ppp", "npp", "pnp", "ppn"):
        rows = [
            row
            for row, setup in enumerate(readings.setup)
            if setup == name and readings.stop[row] % 3 == 0
        ]
        way = np.linalg.norm(
            readings.position_mm[rows] - readings.position_mm[rows[0]], axis=1
        )
        assert figures[name][0].E_up == pytest.approx(
            np.ptp(readings.reading_mm[rows] - way) * 1e3, abs=1e-6
        )
    html = build_report(result, source="r", readings=readings).html
    for name in ("ppp", "npp", "pnp", "ppn"):
        assert with_expanded(figures[name][0].E_up, figures[name][0].U["E_up"]) in html
    assert "on step diagonals (axes one after the other)" in html


def test_the_readings_are_drawn_with_the_return_hung_on() -> None:
    """Out and back: the return pass starts where the outward pass ended, and ends at its own
    reversal."""
    result, readings = golden()
    rows = [row for row, setup in enumerate(readings.setup) if setup == "ppp"]
    back = rows[::-1]
    returned = replace(
        readings,
        setup=(*readings.setup, *("ppp" for _ in back)),
        pass_number=np.concatenate([readings.pass_number, np.full(len(back), 2)]),
        stop=np.concatenate([readings.stop, np.arange(len(back))]),
        position_mm=np.vstack([readings.position_mm, readings.position_mm[back]]),
        reading_mm=np.concatenate(
            [readings.reading_mm, readings.reading_mm[back] - readings.reading_mm[rows[-1]]]
        ),
        **{
            name: np.concatenate([getattr(readings, name), getattr(readings, name)[back]])
            for name in ("u_um", "temperature_c", "time_s", "zero", "turned")
        },
        beam_mm=np.vstack([readings.beam_mm, readings.beam_mm[back]]),
    )
    figure = next(
        one
        for one in setup_figures(layout_of(returned, result), catalogue("report", "en"), "en")
        if one.name == "setup-ppp"
    )
    there, back_again = (
        re.findall(rf'class="line s{order}"', figure.drawing) for order in (0, 1)
    )
    assert len(there) == len(back_again) == 2
    paths = re.findall(r'<path d="M([^"]+)" class="line s[01]"/>', figure.drawing)[:2]
    assert paths[0].split("L") == paths[1].split("L")[::-1]


def test_conditions_are_ranges_and_each_is_said_once() -> None:
    """The result carries least and largest; where it does, the readings' own temperatures do not
    repeat it."""
    _, readings = golden()
    readings = replace(readings, temperature_c=np.linspace(21.0, 23.0, len(readings.stop)))
    told = {"material_temperature_c": [21.0, 23.0], "air_pressure_hpa": [1013.0, 1013.0]}
    pressure = ("air pressure / hPa", "1013.00")
    for conditions, rows in ((told, [pressure]), ({}, [])):
        table = conditions_table(
            made_up_result(conditions=conditions), readings, catalogue("report", "en")
        )
        assert sorted(row for row in table.rows if "temp" in row[0] or "press" in row[0]) == [
            *rows,
            ("material temperature / °C", "21.00 … 23.00"),
        ]


def test_what_is_not_identified_is_said_and_not_drawn() -> None:
    """A null squareness, scale or function is named; none is printed as a number."""
    result = made_up_result()
    result.squareness["C0Y"] = type(result.squareness["C0Y"])(value=None, u=None)
    result.errors["EYX"] = type(result.errors["EYX"])(
        position_mm=VOLUME.nodes_mm(0), value=None, u=None, unit="um"
    )
    report = build_report(result, source="r")
    words = Outline(report.html).words
    assert "EYX" not in {one.name for one in report.figures}
    for named in ("C0Y (Y to X)", "EYX", "Scale X", "angular errors not measured: EAX"):
        assert named in words


def test_the_lattice_is_seen_from_the_front() -> None:
    """Z points up on the sheet, X to the right, and the points reach both ends of the volume."""
    right, up = view_matrix()
    assert right[0] > 0.5
    assert up[2] > 0.5
    points = lattice_mm(VOLUME, 3)
    np.testing.assert_allclose(points[[0, -1]], [[0, 0, -300], [500, 400, 0]])


@pytest.mark.parametrize(
    ("low", "high"), [(0.0, 1.0), (-7.3, 12.9), (0.0, 1e-4), (-2e5, 3.0), (4.0, 4.001)]
)
def test_ticks_cover_the_range_with_round_steps(low: float, high: float) -> None:
    """1, 2 or 5 times a power of ten, between 4 and 12 of them."""
    marks = ticks(low, high)
    step = marks[1] - marks[0]
    assert marks[0] <= low + 1e-9 * abs(low)
    assert marks[-1] >= high - 1e-9 * abs(high)
    assert 4 <= len(marks) <= 12
    assert float(f"{step:.0e}"[0]) in {1, 2, 5}


def test_the_catalogue_speaks_both_languages() -> None:
    """Every entry has both languages, and both fill in the same names."""
    for section in SECTIONS:
        english, german = (catalogue(section, language) for language in LANGUAGES)
        assert english.keys() == german.keys()
        for key, words in english.items():
            assert sorted(re.findall(r"\{\w+\}", words)) == sorted(
                re.findall(r"\{\w+\}", german[key])
            ), key


def test_the_command_writes_a_folder(tmp_path: Path) -> None:
    """``report RESULT FILE --out DIR`` writes the HTML and every figure, and lists the file with
    its hash."""
    (tmp_path / "result.json").write_text(made_up_result().to_json(), encoding="utf-8")
    (tmp_path / "EEC.SPF").write_bytes(b"abc")
    done = CliRunner().invoke(
        build(),
        [
            "report",
            str(tmp_path / "result.json"),
            str(tmp_path / "EEC.SPF"),
            "--out",
            str(tmp_path / "out"),
        ],
    )
    assert done.exit_code == 0, done.output
    html = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad" in html
    assert (tmp_path / "out" / "figures" / "EXX.csv").is_file()


@pytest.mark.parametrize("data", [b"\xff\xfe", b"{}", b"[1]", b"[" * 100_000])
def test_a_foreign_result_is_refused(tmp_path: Path, data: bytes) -> None:
    """A file from somebody else can at worst be refused."""
    (tmp_path / "r.json").write_bytes(data)
    with pytest.raises(DataError):
        read_result(tmp_path / "r.json")


def survey_facts(**more: str) -> dict[str, str]:
    """Return what a survey says of itself."""
    return {
        "machine": "VM 500",
        "customer": "Werk Süd",
        "operator": "A",
        "instrument": "laser",
        "instrument_serial": "17",
        **more,
    }


def test_the_first_page_says_who_what_and_with_what() -> None:
    """Customer, machine, instrument, conventions and the volume as found, predicted and as left
    stand before everything else."""
    html = build_report(made_up_result(survey=survey_facts()), source="r").html
    first = html[html.index("<main>") : html.index("Error functions")]
    for word in (
        "Werk Süd",
        "VM 500",
        "17",
        "actual - commanded",
        "ISO 230-1:2012",
        "as found",
        "predicted",
        "as left",
        "not measured yet",
    ):
        assert word in first


def test_a_german_report_writes_commas_and_keeps_versions_and_hashes() -> None:
    """Numbers between tags get a comma; software, file names and hashes do not."""
    listed = ExportedFile(name="AX.1.5.INI", size_bytes=12, sha256="0.5" + "a" * 61)
    html = build_report(
        made_up_result(),
        source="r.1.2.json",
        exported=[Exported(controller="siemens", files=(listed,))],
        language="de",
    ).html
    assert "<td>20,00</td>" in html
    assert "0.1.0" in html
    assert listed.sha256 in html


def test_a_wavelength_keeps_its_digits() -> None:
    """633 nm is another laser than 632.991 nm: a certificate says what was used."""
    result = made_up_result(survey={"machine": "VM 500", "wavelength_nm": 632.991})
    rows = facts_table(
        result, {**catalogue("common", "en"), **catalogue("report", "en")}
    ).rows
    assert "632.991" in [row[1] for row in rows]


def test_the_annex_lists_the_sources_with_their_hashes(tmp_path: Path) -> None:
    """Those that the result names, wherever they stand; a result that names none has no such
    table."""
    result = made_up_result()
    assert "<h3>Sources</h3>" not in build_report(result, source="result.json").html
    sources = tuple(
        Source(role="log", name=f"000{count}.mcap", sha256=str(count) * 64)
        for count in (1, 2)
    )
    html = build_report(replace(result, sources=sources), source="result.json").html
    assert (
        0
        < html.index("0001.mcap")
        < html.index("1" * 64)
        < html.index("0002.mcap")
        < html.index("2" * 64)
    )


def test_as_left_states_predicted_against_measured(tmp_path: Path) -> None:
    """The survey after loading closes the certificate; that of another machine is refused by
    name."""
    paths = {}
    for name, amplitude, machine in (
        ("before", 8.0, "VM 500"),
        ("after", 1.0, "VM 500"),
        ("other", 1.0, "VM 700"),
    ):
        paths[name] = tmp_path / f"{name}.json"
        result = made_up_result(
            amplitude_um=amplitude, scales=True, survey=survey_facts(machine=machine)
        )
        paths[name].write_text(result.to_json(), encoding="utf-8")
    out = tmp_path / "report.html"
    run = CliRunner().invoke(
        build(),
        ["report", str(paths["before"]), "--as-left", str(paths["after"]), "--out", str(out)],
    )
    assert run.exit_code == 0, run.output
    html = out.read_text(encoding="utf-8")
    assert "Measured again after loading" in html
    assert "after.json" in html
    with pytest.raises(DataError, match="VM 700"):
        require_alike(read_result(paths["before"]), read_result(paths["other"]))


def test_conclusion_of_a_survey_after_loading_has_its_verdict_and_no_step_before_it() -> None:
    before = with_tolerance(solved(1), {"volumetric_rms_um": 1000.0})
    known = conclude(before)
    left = as_left("later", conclude(before), known.reach, before)
    alone, closed = (build_report(before, source="r", left=one).html for one in (None, left))
    assert (
        "As left, measured again: conform." in closed,
        "As left, measured again" in alone,
    ) == (
        True,
        False,
    )
    assert ("<h3>Next step</h3>" in closed, "<h3>Next step</h3>" in alone) == (False, True)
    assert (
        "as left (not measured yet)" in closed,
        "as left (not measured yet)" in alone,
    ) == (
        False,
        True,
    )


def test_a_letterhead_comes_from_a_settings_file(tmp_path: Path) -> None:
    """Company, address and logo stand in the document itself; what is no picture is refused."""
    (tmp_path / "logo.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg"/>', encoding="utf-8"
    )
    settings = tmp_path / "us.toml"
    settings.write_text(
        'company = "Messdienst"\naddress = "Weg 1\\nOrt"\nlogo = "logo.svg"\n',
        encoding="utf-8",
    )
    html = build_report(
        made_up_result(), source="r", letterhead=read_letterhead(settings)
    ).html
    assert "Messdienst" in html
    assert 'src="data:image/svg+xml;base64,' in html
    settings.write_text('logo = "us.toml"\n', encoding="utf-8")
    with pytest.raises(UsageError, match="a picture"):
        read_letterhead(settings)


@pytest.mark.parametrize(
    ("language", "off", "unstated"),
    [("en", "off", "not stated"), ("de", "aus", "nicht angegeben")],
)
def test_what_was_active_while_measuring_stands_in_the_report(
    language: str, off: str, unstated: str
) -> None:
    """State, files with their hashes, when and how they were read out; nothing where the survey
    says nothing."""
    words = {**catalogue("common", language), **catalogue("report", language)}
    said = {
        state: dict(
            facts_table(replace(made_up_result(), survey=statement.facts()), words).rows
        )[words["compensation"]]
        for state, statement in (
            ("off", Statement(state="off")),
            ("on", stated("on", {"A.INI": b"table"}, date(2026, 1, 31), "archive")),
            ("?", Statement(state="?")),
        )
    }
    assert (said["off"], said["?"]) == (off, unstated)
    assert f"A.INI (archive, 2026-01-31) SHA-256 {sha256(b'table').hexdigest()}" in said["on"]


def test_a_report_named_like_another_file_makes_no_folder(tmp_path: Path) -> None:
    """A folder is one whose name says nothing of a file."""
    with pytest.raises(
        UsageError,
        match=r"expected FILE\.html, FILE\.pdf, or a folder, found the name of a \.csv file",
    ):
        write_report(build_report(made_up_result(), source="result.json"), tmp_path / "x.csv")
    assert list(tmp_path.iterdir()) == []
    written = write_report(
        build_report(made_up_result(), source="result.json"), tmp_path / "mill.2026"
    )
    assert written[0] == tmp_path / "mill.2026" / "report.html"
