"""A captured stop of a pass, as stored in the log and passed on to the readings."""

from collections.abc import Iterable
from typing import Any

import msgspec

from stepdiag.base.messages import Message, Words, joined


class Remark(msgspec.Struct, frozen=True):
    """The reason why a person should inspect a stop: a finding's code and its message. A log of an
    old version, without codes of findings, has only the text.
    """

    code: str
    why: Words


class CapturedStop(msgspec.Struct, frozen=True, kw_only=True):
    """A captured stop.

    ``position_mm`` is the commanded position from the machine, or the planned position if the
    machine sends none. ``reading_mm`` is the laser's reading, sign applied, in its own length unit
    before any air correction, None without a beam. ``u_um`` is the standard uncertainty of the
    window's mean (of the QD's lateral movement in a run of the 4-DOF head). ``broken`` is the
    reason of a certain loss of the laser's count since the previous stop, ``unwatched`` the reason
    of a possible loss. ``doubts`` are the reasons to doubt the stop. ``refused`` (a finding's code)
    is the reason of an unusable reading. ``held`` names the conditions replaced by their last
    credible value. ``turned`` means that the stop is also the last stop of the previous pass: the
    machine arrived during the previous pass and reversed there. ``channels`` are the means of the
    4-DOF head. ``order`` is the order of the moving axes (``yzx``) if the passes of the setup have
    several orders. The order of the first stop is set when the second stop is captured.
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
    order: str = ""
    channels: tuple[float, ...] = ()
    u_channels: tuple[float, ...] = ()
    material_temperature_c: float | None = None
    air_temperature_c: float | None = None
    air_pressure_hpa: float | None = None
    relative_humidity_percent: float | None = None
    held: tuple[str, ...] = ()

    @property
    def doubt_codes(self) -> tuple[str, ...]:
        """Return the codes of the stop's doubts, without duplicates."""
        return tuple(dict.fromkeys(each.code for each in self.doubts))

    def why(self, *codes: str) -> Words:
        """Return the reasons why a person should inspect the stop, of all doubts or of those with
        the given codes; empty without a doubt.
        """
        return joined(
            list(
                dict.fromkeys(
                    each.why for each in self.doubts if not codes or each.code in codes
                )
            )
        )


def from_log(fields: dict[str, Any]) -> CapturedStop:
    """Return the stop as stored in a log. Raises msgspec.ValidationError if a field does not belong
    to a stop.

    A log of an old version has one common text for all doubts, and the codes of the doubts beside
    this text.
    """
    words, codes = fields.pop("doubtful", ""), fields.pop("doubt_codes", ())
    if words and "doubts" not in fields:
        usual = "stop-recovered" if fields.get("recovered") else "stop-doubtful"
        fields["doubts"] = [{"code": code, "why": words} for code in codes or (usual,)]
    return msgspec.convert(fields, CapturedStop)


def remarks_of(doubts: Iterable[Message]) -> tuple[Remark, ...]:
    """Return doubts (messages) in the form stored with a stop."""
    return tuple(Remark(each.code, each) for each in doubts)


def marked(stop: CapturedStop, doubt: Message) -> CapturedStop:
    """Return a stop with a further doubt."""
    return msgspec.structs.replace(stop, doubts=(*stop.doubts, *remarks_of([doubt])))
