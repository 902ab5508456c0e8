"""``stepdiag plan``: the forecast of a survey, its duration, and recommended further runs."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.cli.completion import AsJson, Verbose
from stepdiag.cli.granted import say_assumed
from stepdiag.terminal.viewer import print_words

if TYPE_CHECKING:
    from stepdiag.base.readings.runs import Plan
    from stepdiag.daq.survey.models import Plan as PlanSection
    from stepdiag.daq.survey.models import Survey
    from stepdiag.solver.planning.circumstances import Circumstances
    from stepdiag.solver.planning.foresight import Foresight
    from stepdiag.solver.planning.planner import Advice, Forecast


def register(app: typer.Typer) -> None:
    app.command("plan")(plan)


def plan(
    file: Path,
    minutes: float | None = None,
    target_um: float | None = None,
    apply: Annotated[bool, typer.Option("--apply")] = False,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Predict the results of a survey and its duration."""
    from stepdiag.completion.ahead import known_before
    from stepdiag.completion.foreseen import circumstances
    from stepdiag.daq.recording.rounds import noted_stops, round_folders
    from stepdiag.daq.replay import begun_logs
    from stepdiag.daq.service.remaining import own_minutes
    from stepdiag.daq.survey.file import load_survey

    for name, value in (("--minutes", minutes), ("--target-um", target_um)):
        if value is not None and not 0 < value < float("inf"):
            raise UsageError(name, expected=message("number-above-0"), found=f"{value:g}")
    survey = load_survey(file)
    folders = round_folders(survey.folder(file))
    stops = (
        [stop for log in begun_logs(folders[-1]) for stop in noted_stops(log)]
        if folders
        else []
    )
    about, last = known_before(file, survey, circumstances(survey, file.parent))
    advice = _advise(own_minutes(survey, stops), about, minutes, target_um)
    asked = minutes is not None or target_um is not None
    _print_foreseen(survey)
    if last is not None:
        print_words(
            message("known-before", folder=str(last), angles_urad=about.assumed.angles_urad),
            err=True,
        )
    if as_json:
        typer.echo(json.dumps(_advice_json(advice), indent=2, ensure_ascii=False))
    else:
        _print(advice, asked=asked, verbose=verbose)
    if apply:
        _apply(file, survey, advice, asked=asked)


def _print_foreseen(survey: "Survey") -> None:
    """Print the errors that the survey cannot separate without signals of the machine, and the axes
    whose targets do not show the periodic error of the ball screw.
    """
    from stepdiag.completion.foreseen import hidden_waves
    from stepdiag.daq.capture.remarks.unchecked import unchecked
    from stepdiag.terminal.tables import finding_lines

    for line in finding_lines(
        [*(unchecked(survey) if survey.plc.silent else ()), *hidden_waves(survey)]
    ):
        print_words(line, err=True)


def _apply(file: Path, survey: "Survey", advice: "Advice", *, asked: bool) -> None:
    from stepdiag.base.files import read_text, write_atomically
    from stepdiag.daq.survey.amended import with_plan

    chosen = advice.best if asked else advice.next
    if chosen is None:
        raise UsageError(
            "--apply",
            expected=message("better-survey"),
            found=message("none"),
            remedy=message("ask-with-others"),
        )
    section = _section(survey, chosen.plan)
    finer = chosen.plan.volume.increments
    changed = with_plan(
        read_text(file), section, file.name, None if finer == survey.box.increments else finer
    )
    write_atomically(file, changed.encode("utf-8"))
    setups = section.all_setups
    figures = {"repeats": section.repeats, "increments": finer}
    print_words(
        message(
            "plan-applied", name=str(file), setups=setups, **figures, dwell_s=section.dwell_s
        ),
        err=True,
    )


def _section(survey: "Survey", plan: "Plan") -> "PlanSection":
    import msgspec

    from stepdiag.base.setups import setup_of
    from stepdiag.daq.survey.models import BeamOffset

    shifted = [run for run in plan.runs if any(run.beam_offset_mm)]
    orders, alternate = next(
        ((run.axis_orders, run.alternate) for run in plan.runs if run.axis_orders),
        ((), False),
    )
    offsets = tuple(
        msgspec.convert(
            {"setup": setup_of(run.setup).base, "offset_mm": run.beam_offset_mm}, BeamOffset
        )
        for run in shifted
    )
    return msgspec.structs.replace(
        survey.plan,
        setups=tuple(run.setup for run in plan.runs if run not in shifted),
        repeats=max(run.repeats for run in plan.runs),
        return_pass=any(run.return_pass for run in plan.runs),
        axis_orders=orders,
        alternate_orders=alternate,
        dwell_s=plan.pace.dwell_s,
        beam_offset=offsets,
    )


def _advise(
    plan: "Plan", about: "Circumstances", minutes: float | None, target_um: float | None
) -> "Advice":
    from stepdiag.solver.planning.planner import plan as advise
    from stepdiag.terminal.progress import working

    with working(message("looking-for-surveys")):
        return advise(plan, about, available_min=minutes, target_um=target_um)


def _advice_json(advice: "Advice") -> dict[str, Any]:
    return {
        "forecast": _forecast_json(advice.forecast),
        "front": [_named_json(each) for each in advice.front],
        "best": None if advice.best is None else _forecast_json(advice.best),
        "with_head": None if advice.with_head is None else _named_json(advice.with_head),
        "floor_um": advice.forecast.ahead.of.floor_um,
    }


def _forecast_json(forecast: "Forecast") -> dict[str, Any]:

    return {
        **_named_json(forecast),
        "volumetric_u_um": forecast.volumetric_um,
        **_unseen_json(forecast.ahead),
        "angles": forecast.angles,
        "u": forecast.u,
        "resolved": list(forecast.resolved),
        "hidden": forecast.hidden,
    }


def _named_json(forecast: "Forecast") -> dict[str, Any]:
    from stepdiag.base.result.typed import written

    return {
        "increments": forecast.plan.volume.increments,
        "dwell_s": forecast.plan.pace.dwell_s,
        "runs": [
            {
                "setup": run.setup,
                "repeats": run.repeats,
                "return_pass": run.return_pass,
                "beam_offset_mm": run.beam_offset_mm,
                "axis_orders": list(run.driven_orders),
                "targets": run.targets,
            }
            for run in forecast.plan.runs
        ],
        "minutes": forecast.minutes,
        "left_um": written(forecast.left_um),
    }


def _unseen_json(ahead: "Foresight") -> dict[str, float | None]:
    """Return three sizes in um, or an empty dictionary for a plan without diagonals. The value
    ``unseen_step_um`` is the slip of the laser count that half of all surveys detect,
    ``seen_step_um`` the slip that nearly all surveys detect. The value ``unseen_step_volume_um`` is
    the volumetric error that a slip of ``unseen_step_um`` causes."""
    unseen = ahead.unseen
    if unseen is None:
        return {}
    return {
        "unseen_step_um": unseen.half_um,
        "seen_step_um": unseen.nearly_um,
        "unseen_step_volume_um": unseen.volume_um,
    }


def _print(advice: "Advice", *, asked: bool, verbose: bool) -> None:
    from rich.console import Console

    from stepdiag.terminal.plan_tables import forecast_table, front_table, in_words

    console = Console()
    print_words(in_words(advice.forecast, by_name=verbose))
    if verbose:
        console.print(forecast_table(advice.forecast))
    console.print(front_table(advice, verbose=verbose))
    print_words(message("corners-meant"))
    if advice.best is not None:
        print_words(message("best-survey", what=in_words(advice.best, by_name=verbose)))
        if verbose:
            console.print(forecast_table(advice.best))
    elif asked:
        print_words(message("no-survey-fits"))
    if verbose:
        say_assumed(advice.forecast.assumed.stated())
