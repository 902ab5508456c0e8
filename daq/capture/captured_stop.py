"""A stop of a pass as it was captured: what goes into the log, and from there to the readings."""

from collections.abc import Iterable
from typing import Any

import msgspec

from stepdiag.base.messages import Message, Words, joined


class Remark(msgspec.Struct, frozen=True):
    """Why a person should look at a stop: a finding's code and its message; the text alone in a log
    that held nothing else."""

    code: str
    why: Words


class CapturedStop(msgspec.Struct, frozen=True, kw_only=True):
    """A stop of a pass, as stored in the log and passed on to the readings.

    ``position_mm`` is the commanded position from the machine, as planned without it.
    ``reading_mm`` is the laser's reading, sign applied, in its own length unit before any air
    correction, None without a beam. ``u_um`` is the standard uncertainty of the window's mean (of
    the QD's lateral movement in a run of the 4-DOF head). ``broken`` is the reason why the laser's
    count does not reach back to the stop before, ``unwatched`` why it may not; ``doubts`` the
    reasons of a doubt; ``refused`` (a finding's code) the reason of an unusable reading; ``held``
    names the conditions replaced by their last credible value. ``turned``: the last stop of the
    pass before, at which the machine reversed and to which it came as on that pass. ``channels``
    are the means of the 4-DOF head.
    """

    setup: str
    outward: bool
    stop: int
    position_mm: tuple[float, float, float]
    axis: str
    stop_count: int | None
    reading_mm: float | None
    u_um: float
    scatter_um: float
    slope_um_s: float
    samples: int
    rejected: int
    window_from_ns: int
    window_to_ns: int
    time_s: float
    """Middle of the window, seconds since 1970."""
    beam: float | None
    count: int | None = None
    """The instrument's own number of the sample at ``time_s``; None where the host numbers the
    samples."""
    broken: Words = ""
    unwatched: Words = ""
    doubts: tuple[Remark, ...] = ()
    refused: str = ""
    recovered: bool = False
    turned: bool = False
    channels: tuple[float, ...] = ()
    u_channels: tuple[float, ...] = ()
    material_temperature_c: float | None = None
    air_temperature_c: float | None = None
    air_pressure_hpa: float | None = None
    relative_humidity_percent: float | None = None
    held: tuple[str, ...] = ()

    @property
    def doubt_codes(self) -> tuple[str, ...]:
        """Return the codes of the doubts, without duplicates."""
        return tuple(dict.fromkeys(each.code for each in self.doubts))

    def why(self, *codes: str) -> Words:
        """Return why a person should look at the stop, or as far as a finding names it; empty where
        nothing is doubted."""
        return joined(
            list(dict.fromkeys(each.why for each in self.doubts if not codes or each.code in codes))
        )


def from_log(fields: dict[str, Any]) -> CapturedStop:
    """Return the stop in a log. Raises msgspec.ValidationError for other fields.

    An old log has a common text for all doubts, and their codes beside it.
    """
    words, codes = fields.pop("doubtful", ""), fields.pop("doubt_codes", ())
    if words and "doubts" not in fields:
        usual = "stop-recovered" if fields.get("recovered") else "stop-doubtful"
        fields["doubts"] = [{"code": code, "why": words} for code in codes or (usual,)]
    return msgspec.convert(fields, CapturedStop)


def remarks_of(doubts: Iterable[Message]) -> tuple[Remark, ...]:
    """Return the doubts of a stop as its remarks."""
    return tuple(Remark(each.code, each) for each in doubts)


def marked(stop: CapturedStop, doubt: Message) -> CapturedStop:
    """Return a stop with a further doubt."""
    return msgspec.structs.replace(stop, doubts=(*stop.doubts, *remarks_of([doubt])))
