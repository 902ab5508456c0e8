"""The NC programs of a survey."""

from dataclasses import replace
from pathlib import Path

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.base.setups import setup_of
from stepdiag.daq.survey.models import Survey
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.profiles.file import read_profile_text
from stepdiag.exporters.programs import (
    Program,
    Sequence,
    companion_files,
    default_signals,
    nc_programs,
)
from stepdiag.exporters.programs.settings import program_section, travel_in


def programs_of(
    survey: Survey, control: str, profile: Path | None, *, commission: bool = False
) -> tuple[tuple[Program, ...], tuple[ControlFile, ...]]:
    """Return the NC programs of a survey and the files beside them. With ``commission``, return
    only the programs for the head's runs, with the jogs.

    Raises the errors of `nc_programs`, and UsageError for a commissioning if the plan has no run of
    the head.
    """
    defaults = default_signals(control)
    text, source = ("", "") if profile is None else (read_profile_text(profile), profile.name)
    section = program_section(text, source, control)
    programs = nc_programs(
        replace(sequence_of(survey), commission=commission),
        control,
        signals=section.signals(defaults),
        decimals=section.decimals,
        travel_mm=travel_in(text, source),
    )
    if commission:
        programs = tuple(each for each in programs if setup_of(each.setup).is_fourdof)
    if not programs:
        raise UsageError(
            "plan.setups",
            expected=message("run-of-head-in-plan"),
            found=", ".join(survey.plan.all_setups),
        )
    return programs, companion_files(control, survey.plc.host, survey.plc.tcp_port)


def sequence_of(survey: Survey) -> Sequence:
    """Return the passes of the survey as the sequence from which NC programs are written."""
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
        alternate=plan.alternate_orders,
        targets=plan.targets,
        beam_offset_mm={run.setup: run.beam_offset_mm for run in survey.planned.runs},
    )
