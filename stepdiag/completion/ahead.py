"""The next passes of a running survey, and the addition of a setup to the survey file."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import msgspec

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.files import read_text, write_atomically
from stepdiag.base.messages import Message, Words, message
from stepdiag.base.names import AXES
from stepdiag.base.readings.readings import Readings, parse_readings
from stepdiag.base.readings.runs import Run
from stepdiag.base.result.result import Result, result_in
from stepdiag.base.setups import setup_of
from stepdiag.completion.completion import replay_judged
from stepdiag.completion.foreseen import circumstances
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.passes.tabulate import tabulate
from stepdiag.daq.recording.rounds import round_folders
from stepdiag.daq.records.status import AheadStatus
from stepdiag.daq.records.survey_folder import READINGS, RESULT, logs_in, machine_folder
from stepdiag.daq.service.remaining import own_minutes
from stepdiag.daq.survey.amended import with_plan
from stepdiag.daq.survey.file import load_survey
from stepdiag.daq.survey.models import BeamOffset, Survey
from stepdiag.daq.survey.models import Plan as PlanSection
from stepdiag.solver.planning.circumstances import Circumstances
from stepdiag.solver.planning.sequel import Sequel, sequel, shown_by


def look_ahead(file: Path) -> tuple[Survey, Path | None, Sequel]:
    """Return a survey, the folder of the present round (None before the first round), and the runs
    to drive next.

    Raises the errors of `load_survey`, and DataError for logs of another survey file.
    """
    survey = load_survey(file)
    rounds = round_folders(survey.folder(file))
    about, _ = known_before(file, survey, circumstances(survey, file.parent))
    if not rounds or not logs_in(rounds[-1]):
        return survey, None, sequel(survey.planned, about, ())
    replayed = replay_judged([rounds[-1]], file)
    plan = own_minutes(survey, replayed.stops)
    return (
        survey,
        rounds[-1],
        sequel(plan, about, done_in(survey, replayed.book), _readings(survey, replayed.book)),
    )


def done_in(survey: Survey, book: PassBook) -> list[str]:
    """Return the completed setups, with the present setup last."""
    standing = "" if book.last is None else book.last.setup
    done = [name for name in survey.plan.all_setups if not book.open_passes(name)]
    return sorted(done, key=lambda name: name == standing)


def _readings(survey: Survey, book: PassBook) -> Readings | None:
    done = done_in(survey, book)
    passes = [
        each
        for each in book.passes
        if each.route.setup in done and each.number in book.wanted()
    ]
    return (
        tabulate(survey, passes)
        if any(not setup_of(name).is_fourdof for name in done)
        else None
    )


def known_before(
    file: Path, survey: Survey, about: Circumstances
) -> tuple[Circumstances, Path | None]:
    """Return ``about`` with the assumed sizes that the last finished survey of this machine found.
    Return also the folder of this last survey if this survey determined the angles, otherwise None.

    The last survey is searched in the neighbouring folders and in the store. Raises UsageError for
    a store that does not exist.
    """
    found = dict[tuple[str, Path], tuple[Result, Readings]]()
    for path in (*survey.folder(file).parent.glob(f"*/*/{RESULT}"), *_archived(file, survey)):
        try:
            result = result_in(path)
            if result.survey is not None and result.survey.machine == survey.identity.machine:
                ended = result.survey.ended or result.survey.date
                found[ended, path.parent] = (
                    result,
                    parse_readings(read_text(path.with_name(READINGS))),
                )
        except (DataError, UsageError):
            continue
    if not found:
        return about, None
    last = max(found)
    result, readings = found[last]
    shown, angles_urad = shown_by(
        readings, replace(survey.planned, volume=result.volume), about
    )
    return shown, None if angles_urad is None else last[1]


def _archived(file: Path, survey: Survey) -> Iterable[Path]:
    store = survey.identity.archive
    if store and not (file.parent / store).is_dir():
        raise UsageError(
            f"{file.name}: survey.archive",
            expected=message("folder-with", what=message("finished-surveys")),
            found=store,
        )
    return (
        (file.parent / store / machine_folder(survey.identity.machine)).glob(f"*/*/{RESULT}")
        if store
        else ()
    )


def in_words(ahead: Sequel, survey: Survey) -> AheadStatus:
    planned = survey.plan.all_setups
    first = next(iter(ahead.runs), None)
    if first is None or (ahead.end and first.setup not in planned):
        words, setup = message("ahead-end", most_um=ahead.at_most_um, now_um=ahead.now_um), ""
    elif ahead.end:
        words, setup = (
            message(
                "ahead-end.planned",
                setup=first.setup,
                most_um=ahead.at_most_um,
                now_um=ahead.now_um,
            ),
            first.setup,
        )
    else:
        words, setup = _next(ahead, survey), first.setup
    if ahead.angles_urad is not None:
        words = message("ahead-angles", angles_urad=ahead.angles_urad, what=words)
    return AheadStatus(words=words, setup=setup, further=bool(setup) and setup not in planned)


def _next(ahead: Sequel, survey: Survey) -> Message:
    first, *others = ahead.runs
    line = (
        message("ahead-planned", setup=first.setup)
        if first.setup in survey.plan.all_setups
        else _line_words(first)
    )
    figures = {"now_um": ahead.now_um, "then_um": ahead.then_um, "minutes": ahead.minutes}
    if others:
        return message("ahead-next.with", line=line, count=len(others), **figures)
    return message("ahead-next", line=line, **figures)


def _line_words(run: Run) -> Words:
    offset = [
        message("ahead-offset", size_mm=size, axis=axis)
        for axis, size in zip(AXES, run.beam_offset_mm, strict=True)
        if size
    ]
    name = run.travel.base
    return (
        message("ahead-shifted", setup=name, offset=offset)
        if offset
        else message("ahead-further", setup=name)
    )


def take(file: Path, survey: Survey, ahead: Sequel) -> Run:
    """Add the next setup to the survey file unless the plan contains it; return the setup.

    Raises UsageError if no further setup is recommended, or the file cannot contain it.
    """
    run = next(iter(() if ahead.end else ahead.runs), None)
    if run is None or run.setup in survey.plan.all_setups:
        raise UsageError(
            message("where-take"),
            expected=message("expects-further"),
            found=message("none") if run is None else run.setup,
        )
    changed = with_plan(read_text(file), _with(survey.plan, run), file.name)
    write_atomically(file, changed.encode("utf-8"))
    return run


def _with(plan: PlanSection, run: Run) -> PlanSection:
    setup = run.travel
    if not setup.shift:
        return msgspec.structs.replace(plan, setups=(*plan.setups, run.setup))
    offset = BeamOffset(setup=setup.base, offset_mm=run.beam_offset_mm)
    return msgspec.structs.replace(plan, beam_offset=(*plan.beam_offset, offset))
