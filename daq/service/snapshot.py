"""The session and the links as one immutable snapshot, for the page, ``stepdiag status`` and systemd."""

import math
import time
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime

from stepdiag.daq.capture.route import make_route
from stepdiag.daq.capture.stop import CapturedStop
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.passes.alignment import mirror_tilt_mrad
from stepdiag.daq.passes.driven import Pass
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.recording.session import Session
from stepdiag.daq.records.status import FindingStatus, LinkStatus, Phase, PredictionStatus, SetupStatus, Snapshot, StopStatus
from stepdiag.daq.survey.models import Survey
from stepdiag.daq.timing.stream import CONTINUITY

SHOWN_FINDINGS = 50
PACE_STOPS = 10
"""The time left is told from the pace of this many stops."""


def snapshot(
    session: Session,
    *,
    sequence: int,
    phase: Phase,
    links: tuple[LinkStatus, LinkStatus, LinkStatus | None],
    result_ready: bool,
    prediction: PredictionStatus | None = None,
    programs: Mapping[str, str] | None = None,
    message: str = "",
) -> Snapshot:
    """Return what the daemon knows at this moment; ``links`` are laser, machine and 4-DOF head."""
    laser, plc, head = links
    survey, signals = session.survey, session.signals or Signals()
    setup, stop, count, axis = expected_stop(session)
    reading, beam, lost = _reading(session)
    return Snapshot(
        sequence=sequence,
        wall_time=datetime.fromtimestamp(time.time(), UTC).isoformat(timespec="seconds"),
        survey=survey.identity.name,
        machine=survey.identity.machine,
        operator=session.round.run.get("operator", survey.identity.operator),
        workpiece=session.round.run.get("workpiece", survey.identity.workpiece),
        phase=phase,
        expects_setup=setup,
        expects_pass=_expected_pass(session, setup),
        expects_stop=stop,
        program=(programs or {}).get(setup, ""),
        stops_in_pass=count,
        moving_axis=axis,
        reading_mm=reading,
        reading_age_s=laser.age_s,
        beam=beam,
        beam_lost=lost,
        stopped=signals.stopped,
        stop_count=signals.stop_count,
        alarm=signals.alarm,
        commanded_mm=signals.commanded_mm,
        laser=laser,
        plc=plc,
        head=head,
        air_temperature_c=signals.air_temperature_c,
        air_pressure_hpa=signals.air_pressure_hpa,
        relative_humidity_percent=signals.relative_humidity_percent,
        material_temperature_c=signals.material_temperature_c,
        tilt_mrad=_tilt(session),
        setups=tuple(setup_status(survey, session.book, name, running=_runs(session, name)) for name in survey.plan.all_setups),
        stops=_recent_stops(session.book),
        findings=tuple(
            FindingStatus(code=each.code, severity=each.severity, text=each.text) for each in session.findings[-SHOWN_FINDINGS:]
        ),
        seconds_left=seconds_left(session.book, survey.plan.all_setups, len(session.book.wanted())),
        origin_mm=survey.volume.origin_mm,
        size_mm=survey.volume.size_mm,
        increments=survey.volume.increments,
        result_ready=result_ready,
        recording=session.recording,
        prediction=prediction,
        message=message,
    )


def _expected_pass(session: Session, setup: str) -> int:
    """Return the number of the pass that runs or comes next."""
    walk = session.capture.walk if session.capture is not None else None
    driven = session.book.driven
    if walk is not None and driven is not None and walk.last is not None and driven.route.setup == setup:
        return driven.number
    return next(iter(session.book.open_passes(setup)), 1) if setup else 1


def expected_stop(session: Session) -> tuple[str, int, int, str]:
    """Return the setup that is awaited, its next stop, the stops of a pass, and the axis that moves to that stop."""
    walk = session.capture.walk if session.capture is not None else None
    if walk is not None and not walk.ended:
        return walk.route.setup, walk.expected, len(walk.route), walk.route.axis_to(walk.expected)
    setup = session.book.next_setup()
    if not setup:
        return "", 0, 0, ""
    return setup, 0, len(make_route(session.survey.volume, setup, session.survey.axis_order, outward=True)), ""


def setup_status(survey: Survey, book: PassBook, setup: str, *, running: bool = False) -> SetupStatus:
    """Return how far a setup is, and why it must be driven again where it must; the pass that runs may still become whole."""
    route = make_route(survey.volume, setup, survey.axis_order, outward=True)
    passes = book.of(setup)
    open_passes = book.open_passes(setup)
    broken = [each for each in passes if each.number in open_passes and each.why_incomplete() and not (running and each is book.driven)]
    state = "done" if not open_passes else "running" if running else "again" if broken else "to-do"
    return SetupStatus(
        name=setup,
        passes_wanted=len(book.wanted()),
        passes_done=len(book.wanted()) - len(open_passes),
        stops_wanted=len(route) * len(book.wanted()),
        stops_done=sum(len(each.chosen()) for each in passes if each.number in book.wanted()),
        state=state,  # type: ignore[arg-type]
        reason="; ".join(f"pass {each.number}: {each.why_incomplete()}" for each in broken),
        doubt="; ".join(f"pass {each.number}: {why}" for each in passes if (why := each.why_doubtful())),
    )


def seconds_left(book: PassBook, setups: Sequence[str], passes: int) -> float | None:
    """Return the time the stops still missing will take at the pace of the last stops; None before there is a pace."""
    stops = sorted(stop.time_s for each in book.passes for stop, _ in each.chosen().values())[-PACE_STOPS:]
    if len(stops) < 3:
        return None
    pace = (stops[-1] - stops[0]) / (len(stops) - 1)
    missing = sum(len(each.missing) for each in book.passes)
    begun = len(book.passes)
    per_pass = len(book.passes[0].route)
    return pace * (missing + per_pass * max(len(setups) * passes - begun, 0))


def stop_status(each: Pass, stop: CapturedStop, offset_mm: float, first_mm: float) -> StopStatus:
    """Return a stop with its deviation from the geometry."""
    reading = (stop.reading_mm if stop.reading_mm is not None else math.nan) + offset_mm - first_mm
    return StopStatus(
        setup=each.route.setup,
        pass_number=each.number,
        stop=stop.stop,
        position_mm=stop.position_mm,
        reading_mm=reading,
        deviation_um=(reading - each.route.nominal_at_mm(stop.position_mm)) * 1e3,
        u_um=stop.u_um,
        doubtful=stop.refused or stop.doubtful or each.doubt(stop.stop),
    )


def _recent_stops(book: PassBook) -> tuple[StopStatus, ...]:
    """Return the stops of the pass last driven and of the pass before it in the same setup."""
    driven = book.driven
    if driven is None:
        return ()
    both = [each for each in book.of(driven.route.setup) if each is driven or each.number == driven.number - 1]
    shown = []
    for each in both:
        chosen = each.chosen()
        first = next(iter(chosen.values()), None)
        if first is not None:
            zero = (first[0].reading_mm or 0.0) + first[1] - each.route.nominal_at_mm(first[0].position_mm)
            shown += [stop_status(each, stop, offset, zero) for stop, offset in chosen.values()]
    return tuple(shown)


def _reading(session: Session) -> tuple[float | None, float | None, bool]:
    last = session.laser_samples()
    if last is None:
        return None, None, False
    position, beam = float(last.position_mm[-1]), float(last.beam[-1])
    lost = bool(last.flags[-1] & int(CONTINUITY))
    return (None if math.isnan(position) else position - session.shown_zero_mm), (None if math.isnan(beam) else beam), lost


def _tilt(session: Session) -> tuple[float, float] | None:
    driven = session.book.driven
    return mirror_tilt_mrad(driven.route, [stop for stop, _ in driven.chosen().values()]) if driven is not None else None


def _runs(session: Session, setup: str) -> bool:
    walk = session.capture.walk if session.capture is not None else None
    return walk is not None and walk.route.setup == setup
