"""Every figure that is printed in two places is the same in both."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.conformity import with_tolerance
from stepdiag.base.result.interval import with_expanded
from stepdiag.base.result.result import Quantity
from stepdiag.certificate.figures import figures_of
from stepdiag.conclusion import conclude, conclusion_document, words_of
from stepdiag.report.certificate import effect_table
from stepdiag.report.sections import scale_table, squareness_table
from stepdiag.terminal.tables import quantity_table
from stepdiag.texts.texts import LANGUAGES, Language, catalogue, localised
from testkit.exact.madeup import made_up_result


@given(
    st.lists(st.floats(-200.0, 200.0), min_size=3, max_size=3),
    st.floats(0.02, 60.0),
    st.floats(0.5, 300.0),
    st.sampled_from(LANGUAGES),
)
def test_every_printed_figure_agrees(
    values: list[float], u: float, tolerance: float, language: Language
) -> None:
    """A squareness and a scale in the report's tables, the table of figures, the verdict, the
    conclusion, the basis and the certificate: one value and one U each, and every printed value
    within its printed interval."""
    squareness = {
        name: Quantity(value=value, u=u)
        for name, value in zip(("C0Y", "B0Z", "A0Z"), values, strict=True)
    }
    result = with_tolerance(
        replace(made_up_result(), squareness=squareness), {"squareness_urad": tolerance}
    )
    words = {**catalogue("common", language), **catalogue("report", language)}
    concluded = conclude(result)
    figure = with_expanded(values[0], 2.0 * u).replace("-", "−")
    value, _, expanded = figure.partition(" ± ")
    assert squareness_table(result, words).rows[0][2:4] == (value, expanded)
    rows = {
        row[0].partition(" /")[0]: row
        for row in effect_table(result, concluded.reach, None, words, language).rows
    }
    assert rows["C0Y"][1] == figure
    spoken = words_of(conclusion_document(concluded), language)
    shown_figure = localised(figure, language)
    assert any(f"C0Y: {shown_figure} µrad" in sentence for sentence in spoken["verdict"])
    for sentence in spoken["wrong"]:
        if "C0Y" in sentence:
            assert f" {localised(value.lstrip('−'), language)} µrad" in sentence
    for scale in result.scale.values():
        if scale.value is not None and scale.u is not None:
            printed = with_expanded(scale.value, 2.0 * scale.u).replace("-", "−")
            assert [" ± ".join(row[1:3]) for row in scale_table(result, words).rows].count(
                printed
            ) >= 1
    terminal = quantity_table(result)
    assert [
        next(iter(column.cells)).replace("-", "−") for column in terminal.columns[1:3]
    ] == [
        value,
        expanded,
    ]
    in_si = {one.name: one for one in figures_of(result)}["C0Y"]
    ascii_value = value.replace("−", "-")
    assert abs(float(in_si.values[0]) * 1e6 - float(ascii_value)) <= 0.5000001 * 10.0 ** -len(
        ascii_value.partition(".")[2]
    )
    for interval in (concluded.reach.rms_before, concluded.reach.largest_before):
        low, high = interval.shown()
        assert low == "" or float(low) <= float(interval.best()) <= float(high)
