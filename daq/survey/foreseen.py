"""What a survey can tell by how it is driven, before anything of it is measured: as the planner knows it."""

from collections.abc import Iterator

from stepdiag.daq.survey.assumed import assumptions_of
from stepdiag.daq.survey.models import Survey
from stepdiag.solver.findings import Finding
from stepdiag.solver.geometry.volume import BODY_DIAGONALS
from stepdiag.solver.planning.planner import Circumstances, forecast
from stepdiag.solver.planning.runs import Pace, Plan, Run


def planned(survey: Survey) -> Plan:
    """Return the runs of a survey as the planner knows them."""
    plan = survey.plan
    shifted = plan.all_setups[len(plan.setups) :]
    offsets = dict(zip(shifted, (each.offset_mm for each in plan.beam_offset), strict=True))
    runs = tuple(
        Run(setup=name, repeats=plan.repeats, return_pass=plan.return_pass, beam_offset_mm=offsets.get(name, (0.0, 0.0, 0.0)))
        for name in plan.all_setups
    )
    pace = Pace(feed_mm_min=plan.feed_mm_min, dwell_s=plan.dwell_s, overrun_mm=plan.overrun_mm)
    return Plan(volume=survey.volume, runs=runs, axis_order=survey.axis_order, pace=pace)


def circumstances(survey: Survey) -> Circumstances:
    """Return the job's circumstances as far as the survey file tells them."""
    return Circumstances(chain=survey.machine.chain, assumed=assumptions_of(survey))


def hidden_slip(survey: Survey) -> Iterator[Finding]:
    """Yield how large a slip of the count nobody would see, where each setup is driven once and nothing is compared with it.

    What is driven out and back, or repeated, tells a slip by itself.
    """
    plan = survey.plan
    if plan.passes_per_setup > 1 or not any(name in BODY_DIAGONALS for name in plan.setups):
        return
    if hides := forecast(planned(survey), circumstances(survey)).ahead.hides():
        cure = "drive out and back (return_pass = true), or each setup twice (repeats = 2)"
        yield Finding(code="slip-hidden", severity="info", text=f"each setup is driven once: {hides}; to see it, {cure}")
