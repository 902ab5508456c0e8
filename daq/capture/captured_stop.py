"""A stop of a pass as it was captured: what goes into the log, and from there to the readings."""

import msgspec


class CapturedStop(msgspec.Struct, frozen=True, kw_only=True):
    """One stop of a pass, as it goes into the log and from there to the readings.

    ``position_mm`` is the commanded position as the machine gave it, as planned where it gives none. ``reading_mm`` is what the laser
    says, sign applied, in its own length unit before any air correction, None where it sees nothing.
    ``u_um`` is the standard uncertainty of the window's mean (of the QD's lateral movement in a run of the 4-DOF head). ``broken`` says
    why the laser's count does not reach back to the stop before, ``unwatched`` why it may not; ``doubtful`` why a person should look
    (``doubt_codes``: the findings that say so, where it is not `stop-doubtful`); ``refused`` (a finding's code) why the reading must not be
    used; ``held`` names the conditions whose last credible value stands in for them. ``turned``: it is the last stop of the pass before, at
    which the machine turned round and to which it came as on that pass. ``channels`` are the means of the 4-DOF head.
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
    broken: str = ""
    unwatched: str = ""
    doubtful: str = ""
    doubt_codes: tuple[str, ...] = ()
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


def marked(stop: CapturedStop, code: str, words: str) -> CapturedStop:
    """Return a stop that is doubtful for one more reason."""
    before = stop.doubt_codes or (("stop-doubtful",) if stop.doubtful else ())
    doubtful = "; ".join(text for text in (stop.doubtful, words) if text)
    return msgspec.structs.replace(stop, doubtful=doubtful, doubt_codes=tuple(dict.fromkeys((*before, code))))
