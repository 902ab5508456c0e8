"""The first page of the report: who, what, when, with what and by which convention, and the volume as found, predicted and as left."""

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from stepdiag.base.compensation import stated_in
from stepdiag.base.errors import UsageError
from stepdiag.base.files import read_bytes, read_text
from stepdiag.base.result.interval import Interval
from stepdiag.base.result.members import Facts
from stepdiag.base.result.result import Result
from stepdiag.base.settings import read_toml
from stepdiag.conclusion import Conclusion, Reach
from stepdiag.report.sections import Table, shown

FACTS = (
    "customer", "machine", "machine_serial", "survey", "begun", "ended", "date", "operator", "workpiece",
    "instrument", "instrument_serial", "instrument_certificate", "wavelength_nm", "sensors", "temperature_note", "event",
)  # fmt: skip
"""Entries of ``survey`` in the result, in the order of the page; each is a word of the catalogue."""
PICTURES = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg", ".svg": "image/svg+xml"}
LARGEST_LOGO_BYTES = 500_000
Gain = Literal["better", "same", "worse", "unsure"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Letterhead:
    """Who hands the report over: ``logo`` is a picture as a data address, empty without one."""

    company: str = ""
    address: tuple[str, ...] = ()
    logo: str = ""


def read_letterhead(path: Path) -> Letterhead:
    """Return the letterhead in a settings file: ``company``, ``address``, ``logo`` (a picture beside it). Raises UsageError."""
    fields = read_toml(read_text(path), str(path))
    unknown = sorted(fields.keys() - {"company", "address", "logo"})
    if unknown or not all(isinstance(fields.get(name, ""), str) for name in ("company", "address", "logo")):
        raise UsageError(
            str(path), expected='texts "company", "address" and "logo"', found=", ".join(unknown) or "something else than text"
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
        raise UsageError(str(path), expected=f"a picture ({', '.join(PICTURES)})", found=path.suffix or "no ending")
    data = read_bytes(path)
    if len(data) > LARGEST_LOGO_BYTES:
        raise UsageError(str(path), expected=f"a logo of at most {LARGEST_LOGO_BYTES} bytes", found=f"{len(data)}")
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


def _compensation(result: Result, words: Mapping[str, str]) -> str:
    """Return what was active while measuring, with the files and their hashes."""
    statement = stated_in(result)
    state = words[f"compensation_{statement.state}" if statement.state in ("off", "on") else "compensation_unstated"]
    return "; ".join([state, *(f"{file.name} ({file.source}, {file.date}) SHA-256 {file.sha256}" for file in statement.files)])


def facts_table(result: Result, words: Mapping[str, str]) -> Table:
    """Return who measured what, when and with what; what the survey does not say is left out."""
    known = result.survey or Facts()
    shadowed = {"date"} if known.begun else set()
    rows = [(words[name], _fact(value)) for name in FACTS if (value := getattr(known, name)) and name not in shadowed]
    rows.append((words["compensation"], _compensation(result, words)))
    reduced = known.at_20_c if result.lengths is None else result.lengths.tables == "at_20_c"
    rows.append((words["reference_temperature"], words["at_20_c" if reduced else "as_measured"]))
    rows.append((words["sign"], words["sign_convention"]))
    rows.append((words["standards"], words["standards_used"]))
    return Table(header=(), rows=rows)


def _fact(value: object) -> str:
    """Return a fact as it was stated: a wavelength keeps its six digits."""
    return f"{value:.9g}" if isinstance(value, float) else shown(value)


def effect_table(conclusion: Conclusion, as_left: "AsLeft | None", words: Mapping[str, str]) -> Table | None:
    """Return the volume as found, predicted and as left, rms and largest vector, in um at k = 2; None where no volume was surveyed."""
    reach = conclusion.reach
    if reach is None:
        return None
    rows = [(words["as_found"], interval_words(reach.rms_before), bound_words(reach.largest_before))]
    rows.append((words["predicted"], interval_words(reach.rms_after), bound_words(reach.largest_after)))
    left = (interval_words(as_left.rms), bound_words(as_left.largest)) if as_left is not None else (words["not_yet"], words["not_yet"])
    rows.append((words["as_left"], *left))
    return Table(header=(words["field"], f"{words['rms']} / µm", f"{words['maximum']} / µm"), rows=rows)


def interval_words(found: Interval | None) -> str:
    """Return an interval in um as a person reads it; a dash where there is none."""
    if found is None:
        return shown(None)
    low, high = found.shown()
    return f"{low} … {high}" if low else f"≥ {found.best()}"


def bound_words(found: Interval | None) -> str:
    """Return what a largest vector is at most, as the conclusion says it: how small it may be is no promise."""
    high = "" if found is None else found.shown()[1]
    return f"≤ {high}" if high else interval_words(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class AsLeft:
    """The volume measured again after the files were loaded: its figures, where they stand, and whether the prediction came true."""

    source: str
    rms: Interval
    largest: Interval
    kept: bool | None
    """Whether the measured rms lies within what was predicted, both with their U; None where one of them has none."""
    gain: Gain = "unsure"
    """What became of the machine: an interval wholly below or above the one as found is better or worse, one that meets it is neither."""


def as_left(source: str, again: Conclusion, found: Reach | None) -> AsLeft:
    """Return what a survey after loading says of the reach ``found`` before it: whether the prediction came true, and what was gained.

    Raises ``UsageError`` where an axis did not travel in one of the two: nothing is stated about a volume there.
    """
    if again.reach is None or found is None:
        what = "a survey in which an axis did not travel"
        raise UsageError("as left", expected="two surveys of the whole volume", found=what, remedy="compare the two results")
    rms, predicted = again.reach.rms_before, found.rms_after
    order = None if predicted is None else _beside(rms, predicted)
    gains: dict[int | None, Gain] = {-1: "better", 0: "same", 1: "worse", None: "unsure"}
    kept = None if order is None else order == 0
    return AsLeft(source=source, rms=rms, largest=again.reach.largest_before, kept=kept, gain=gains[_beside(rms, found.rms_before)])


def _beside(one: Interval, other: Interval) -> int | None:
    """Return -1 or 1 where one interval lies wholly below or above another, 0 where they meet, None where one has no ends."""
    if one.low_um is None or one.high_um is None or other.low_um is None or other.high_um is None:
        return None
    return int(one.low_um > other.high_um) - int(one.high_um < other.low_um)
