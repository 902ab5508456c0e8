"""All machines of a store on one HTML sheet without network requests: a small chart per machine,
the worst machine first."""

import math
from collections.abc import Mapping, Sequence
from datetime import datetime
from html import escape

from stepdiag.base.messages import rendered
from stepdiag.fleet.rows import RMS
from stepdiag.fleet.series import LeftOut, Point
from stepdiag.fleet.terminal import as_csv
from stepdiag.fleet.trend import Trend, already_perhaps, day, rank, statements
from stepdiag.report.drawings import svg
from stepdiag.report.drawings.figure import data_link
from stepdiag.texts.texts import UNITS, Language, catalogue, localised

NEAR_PX = 5.0
"""Largest distance in px between the pointer and a survey's dot at which the value of the survey
appears."""
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
"""  # noqa: E501


def worst_first(trends: Sequence[Trend]) -> list[tuple[str, list[Trend]]]:
    """Return the machines with their series: first the machines outside a tolerance, then the
    others by volumetric error, then by name."""
    machines: dict[str, list[Trend]] = {}
    for each in trends:
        machines.setdefault(each.series.machine, []).append(each)
    ranked = sorted(machines.items())
    return sorted(ranked, key=lambda item: _worst(item[1]), reverse=True)


def fleet_html(
    trends: Sequence[Trend], source: str, language: Language, left_out: Sequence[LeftOut] = ()
) -> str:
    """Return the sheet of a fleet; ``source`` is the name of the store."""
    words = catalogue("fleet", language)
    machines = worst_first(trends)
    times = [each.series.surveys[at].time for each in trends for at in (0, -1)]
    span = (min(times), max(times))
    cards = "".join(_card(machine, each, span, words, language) for machine, each in machines)
    title = escape(words["title"])
    return (
        f'<!doctype html><html lang="{language}"><head><meta charset="utf-8"><meta '
        'name="viewport" content="width=device-width">'
        f"<title>{title}</title><style>{STYLE}</style></head><body><h1>{title}</h1>"
        f"<p>{escape(source)}: {len(machines)} {escape(words['machines'])}. "
        f"{escape(words['reading'])}</p>{_left_out(left_out, words, language)}<main>{cards}"
        "</main></body></html>\n"
    )


def _left_out(
    left_out: Sequence[LeftOut], words: Mapping[str, str], language: Language
) -> str:
    if not left_out:
        return ""
    rows = "".join(
        f"<li>{escape(' '.join(filter(None, (each.machine, each.name))))}: "
        f"{escape(rendered(each.why, language))}</li>"
        for each in left_out
    )
    return (
        f"<details open><summary>{escape(words['left_out'])}: "
        f"{len(left_out)}</summary><ul>{rows}</ul></details>"
    )


def _worst(trends: Sequence[Trend]) -> tuple[int, float]:
    ours = [each for each in trends if each.series.other is None]
    judged = (
        [each for each in ours if each.tolerance is not None]
        or [each for each in ours if each.series.quantity == RMS]
        or list(trends)
    )
    return max(map(rank, judged))


def _card(
    machine: str,
    trends: Sequence[Trend],
    span: tuple[datetime, datetime],
    words: Mapping[str, str],
    language: Language,
) -> str:
    shown = next((each for each in trends if each.series.quantity == RMS), trends[0])
    states = {each.outside for each in trends}
    state = next((each for each in ("yes", "perhaps") if each in states), "no")
    lines = [line for each in trends for line in _picture_lines(each, words, language)]
    listed = (
        "".join(f"<li>{escape(line)}</li>" for line in lines)
        or f"<li>{escape(words['unchanged'])}</li>"
    )
    table = f'<a download="trend.csv" href="{data_link(as_csv([shown]))}">CSV</a>'
    return (
        "<article "
        f'class="{state}"><h2>{escape(machine)}</h2>{_chart(shown, span, words, language)}{table}'
        f"<ul>{listed}</ul></article>"
    )


def _picture_lines(trend: Trend, words: Mapping[str, str], language: Language) -> list[str]:
    unit = UNITS[trend.series.unit]
    name = trend.series.quantity
    if trend.series.other is not None:
        name = f"{name} ({rendered(trend.series.other, language)})"
    many = trend.verdict != "unchanged" and (
        trend.verdict == "changed" or len(trend.series.surveys) > 1
    )
    found = (
        [f"{name}: {rendered(each, language)}" for each in statements(trend)] if many else []
    )
    if trend.conformity is not None:
        found.append(
            localised(
                f"{name}: {words[trend.conformity]} {trend.tolerance:g} {unit}", language
            )
        )
    if trend.outside == "yes" or already_perhaps(trend):
        return found
    if trend.leaving is not None and trend.leaving.likely is not None:
        edges = [
            words["never"] if at is None else day(at)
            for at in (trend.leaving.earliest, trend.leaving.latest)
        ]
        found.append(
            f"{name}: {words['leaves']} {day(trend.leaving.likely)} ({edges[0]} – {edges[1]})"
        )
    return found


def _chart(
    trend: Trend,
    span: tuple[datetime, datetime],
    words: Mapping[str, str],
    language: Language,
) -> str:
    points = trend.series.points
    low, high = _range(points, trend.tolerance)
    seconds = max((span[1] - span[0]).total_seconds(), 1.0)

    def x(moment: datetime) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * (moment - span[0]).total_seconds() / seconds

    def y(value: float) -> float:
        return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * (value - low) / (high - low)

    def rule(y_px: float, kind: str) -> str:
        return svg.element("line", x1=LEFT, x2=WIDTH - RIGHT, y1=y_px, y2=y_px, class_=kind)

    bands = [
        (x(point.time), *map(y, _band(point))) for point in points if point.u is not None
    ]
    marks = [
        svg.element("line", x1=at, x2=at, y1=low_y, y2=high_y, class_="band")
        for at, low_y, high_y in bands
    ]
    begun = [x(points[step.at].time) for step in trend.steps]
    steps = [
        svg.element("line", x1=at, x2=at, y1=TOP, y2=HEIGHT - BOTTOM, class_="step")
        for at in begun
    ]
    dots = [
        svg.element("circle", cx=x(point.time), cy=y(point.value), r=1.8, class_="dot")
        for point in points
    ]
    values = [
        svg.titled(
            _survey_label(trend, point, language),
            "circle",
            cx=x(point.time),
            cy=y(point.value),
            r=NEAR_PX,
        )
        for point in points
    ]
    line = svg.element(
        "path", d=svg.path((x(point.time), y(point.value)) for point in points), class_="line"
    )
    limit = (
        [rule(y(trend.tolerance), "limit")]
        if trend.tolerance is not None and low <= trend.tolerance <= high
        else []
    )
    ends = [
        svg.text(f"{span[0].date()}", LEFT, HEIGHT - 4),
        svg.text(f"{span[1].date()}", WIDTH - RIGHT, HEIGHT - 4, text_anchor="end"),
    ]
    edges = [
        svg.text(f"{value:.3g}", LEFT - 4, y(value) + 3, text_anchor="end")
        for value in (low, high)
    ]
    label = (
        f"{trend.series.machine}: {trend.series.quantity} / {UNITS[trend.series.unit]}, "
        f"{words['over_time']}"
    )
    return svg.drawing(
        WIDTH,
        HEIGHT,
        label,
        rule(HEIGHT - BOTTOM, "axis"),
        *limit,
        *steps,
        *marks,
        line,
        *dots,
        *ends,
        *edges,
        *values,
    )


def _survey_label(trend: Trend, point: Point, language: Language) -> str:
    expanded = "" if point.u is None else f" ± {svg.fixed(2 * point.u)}"
    if math.isfinite(point.low):
        expanded = f" ({svg.fixed(point.low)} – {svg.fixed(point.high)})"
    figure = localised(
        f"{trend.series.quantity} = {svg.fixed(point.value)}{expanded} {UNITS[trend.series.unit]}",
        language,
    )
    return f"{day(point.time)}, {point.survey.name}: {figure}"


def _band(point: Point) -> tuple[float, float]:
    if math.isfinite(point.low):
        return point.low, point.high
    expanded = 2 * (point.u or 0.0)
    return point.value - expanded, point.value + expanded


def _range(points: Sequence[Point], tolerance: float | None) -> tuple[float, float]:
    edges = [edge for point in points for edge in _band(point)]
    low, high = min(0.0, *edges), max(0.0, *edges, tolerance or 0.0)
    return low, high if high > low else low + 1.0
