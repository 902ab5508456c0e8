"""All machines of a store on one sheet of HTML: one small multiple a machine, worst first; nothing is loaded from elsewhere."""

from collections.abc import Mapping, Sequence
from datetime import datetime
from html import escape

from stepdiag.fleet.history import Point
from stepdiag.fleet.rows import RMS
from stepdiag.fleet.terminal import as_csv
from stepdiag.fleet.trend import Trend, already_perhaps, severity
from stepdiag.report.drawings import svg
from stepdiag.report.drawings.figure import data_link
from stepdiag.texts.texts import Language, catalogue, localised

NEAR_PX = 5.0
"""How far from a survey's dot a pointer still finds its value."""
WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 300.0, 120.0, 34.0, 6.0, 8.0, 18.0
STYLE = """
body{font:14px/1.4 system-ui,sans-serif;margin:1.5rem;color:#1b1f24;background:#fff}
main{display:grid;grid-template-columns:repeat(auto-fill,minmax(20rem,1fr));gap:1rem}
article{border:1px solid #d0d7de;border-radius:6px;padding:.7rem}
article.yes{border-color:#b42318;border-width:2px}article.perhaps{border-color:#b54708}
h2{font-size:1rem;margin:0 0 .3rem;overflow-wrap:anywhere}ul{margin:.4rem 0 0;padding-left:1.1rem}
svg{width:100%;height:auto}text{font:9px system-ui,sans-serif;fill:#57606a}
.band{stroke:#1f6feb;stroke-opacity:.45;stroke-width:4}.line{fill:none;stroke:#1f6feb;stroke-width:1.4}.dot{fill:#1f6feb}
.limit{stroke:#b42318;stroke-dasharray:4 3}.step{stroke:#b54708;stroke-dasharray:2 2}.axis{stroke:#8c959f}
.titled{fill:none;pointer-events:all}article>a{color:#0550ae;font-size:.8rem}
"""


def worst_first(trends: Sequence[Trend]) -> list[tuple[str, list[Trend]]]:
    """Return the machines with their series, the worst volumetric error first; equal ones by name."""
    machines: dict[str, list[Trend]] = {}
    for each in trends:
        machines.setdefault(each.series.machine, []).append(each)
    return sorted(machines.items(), key=lambda item: (-_worst(item[1]), item[0]))


def fleet_html(trends: Sequence[Trend], source: str, language: Language) -> str:
    """Return the sheet. ``source`` names the store."""
    words = catalogue("fleet", language)
    machines = worst_first(trends)
    times = [point.time for each in trends for point in each.series.points]
    span = (min(times), max(times))
    cards = "".join(_card(machine, each, span, words, language) for machine, each in machines)
    title = escape(words["title"])
    return (
        f'<!doctype html><html lang="{language}"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        f"<title>{title}</title><style>{STYLE}</style></head><body><h1>{title}</h1>"
        f"<p>{escape(source)}: {len(machines)} {escape(words['machines'])}. "
        f"{escape(words['reading'])}</p><main>{cards}</main></body></html>\n"
    )


def _worst(trends: Sequence[Trend]) -> float:
    judged = (
        [each for each in trends if each.tolerance is not None] or [each for each in trends if each.series.quantity == RMS] or list(trends)
    )
    return max(map(severity, judged))


def _card(machine: str, trends: Sequence[Trend], span: tuple[datetime, datetime], words: Mapping[str, str], language: Language) -> str:
    shown = next((each for each in trends if each.series.quantity == RMS), trends[0])
    states = {each.outside for each in trends}
    state = next((each for each in ("yes", "perhaps") if each in states), "no")
    changes = [line for each in trends for line in _changes(each, words)]
    listed = "".join(f"<li>{escape(localised(line, language))}</li>" for line in changes) or f"<li>{escape(words['unchanged'])}</li>"
    table = f'<a download="trend.csv" href="{data_link(as_csv([shown]))}">CSV</a>'
    return f'<article class="{state}"><h2>{escape(machine)}</h2>{_chart(shown, span, words, language)}{table}<ul>{listed}</ul></article>'


def _changes(trend: Trend, words: Mapping[str, str]) -> list[str]:
    """Return what stands below the picture: the last step, the line, the date."""
    name, unit, found = trend.series.quantity, trend.series.unit, []
    if trend.steps:
        step = trend.steps[-1]
        after = f" ({step.after})" if step.after else ""
        found.append(f"{name}: {step.change:+.1f} {unit}, U {step.expanded:.1f}, {words['since']} {step.since.date()}{after}")
    if trend.line is not None:
        found.append(f"{name}: {trend.line.slope:+.1f} ± {trend.line.expanded:.1f} {unit} {words['a_year']}")
    if trend.outside == "yes":
        found.append(f"{name}: {words['outside']} {trend.tolerance:g} {unit}")
    elif already_perhaps(trend):
        found.append(f"{name}: {words['perhaps']} {trend.tolerance:g} {unit}")
    elif trend.leaving is not None and trend.leaving.likely is not None:
        edges = [words["never"] if at is None else str(at.date()) for at in (trend.leaving.earliest, trend.leaving.latest)]
        found.append(f"{name}: {words['leaves']} {trend.leaving.likely.date()} ({edges[0]} – {edges[1]})")
    return found


def _chart(trend: Trend, span: tuple[datetime, datetime], words: Mapping[str, str], language: Language) -> str:
    points = trend.series.points
    low, high = _range(points, trend.tolerance)
    seconds = max((span[1] - span[0]).total_seconds(), 1.0)

    def x(moment: datetime) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * (moment - span[0]).total_seconds() / seconds

    def y(value: float) -> float:
        return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * (value - low) / (high - low)

    def rule(y_px: float, kind: str) -> str:
        return svg.element("line", x1=LEFT, x2=WIDTH - RIGHT, y1=y_px, y2=y_px, class_=kind)

    marks = [
        svg.element("line", x1=x(p.time), x2=x(p.time), y1=y(p.value - 2 * p.u), y2=y(p.value + 2 * p.u), class_="band")
        for p in points
        if p.u is not None
    ]
    steps = [svg.element("line", x1=x(s.since), x2=x(s.since), y1=TOP, y2=HEIGHT - BOTTOM, class_="step") for s in trend.steps]
    dots = [svg.element("circle", cx=x(point.time), cy=y(point.value), r=1.8, class_="dot") for point in points]
    values = [svg.titled(_value(trend, point, language), "circle", cx=x(point.time), cy=y(point.value), r=NEAR_PX) for point in points]
    line = svg.element("path", d=svg.path((x(point.time), y(point.value)) for point in points), class_="line")
    limit = [rule(y(trend.tolerance), "limit")] if trend.tolerance is not None and low <= trend.tolerance <= high else []
    ends = [svg.text(f"{span[0].date()}", LEFT, HEIGHT - 4), svg.text(f"{span[1].date()}", WIDTH - RIGHT, HEIGHT - 4, text_anchor="end")]
    edges = [svg.text(f"{value:.3g}", LEFT - 4, y(value) + 3, text_anchor="end") for value in (low, high)]
    label = f"{trend.series.machine}: {trend.series.quantity} / {trend.series.unit}, {words['over_time']}"
    return svg.drawing(WIDTH, HEIGHT, label, rule(HEIGHT - BOTTOM, "axis"), *limit, *steps, *marks, line, *dots, *ends, *edges, *values)


def _value(trend: Trend, point: Point, language: Language) -> str:
    """Return what a pointer finds at a survey: its day and name, its figure with U."""
    expanded = "" if point.u is None else f" ± {svg.fixed(2 * point.u)}"
    figure = localised(f"{trend.series.quantity} = {svg.fixed(point.value)}{expanded} {trend.series.unit}", language)
    return f"{point.time.date()}, {point.survey}: {figure}"


def _range(points: Sequence[Point], tolerance: float | None) -> tuple[float, float]:
    edges = [point.value + sign * 2 * (point.u or 0.0) for point in points for sign in (-1, 1)]
    low, high = min(0.0, *edges), max(0.0, *edges, tolerance or 0.0)
    return low, high if high > low else low + 1.0
