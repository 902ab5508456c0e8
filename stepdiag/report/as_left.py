"""The last page of the report: the machine measured again after loading, with the predicted and the
measured errors and their U."""

from collections.abc import Mapping, Sequence

from stepdiag.base.result.result import Result
from stepdiag.conclusion import Conclusion
from stepdiag.report import certificate
from stepdiag.report.certificate import AsLeft, Letterhead
from stepdiag.report.document import Report, localised_document, page_parts, template
from stepdiag.report.exported import Exported
from stepdiag.report.sections import Table
from stepdiag.texts.texts import Language, catalogue


def build_as_left(
    before: Result,
    after: Result,
    left: AsLeft,
    concluded: Conclusion,
    *,
    exported: Sequence[Exported] = (),
    letterhead: Letterhead | None = None,
    language: Language = "en",
) -> Report:
    """Return the last page. ``concluded`` is the conclusion before loading, ``exported`` are the
    loaded files."""
    words = {**catalogue("common", language), **catalogue("report", language)}
    html = template("as_left.html").render(
        **page_parts(),
        language=language,
        words=words,
        source=before.source,
        result=after,
        left=left,
        exported=exported,
        facts=certificate.facts_table(after, words),
        effect=certificate.effect_table(before, concluded.reach, left, words, language),
        changes=_changes(before, after, words),
        letterhead=letterhead or Letterhead(),
    )
    return Report(html=localised_document(html, language), figures=())


def _changes(before: Result, after: Result, words: Mapping[str, str]) -> Table:
    rows = [
        (name, certificate.with_u(q), certificate.with_u(after.squareness[name]), "µrad")
        for name, q in before.squareness.items()
    ]
    return Table(
        header=(words["name"], words["as_found"], words["as_left"], words["unit"]), rows=rows
    )
