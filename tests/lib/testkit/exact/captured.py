"""Captured stops as a perfect survey would give them."""

from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.survey.file import parse_survey
from testkit.routes import make_route
from testkit.timeline import survey_text


def stops_of(setup="ppp", *, outward=True, zero=0.0, only=None, n=3):
    """Return perfect stops of a pass, readings shifted by ``zero``."""
    survey = parse_survey(survey_text(n=n), "survey.toml")
    route = make_route(survey.volume, setup, "xyz", outward=outward)
    begin = 0.0 if outward else -route.nominal_mm[-1]
    return [
        CapturedStop(
            setup=setup,
            outward=outward,
            stop=k,
            position_mm=tuple(route.stops_mm[k].tolist()),
            axis=route.axis_to(k),
            stop_count=k,
            reading_mm=float(begin + route.nominal_mm[k] + zero),
            u_um=0.1,
            scatter_um=0.3,
            slope_um_s=0.0,
            samples=100,
            rejected=0,
            window_from_ns=k,
            window_to_ns=k + 1,
            time_s=1.8e9 + k,
            beam=0.9,
        )
        for k in (only if only is not None else range(len(route)))
    ]
