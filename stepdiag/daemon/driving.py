"""What a survey drives, as the writers of NC programs know it."""

from stepdiag.daq.survey.models import Survey
from stepdiag.exporters.programs import Sequence


def sequence_of(survey: Survey) -> Sequence:
    """Return what the survey drives, as the writers of programs know it."""
    plan = survey.plan
    return Sequence(
        name=survey.identity.name,
        volume=survey.volume,
        setups=plan.all_setups,
        axis_order=survey.axis_order,
        return_pass=plan.return_pass,
        repeats=plan.repeats,
        feed_mm_min=plan.feed_mm_min,
        dwell_s=plan.dwell_s,
        overrun_mm=plan.overrun_mm,
        handshake=survey.plc.handshake.enabled,
        axis_orders=plan.axis_orders,
        targets=plan.targets,
        beam_offset_mm={run.setup: run.beam_offset_mm for run in survey.planned.runs},
    )
