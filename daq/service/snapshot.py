"""The state of session and links as one snapshot, for the page, ``stepdiag status`` and systemd."""

import math
import time
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime

from stepdiag.base.messages import Words, joined, message
from stepdiag.daq.capture.naming.route import route_of
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.passes.alignment import mirror_tilt_mrad
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.recording.session import Session
from stepdiag.daq.recording.survey_links import Statuses
from stepdiag.daq.records.status import DriveStatus, Phase, SetupStatus, Snapshot, StripStatus
from stepdiag.daq.service.finding_list import finding_list
from stepdiag.daq.service.geometry import geometry
from stepdiag.daq.service.remaining import to_drive
from stepdiag.daq.survey.models import Survey
from stepdiag.daq.timing.stream import CONTINUITY
from stepdiag.daq.timing.strip import BIN_S, KEEP_BINS


def snapshot(
    session: Session,
    *,
    sequence: int,
    phase: Phase,
    links: Statuses,
    result_ready: bool,
    programs: Mapping[str, str] | None = None,
    waits_in_vain: bool = False,
    notice: Words = "",
) -> Snapshot:
    """Return the present state of the daemon; ``links`` are the states of laser, machine, 4-DOF
    head and sensor of air.
    """
    laser, plc, head, air = links
    survey, signals = session.survey, session.signals or Signals()
    setup, stop, count, axis = expected_stop(session)
    reading, beam, lost = _reading(session)
    running = _running(session)
    drives = to_drive(survey, session.book, running)
    setups = setup_statuses(survey, session.book, drives, running)
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
        air=air,
        air_temperature_c=signals.air_temperature_c,
        air_pressure_hpa=signals.air_pressure_hpa,
        relative_humidity_percent=signals.relative_humidity_percent,
        material_temperature_c=signals.material_temperature_c,
        tilt_mrad=_tilt(session),
        tilt_setup=session.book.driven.route.setup if session.book.driven is not None else "",
        tilt_live=session.book.driven is not None
        and running == session.book.driven.route.setup,
        setups=setups,
        stops=session.recent.of(survey, session.book),
        findings=finding_list(session.book, session.findings, time.time()),
        seconds_left=60.0 * sum(drive.minutes for drive in drives),
        to_drive=drives,
        origin_mm=survey.volume.origin_mm,
        size_mm=survey.volume.size_mm,
        increments=survey.volume.increments,
        geometry=geometry(survey.planned, setups, setup, _expected_pass(session, setup)),
        counts_to=_counts_to(session, lost),
        driven_out=session.capture is not None and session.capture.driven_out,
        strip=_strip(session),
        result_ready=result_ready,
        recording=session.recording,
        begins=survey.plc.silent and not session.recording and bool(setup),
        waits_in_vain=waits_in_vain,
        message=notice,
    )


def _expected_pass(session: Session, setup: str) -> int:
    walk = session.capture.walk if session.capture is not None else None
    driven = session.book.driven
    if (
        walk is not None
        and driven is not None
        and walk.last is not None
        and driven.route.setup == setup
    ):
        return driven.number
    return next(iter(session.book.open_passes(setup)), 1) if setup else 1


def expected_stop(session: Session) -> tuple[str, int, int, str]:
    """Return the awaited setup, the next stop, the number of stops of the pass, and the axis that
    moves to the next stop.
    """
    walk = session.capture.walk if session.capture is not None else None
    if walk is not None and not walk.ended:
        return (
            walk.route.setup,
            walk.expected,
            len(walk.route),
            walk.route.axis_to(walk.expected),
        )
    setup = session.book.next_setup()
    if not setup:
        return "", 0, 0, ""
    return setup, 0, len(route_of(session.survey.planned, setup, 1)), ""


def setup_statuses(
    survey: Survey, book: PassBook, drives: Sequence[DriveStatus], running: str = ""
) -> tuple[SetupStatus, ...]:
    """Return the progress of each setup of the plan, with the reason to repeat a pass; ``drives``
    are the passes to drive.
    """
    names = survey.plan.all_setups
    return tuple(
        _setup_status(
            survey,
            book,
            name,
            [each for each in drives if each.setup == name],
            name == running,
        )
        for name in names
    )


def _setup_status(
    survey: Survey, book: PassBook, setup: str, drives: Sequence[DriveStatus], running: bool
) -> SetupStatus:
    stops_wanted = len(route_of(survey.planned, setup, 1)) * len(book.wanted())
    passes = [each for each in book.of(setup) if each.number in book.wanted()]
    again = {drive.pass_number for drive in drives if drive.again}
    states = (("done", not drives), ("running", running), ("again", again), ("to-do", True))
    state = next(name for name, holds in states if holds)
    return SetupStatus(
        name=setup,
        passes_wanted=len(book.wanted()),
        passes_done=len(book.wanted()) - len(drives),
        stops_wanted=stops_wanted,
        stops_done=stops_wanted - sum(drive.stops for drive in drives),
        state=state,  # type: ignore[arg-type]
        reason=joined(
            [
                message("pass-why", number=each.number, why=each.why_incomplete())
                for each in passes
                if each.number in again
            ]
        ),
        doubt=joined(
            [
                message("pass-why", number=each.number, why=why)
                for each in passes
                if (why := each.why_doubtful())
            ]
        ),
    )


def _counts_to(session: Session, lost: bool) -> int | None:
    """Return the last stop of the running pass before the count was lost; None while the count is
    unbroken, and before the first stop.
    """
    walk, driven = (
        (session.capture.walk if session.capture is not None else None),
        session.book.driven,
    )
    if (
        walk is None
        or driven is None
        or not walk.started
        or driven.route.setup != walk.route.setup
    ):
        return None
    chosen = driven.chosen()
    off = [stop for stop in driven.measured if stop not in chosen]
    if off:
        return max((stop for stop in chosen if stop < min(off)), default=0)
    return max(chosen) if lost and chosen else None


def _strip(session: Session) -> StripStatus | None:
    bins = session.strip.bins
    if not bins:
        return None
    first, last = bins[0][0], bins[-1][0]
    low: list[float | None] = [None] * (last - first + 1)
    high = list(low)
    for number, least, most in bins:
        if not math.isnan(least):
            low[number - first] = round(least - session.shown_zero_mm, 6)
            high[number - first] = round(most - session.shown_zero_mm, 6)
    keep = min(len(low), KEEP_BINS)
    return StripStatus(
        first=last - keep + 1,
        bin_s=BIN_S,
        low_mm=tuple(low[-keep:]),
        high_mm=tuple(high[-keep:]),
    )


def _reading(session: Session) -> tuple[float | None, float | None, bool]:
    last = session.laser_samples()
    if last is None:
        return None, None, False
    position, beam = float(last.position_mm[-1]), float(last.beam[-1])
    lost = bool(last.flags[-1] & int(CONTINUITY))
    return (
        (None if math.isnan(position) else position - session.shown_zero_mm),
        (None if math.isnan(beam) else beam),
        lost,
    )


def _tilt(session: Session) -> tuple[float, float] | None:
    driven = session.book.driven
    return (
        mirror_tilt_mrad(driven.route, list(driven.chosen().values()))
        if driven is not None
        else None
    )


def _running(session: Session) -> str:
    walk = session.capture.walk if session.capture is not None else None
    return walk.route.setup if walk is not None else ""
