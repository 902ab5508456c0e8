"""Deviations for display, corrected for air, dead path and mirror tilt.

The outward and the return pass of a setup share one zero, one sign and one numbering.
"""

import numpy as np

from stepdiag.base.volume import Vector
from stepdiag.daq.passes.alignment import mirror_tilt_mrad, tilt_effect_um
from stepdiag.daq.passes.counts import on_one_count
from stepdiag.daq.passes.driven import Pass
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.passes.stretches import OnZero
from stepdiag.daq.passes.tabulate import in_this_air
from stepdiag.daq.records.status import StopStatus
from stepdiag.daq.survey.models import Survey


class RecentStops:
    """The displayed stops of the newest pass and of the previous pass of its setup, computed again
    only after a new stop.
    """

    def __init__(self) -> None:
        self._known: tuple[object, int] = (None, 0)
        self._stops: tuple[StopStatus, ...] = ()

    def of(self, survey: Survey, book: PassBook) -> tuple[StopStatus, ...]:
        """Return the stops of both passes in the order of driving; empty before the first stop of a
        survey.
        """
        driven = book.driven
        if driven is None:
            return ()
        now = (driven, sum(map(len, driven.measured.values())))
        if now != self._known:
            self._known, self._stops = now, _both(survey, book, driven)
        return self._stops


def _both(survey: Survey, book: PassBook, driven: Pass) -> tuple[StopStatus, ...]:
    before = next(
        (
            each
            for each in book.of(driven.route.setup)
            if each.number == driven.number - 1 and each.chosen()
        ),
        None,
    )
    if before is None or driven.route.outward or not driven.chosen():
        return tuple(
            shown
            for each in (before, driven)
            if each is not None
            for shown in _pass_stops(each, _own_um(survey, each))
        )
    out = _own_um(survey, before)
    return (
        *_pass_stops(before, out),
        *_pass_stops(driven, _back_um(survey, before, driven, out)),
    )


def _back_um(
    survey: Survey, out: Pass, back: Pass, out_um: dict[int, float]
) -> dict[int, float]:
    """Return the deviations of a return pass on the zero of the outward pass. Without a common
    count both passes have equal deviations at the far end.
    """
    counted, own = on_one_count([out, back]), _own_um(survey, back)
    end = max(out.chosen())
    begun = min(back.chosen())
    turn_mm = (
        _beside_mm(out, back.chosen()[begun])
        + counted[1].offset_mm
        - _beside_mm(out, out.chosen()[end])
        - counted[0].offset_mm
    )
    met = end + begun == len(out.route) - 1
    joined = met and counted[0].zero == counted[1].zero
    base_um = out_um[end] + (turn_mm * 1e3 if joined else 0.0)
    return {stop: value + base_um for stop, value in own.items()}


def _own_um(survey: Survey, each: Pass) -> dict[int, float]:
    """Return reading minus nominal by stop in um, relative to the first stop of the pass, corrected
    for air and tilt.
    """
    chosen = each.chosen()
    stops = sorted(chosen)
    if not stops:
        return {}
    counts = np.array([chosen[stop].reading_mm for stop in stops])
    readings: Vector = counts - counts[0]
    if not survey.laser.compensated and not each.route.travel.is_fourdof:
        readings = in_this_air(survey, each, [chosen[stop] for stop in stops], readings)
    nominal = np.array([each.route.nominal_at_mm(chosen[stop].position_mm) for stop in stops])
    deviations = (readings - (nominal - nominal[0])) * 1e3
    tilt = mirror_tilt_mrad(each.route, [chosen[stop] for stop in stops])
    if tilt is not None:
        effect = tilt_effect_um(each.route, tilt, stops)
        deviations = deviations - (effect - effect[0])
    return dict(zip(stops, deviations.tolist(), strict=True))


def _pass_stops(each: Pass, deviations_um: dict[int, float]) -> list[StopStatus]:
    chosen = each.chosen()
    if not chosen:
        return []
    first = chosen[min(chosen)]
    zero = _beside_mm(each, first)
    return [
        StopStatus(
            setup=each.route.setup,
            pass_number=each.number,
            stop=stop,
            place=stop if each.route.outward else len(each.route) - 1 - stop,
            position_mm=chosen[stop].position_mm,
            reading_mm=chosen[stop].reading_mm - zero,
            deviation_um=deviation,
            u_um=chosen[stop].u_um,
            doubtful=chosen[stop].refused or each.doubt(stop),
        )
        for stop, deviation in deviations_um.items()
    ]


def _beside_mm(each: Pass, stop: OnZero) -> float:
    return stop.reading_mm - each.route.nominal_at_mm(stop.position_mm)
