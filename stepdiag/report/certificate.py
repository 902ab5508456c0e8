"""The first page of the report: persons, object, time, instruments and convention, and the
volumetric errors as found, as predicted and as left."""

import base64
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from stepdiag.base.compensation import stated_in
from stepdiag.base.conformity import COVERAGE
from stepdiag.base.errors import UsageError
from stepdiag.base.files import read_bytes, read_text
from stepdiag.base.messages import message
from stepdiag.base.result.interval import Interval
from stepdiag.base.result.members import Facts, Judged
from stepdiag.base.result.result import Quantity, Result
from stepdiag.base.settings import read_toml
from stepdiag.conclusion import (
    Conclusion,
    Reach,
    even_of,
    interval_of,
    judged_in,
    probability_words,
    quantity_words,
    verdict_words,
)
from stepdiag.report.laboratory import Equipment, Laboratory, Person
from stepdiag.report.sections import Table, even, shown, table_of
from stepdiag.texts import Language
from stepdiag.texts.texts import UNITS

FACTS = (
    "customer",
    "machine",
    "machine_serial",
    "survey",
    "begun",
    "ended",
    "date",
    "operator",
    "workpiece",
    "instrument",
    "instrument_serial",
    "instrument_certificate",
    "wavelength_nm",
    "sensors",
    "temperature_note",
    "event",
    "corrected",
)
"""Members of the result's ``survey`` in the order of the page; each name is a key of the
catalogue."""
DUE = {
    "customer",
    "machine",
    "machine_serial",
    "operator",
    "instrument",
    "instrument_serial",
    "instrument_certificate",
    "sensors",
}
"""Members of ``survey`` that a customer expects; a missing member appears as "not stated"."""
PICTURES = {
    ".png": "image/png",
    ".jpg": "image/jpeg",
    ".jpeg": "image/jpeg",
    ".svg": "image/svg+xml",
}
LARGEST_LOGO_BYTES = 500_000
"""Largest size of a logo in bytes: the report contains it as text, a third longer."""
Gain = Literal["better", "same", "worse", "unsure"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Letterhead:
    """The issuer of the report: ``logo`` is a picture as a data URL, empty without a logo."""

    company: str = ""
    address: tuple[str, ...] = ()
    logo: str = ""


def read_letterhead(path: Path) -> Letterhead:
    """Return the letterhead in a settings file: ``company``, ``address``, ``logo`` (a picture
    beside the file). Raises UsageError."""
    fields = read_toml(read_text(path), str(path))
    unknown = sorted(fields.keys() - {"company", "address", "logo"})
    if unknown or not all(
        isinstance(fields.get(name, ""), str) for name in ("company", "address", "logo")
    ):
        raise UsageError(
            str(path),
            expected=message("letterhead-texts"),
            found=", ".join(unknown) or message("another-one"),
        )
    logo = fields.get("logo", "")
    return Letterhead(
        company=fields.get("company", ""),
        address=tuple(fields.get("address", "").splitlines()),
        logo=_picture(path.parent / logo) if logo else "",
    )


def _picture(path: Path) -> str:
    kind = PICTURES.get(path.suffix.lower())
    if kind is None:
        raise UsageError(
            str(path),
            expected=message("a-picture", endings=list(PICTURES)),
            found=path.suffix or message("no-suffix"),
        )
    data = read_bytes(path)
    if len(data) > LARGEST_LOGO_BYTES:
        raise UsageError(
            str(path),
            expected=message("file-of-at-most", name="logo", most=LARGEST_LOGO_BYTES),
            found=f"{len(data)}",
        )
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


def _compensation(result: Result, words: Mapping[str, str]) -> str:
    statement = stated_in(result)
    state = words[
        f"compensation_{statement.state}"
        if statement.state in ("off", "on")
        else "compensation_unstated"
    ]
    return "; ".join(
        [
            state,
            *(
                f"{file.name} ({file.source}, {file.date}) SHA-256 {file.sha256}"
                for file in statement.files
            ),
        ]
    )


def facts_table(
    result: Result, words: Mapping[str, str], laboratory: Laboratory | None = None
) -> Table:
    """Return a table of operator, object, time and instruments. A member in `DUE` without a value
    is "not stated"."""
    known = _known(result.survey or Facts(), laboratory or Laboratory())
    shadowed = {"date"} if known.begun else set()
    missing = words["compensation_unstated"]
    entries = ((name, getattr(known, name)) for name in FACTS if name not in shadowed)
    rows = [
        (words[name], _fact(value) if value else missing)
        for name, value in entries
        if value or name in DUE
    ]
    rows.append((words["compensation"], _compensation(result, words)))
    reduced = known.at_20_c if result.lengths is None else result.lengths.tables == "at_20_c"
    rows.append(
        (words["reference_temperature"], words["at_20_c" if reduced else "as_measured"])
    )
    rows.append((words["sign"], words["sign_convention"]))
    rows.append((words["standards"], words["standards_used"]))
    return Table(header=(), rows=rows)


def _known(facts: Facts, laboratory: Laboratory) -> Facts:
    of_survey = Equipment(
        name=facts.instrument,
        serial=facts.instrument_serial,
        certificate=facts.instrument_certificate,
    )
    laser = (*laboratory.equipment, of_survey)[0]
    sensors = ", ".join(
        f"{one.name} {one.serial} {one.certificate}".strip()
        for one in laboratory.equipment[1:]
    )
    return replace(
        facts,
        customer=laboratory.customer.name or facts.customer,
        machine=laboratory.item.name or facts.machine,
        machine_serial=laboratory.item.serial or facts.machine_serial,
        instrument=laser.name,
        instrument_serial=laser.serial,
        instrument_certificate=laser.certificate,
        sensors=sensors if laboratory.equipment else facts.sensors,
    )


def signatures(laboratory: Laboratory | None, words: Mapping[str, str]) -> Table:
    """Return a table with one row for every person who signs, with space for date and signature."""
    persons = (laboratory.person if laboratory is not None else ()) or (Person(),)
    missing = words["compensation_unstated"]
    rows = [(one.name or missing, one.role or missing, "", "") for one in persons]
    return Table(
        header=(words["person"], words["role"], words["date"], words["signature"]), rows=rows
    )


def _fact(value: object) -> str:
    return f"{value:.9g}" if isinstance(value, float) else shown(value)


def effect_table(
    result: Result,
    reach: Reach | None,
    left: "AsLeft | None",
    words: Mapping[str, str],
    language: Language,
) -> Table | None:
    """Return a table of the figures as found, as predicted and as left, at k = 2, with their
    tolerances and verdicts.

    Return None for a survey that has neither a volume nor a tolerance.
    """
    conformity, tolerance = judged_in(result, reach), result.tolerance or {}
    now = {one.quantity: one for one in (() if conformity is None else conformity.as_found)}
    then = {one.quantity: one for one in (() if conformity is None else conformity.predicted)}
    later = {one.quantity: one for one in (() if left is None else left.judged)}
    none = shown(None)
    rows: list[tuple[str, ...]] = []

    def row(name: str, quantity: str, cells: tuple[str, str, str]) -> None:
        states = (("as_found", now), ("predicted", then), ("as_left", later))
        judged = [
            f"{words[state]}: {_verdict(of[quantity], language)}"
            for state, of in states
            if quantity in of
        ]
        limit = f"{now[quantity].tolerance:g}" if quantity in now else none
        rows.append(
            (name, *cells, *((limit, "; ".join(judged) or none) if tolerance else ()))
        )

    if reach is not None:
        figures = (reach.rms_before, reach.rms_after, None if left is None else left.rms)
        row(
            f"{words['field']}, {words['rms']} / µm",
            "volumetric_rms",
            _cells(figures, interval_words),
        )
        figures = (
            reach.largest_before,
            reach.largest_after,
            None if left is None else left.largest,
        )
        row(
            f"{words['field']}, {words['maximum']} / µm",
            "volumetric_largest",
            _cells(figures, bound_words),
        )
    for name, number in result.squareness.items() if rows or tolerance else ():
        after = (
            none
            if left is None or name not in left.squareness
            else with_u(left.squareness[name])
        )
        row(
            f"{name} / µrad",
            name,
            (with_u(number), _between(then[name]) if name in then else none, after),
        )
    for quantity, one in now.items():
        if quantity not in result.squareness and not quantity.startswith("volumetric"):
            after = none if quantity not in later else _between(later[quantity])
            before = _between(then[quantity]) if quantity in then else none
            row(
                f"{quantity_words(one, language)} / {UNITS[one.unit]}",
                quantity,
                (_between(one), before, after),
            )
    again = words["as_left"] + (f" ({words['not_yet']})" if left is None else "")
    header = (words["name"], words["as_found"], words["predicted"], again)
    more = (words["tolerance"], words["verdict"]) if tolerance else ()
    return table_of((*header, *more), rows)


def _cells(
    figures: tuple[Interval | None, ...], form: Callable[[Interval | None], str]
) -> tuple[str, str, str]:
    before, after, later = figures
    return form(before), form(after), shown(None) if later is None else form(later)


def _verdict(one: Judged, language: Language) -> str:
    return verdict_words(one, language) + (
        ""
        if one.probability is None
        else f" ({probability_words(one.probability)}\N{NO-BREAK SPACE}%)"
    )


def _between(one: Judged) -> str:
    if even_words := even_of(one):
        return even_words
    low, high = interval_of(one)
    return f"{low} … {high}" if low else shown(None)


def with_u(number: Quantity) -> str:
    return even(number.value, None if number.u is None else COVERAGE * number.u)


def interval_words(found: Interval | None) -> str:
    """Return an interval in um as a text; a dash without an interval."""
    if found is None:
        return shown(None)
    low, high = found.shown()
    return f"{low} … {high}" if low else f"≥ {found.best()}"


def bound_words(found: Interval | None) -> str:
    """Return the upper end of the interval of the largest error vector as a text."""
    high = "" if found is None else found.shown()[1]
    return f"≤ {high}" if high else interval_words(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class AsLeft:
    """The volume measured again after loading: its figures, their source, and whether the
    prediction is confirmed."""

    source: str
    rms: Interval
    largest: Interval
    kept: bool | None
    """Whether the measured rms agrees with the prediction within both U, or None if a U is
    missing."""
    gain: Gain = "unsure"
    """Change of the machine: better or worse if the new interval is completely below or above the
    interval as found, otherwise neither."""
    squareness: Mapping[str, Quantity] = field(default_factory=dict)
    judged: tuple[Judged, ...] = ()


def as_left(
    source: str, again: Conclusion, found: Reach | None, after: Result | None = None
) -> AsLeft:
    """Compare the prediction of ``found`` with a survey after loading; return whether the
    prediction is confirmed, and the gain.

    ``after`` is the result of the survey after loading. Raises ``UsageError`` for a survey of less
    than three axes.
    """
    if again.reach is None or found is None:
        what = message("axis-not-travelled")
        raise UsageError(
            "--as-left",
            expected=message("whole-volume-twice"),
            found=what,
            remedy=message("compare-two"),
        )
    rms, predicted = again.reach.rms_before, found.rms_after
    order = None if predicted is None else _beside(rms, predicted)
    gains: dict[int | None, Gain] = {-1: "better", 0: "same", 1: "worse", None: "unsure"}
    kept = None if order is None else order == 0
    judged = () if after is None or after.conformity is None else after.conformity.as_found
    return AsLeft(
        source=source,
        rms=rms,
        largest=again.reach.largest_before,
        kept=kept,
        gain=gains[_beside(rms, found.rms_before)],
        squareness={} if after is None else after.squareness,
        judged=judged,
    )


def _beside(one: Interval, other: Interval) -> int | None:
    """Return -1 if an interval is completely below another, 1 if completely above, 0 for an
    overlap, None without limits."""
    if (
        one.low_um is None
        or one.high_um is None
        or other.low_um is None
        or other.high_um is None
    ):
        return None
    return int(one.low_um > other.high_um) - int(one.high_um < other.low_um)
