"""The report as one self-contained HTML file that depends on no network, no other file and no
clock."""

import base64
import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import jinja2

from stepdiag.base.conformity import together
from stepdiag.base.readings.readings import Readings
from stepdiag.base.result.members import VOLUME, StandardFigures
from stepdiag.base.result.result import Result
from stepdiag.conclusion import (
    STATES,
    Conclusion,
    Sentence,
    conclude,
    conclusion_document,
    render,
    titles_of,
    words_of,
)
from stepdiag.report import certificate, measured, sections
from stepdiag.report.certificate import AsLeft, Letterhead
from stepdiag.report.drawings.figure import Figure, data_link
from stepdiag.report.drawings.figures import (
    closure_figures,
    field_figures,
    function_figures,
)
from stepdiag.report.exported import Exported
from stepdiag.report.laboratory import Laboratory
from stepdiag.solver.methods import standard_figures
from stepdiag.solver.methods.lengths import at_their_temperature
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.model.reported import SCALE_SUM
from stepdiag.texts.texts import Language, catalogue, localised

_BETWEEN = re.compile(r"(<(?:td|th|text|li|p|h3|figcaption|title)(?: [^<>]*)?>)([^<>]+)<")
"""Pattern of a text for a person, with the tag before the text."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    html: str
    figures: tuple[Figure, ...]


def build_report(  # noqa: PLR0913  # what a report is made of
    result: Result,
    *,
    source: str,
    exported: Sequence[Exported] = (),
    readings: Readings | None = None,
    conclusion: Conclusion | None = None,
    letterhead: Letterhead | None = None,
    left: AsLeft | None = None,
    laboratory: Laboratory | None = None,
    sha256: str = "",
    language: Language = "en",
) -> Report:
    """Return the report of a result; ``source`` is the name of the result's file in the report.
    ``laboratory`` contains the number of the certificate on every page, and the signatory.
    ``sha256`` is the hash of the result's file, by default that of the result as written by this
    version.

    With readings, the report also shows the measured values. The prediction is drawn for the first
    export with tables. The same input gives the same bytes: no part depends on the clock, the
    computer or the order of a set.
    """
    words = {**catalogue("common", language), **catalogue("report", language)}
    known = conclusion or conclude(
        result, [one.concluded for one in exported if one.concluded is not None]
    )
    correction = next(
        (one.correction for one in exported if one.correction is not None), None
    )
    layout = measured.layout_of(readings, result) if readings is not None else None
    figures = {
        "functions": function_figures(result, words),
        "field": field_figures(result, correction, words) if result.volume.solid else [],
        "measured": measured.setup_figures(layout, words, language)
        if layout is not None
        else [],
        "closure": closure_figures(result, words),
    }
    standards = _standards(result, layout, readings)
    digest = sha256 or hashlib.sha256(result.to_json().encode()).hexdigest()
    number = "" if laboratory is None else laboratory.certificate.number
    tables = {
        "facts": certificate.facts_table(result, words, laboratory),
        "effect": certificate.effect_table(result, known.reach, left, words, language),
        "budget": sections.budget_table(result, _units(result), words),
        "signatures": certificate.signatures(laboratory, words),
        "machine": sections.machine_table(result, words),
        "conditions": sections.conditions_table(result, readings, words),
        "setups": sections.setups_table(result, words, language),
        "squareness": sections.squareness_table(result, words),
        "scale": sections.scale_table(result, words),
        "lengths": sections.lengths_table(result, words),
        "positioning": sections.positioning_table(standards, words, language),
        "positioning_lengths": sections.positioning_lengths(standards, words),
        "vdi": sections.vdi_table(standards, words, language),
        "head": sections.head_table(result, words),
        "fit": sections.fit_table(result, words),
        "assumptions": sections.assumptions_table(result, words, language),
        "slips": sections.slips_table(result, words, language),
        "history": sections.history_table(result, words, language),
        "recordings": sections.recordings_table(result, words),
    }
    html = template("template.html").render(
        **page_parts(number),
        number=number,
        digest=digest,
        **tables,
        **figures,
        language=language,
        words=words,
        source=source,
        result=result,
        exported=exported,
        unidentified=sections.unidentified(result, words),
        remarks=sections.remarks(result, words, language),
        concluded=_with_left(words_of(conclusion_document(known), language), left, language),
        titles=titles_of(language),
        predicted=correction is not None,
        chi=sections.chi_square_words(result, words),
        letterhead=letterhead or Letterhead(),
        left=left,
    )
    return Report(
        html=localised_document(html, language),
        figures=tuple(figure for group in figures.values() for figure in group),
    )


def _each_once(concluded: dict[str, list[str]], language: Language) -> dict[str, list[str]]:
    firsts = tuple(
        catalogue("conclusion", language)[f"verdict_{state}"].partition("{")[0]
        for state in STATES
    )
    return {
        **concluded,
        "verdict": [
            sentence for sentence in concluded["verdict"] if sentence.startswith(firsts)
        ],
    }


def _with_left(
    concluded: dict[str, list[str]], left: AsLeft | None, language: Language
) -> dict[str, list[str]]:
    concluded = _each_once(concluded, language)
    if left is None:
        return concluded
    verdict = Sentence(key=f"verdict_{together(one.verdict for one in left.judged)}")
    again = (
        [render(Sentence(key="verdict_as_left", arguments={"verdict": verdict}), language)]
        if left.judged
        else []
    )
    return {
        **concluded,
        "verdict": [*concluded["verdict"], *again],
        "load": [],
        "next_step": [],
    }


def localised_document(html: str, language: Language) -> str:
    """Return the document with the numbers between its tags in the notation of a language; styles,
    scripts and hashes stay unchanged."""
    if language == "en":
        return html
    return _BETWEEN.sub(lambda found: f"{found[1]}{localised(found[2], language)}<", html)


def _standards(
    result: Result, layout: Layout | None, readings: Readings | None
) -> Mapping[str, Sequence[StandardFigures]]:
    if result.standards or layout is None or readings is None:
        return result.standards or {}
    return standard_figures.standards_report(
        layout, at_their_temperature(readings, None, "readings")
    )


def page_parts(number: str = "") -> dict[str, str]:
    """Return the style sheet and the script of the document, and their hashes for the document's
    content policy.

    ``number`` is the number of the certificate, printed at the head of every page.
    """
    head = (
        f"@page {{ @top-left {{ content: '{_css_text(number)}'; font: 8pt sans-serif; }} }}\n"
        if number
        else ""
    )
    style, script = _part("report.css") + head, _part("report.js")
    return {
        "style": style,
        "style_hash": _source_hash(style),
        "script": script,
        "script_hash": _source_hash(script),
    }


def _css_text(text: str) -> str:
    return "".join(
        each if each.isalnum() and each.isascii() else f"\\{ord(each):06x}" for each in text
    )


def _units(result: Result) -> dict[str, str]:
    functions = {name: function.unit for name, function in result.errors.items()}
    quantities = {name: quantity.unit for name, quantity in result.squareness.items()}
    return {
        **functions,
        **quantities,
        SCALE_SUM: "um",
        VOLUME: "um",
        **{axis: scale.unit for axis, scale in result.scale.items()},
    }


def _part(name: str) -> str:
    return files("stepdiag.report").joinpath(name).read_text(encoding="utf-8")


def _source_hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


@cache
def template(name: str) -> jinja2.Template:
    """Return a template of this package; all its values are escaped except the drawings of this
    package."""
    loader = jinja2.FunctionLoader(_part)
    environment = jinja2.Environment(
        loader=loader,
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["data_link"] = data_link
    environment.filters["shown"] = sections.shown
    return environment.get_template(name)
