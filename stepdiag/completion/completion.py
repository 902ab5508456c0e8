"""The completion of a survey, live or replayed: readings, result, controller files.

The completion runs in a separate process. The logs contain all input of the completion, including
the date of the export, so a replay writes the same bytes.
"""

import shlex
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Literal

import msgspec

from stepdiag.base.conformity import with_tolerance
from stepdiag.base.errors import DataError, SafetyError, StepdiagError, UsageError
from stepdiag.base.files import (
    as_text,
    hashed,
    holds,
    write_hashed,
    write_once,
    write_together,
)
from stepdiag.base.messages import Words, joined, message
from stepdiag.base.readings.readings import Readings, render_readings
from stepdiag.base.result.members import AssumedConditions, Conditions, Facts, Source
from stepdiag.base.result.result import Result, parse_result
from stepdiag.completion.exchanged import with_line
from stepdiag.completion.one_scale import one_scale
from stepdiag.completion.proof import proof_findings
from stepdiag.daq.capture.remarks.unchecked import unchecked
from stepdiag.daq.passes.held import Held, assumed_conditions, held_conditions, with_held
from stepdiag.daq.passes.survey_time import clock_findings, span_s
from stepdiag.daq.passes.tabulate import tabulate
from stepdiag.daq.passes.verdict import assumed_findings, settled_findings, suspected
from stepdiag.daq.recording.archive import digest
from stepdiag.daq.recording.corrections import corrections_in, replay_corrected
from stepdiag.daq.recording.verdicts import Judgement, note_judgement, verdicts_in
from stepdiag.daq.records.survey_folder import EXPORTS, READINGS, REFUSED, RESULT
from stepdiag.daq.replay import Replayed, find_logs
from stepdiag.daq.survey.assumed import assumptions_of
from stepdiag.daq.survey.bundle import (
    active_in,
    compensation_findings,
    compensation_of,
    tables_for,
)
from stepdiag.daq.survey.environment import NAMES
from stepdiag.exporters.export.export import export
from stepdiag.exporters.export.written import ExportReport
from stepdiag.exporters.profiles.file import parse_profile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.safety.levers import left_out
from stepdiag.fourdof.runs import HeadMeasured, evaluate_head, merge_angles
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.model.angles import Angles, parse_angles


@dataclass(frozen=True, slots=True)
class Completed:
    """The outcome of a survey: the folder of the files, the result, the exports, and the reasons of
    refused exports by control.

    ``recorded`` is the folder of the logs; a replay writes into another folder.
    """

    folder: Path
    recorded: Path
    result: Result
    exports: tuple[ExportReport, ...]
    refusals: dict[str, Words]
    language: Literal["en", "de"] = "en"
    """Language of the files for people."""


def complete(paths: Sequence[Path], out: Path, survey_file: Path | None = None) -> Completed:
    """Solve a survey from its logs and write readings, result and exports into ``out``, each file
    completely or not at all.

    ``survey_file`` replaces an unusable survey file in the logs.

    Raises DataError for missing passes, for a survey without a solution, and for an open doubt.
    With an open doubt, only the readings and ``judged.jsonl`` are written. The file
    ``judged.jsonl`` contains the reason. A later completion replaces the readings. A file of a
    complete survey is never replaced. The reason of a refused export is written to
    ``exports/<controller>/REFUSED.txt``; the other exports and the result are written.
    """
    replayed = leave_readings(paths, out, survey_file)
    try:
        computed, _ = solve_logs(replayed)
    except DataError as error:
        note_judgement(
            out,
            Judgement(time_s=time.time(), stops=replayed.book.stops, reason=error.message),
        )
        raise
    _require_settled(replayed, out)
    text = computed.to_json()
    # The numbers of the file are rounded, so they are equal on every processor.
    result = parse_result(text, RESULT)
    exports, refusals = _export_all(replayed, result, out / EXPORTS)
    write_hashed(out / RESULT, text)
    return Completed(
        out, _folder(replayed), result, exports, refusals, replayed.survey.page.language
    )


def leave_readings(
    paths: Sequence[Path], out: Path, survey_file: Path | None = None
) -> Replayed:
    """Write the readings of logs into ``out``, including readings with doubts; return the logs with
    the later verdicts about the readings.

    ``survey_file`` as in `complete`. Raises DataError for missing passes.
    """
    replayed = replay_judged(paths, survey_file)
    _require_all(replayed)
    out.mkdir(parents=True, exist_ok=True)
    _write_readings(out, render_readings(readings_of(replayed)))
    return replayed


def replay_judged(paths: Sequence[Path], survey_file: Path | None = None) -> Replayed:
    """Return logs with the verdicts of persons and of the solver from the files beside them.
    ``survey_file`` as in `complete`. Raises the errors of `find_logs` and `replay`."""
    logs = find_logs(paths)
    verdicts = verdicts_in(logs[0].parent)
    replayed = replay_corrected(logs, survey_file, verdicts.suspicions)
    verdicts.tell(replayed.book)
    return replayed


def solve_logs(
    replayed: Replayed,
    method: str | None = None,
    environment: Mapping[str, float] | None = None,
) -> tuple[Result, str]:
    """Return the result of replayed logs, and its readings as CSV. Raises DataError with every
    missing pass.

    The runs of the 4-DOF head are used by the method `estimate`; the closed forms use only the
    diagonals. ``environment`` contains conditions, by their names in the survey file, that replace
    recorded conditions.
    """
    _require_all(replayed)
    survey = replayed.survey
    readings = readings_of(replayed, environment)
    unmeasured = assumed_conditions(replayed.book, survey, environment or ())
    chosen = method or survey.solver.method
    level = _angles(replayed) or {}
    head = (
        evaluate_head(survey, replayed.book.passes, replayed.files, level)
        if chosen == "estimate"
        else HeadMeasured(angles={})
    )
    angles, twice = merge_angles(level, head.angles)
    without = left_out(active_in(survey, replayed.files)) if angles else None
    if without is not None:
        angles, twice = {}, (without,)
    assumed = with_held(
        assumptions_of(survey),
        survey,
        [*held_conditions(replayed.book, environment or ()), *unmeasured],
    )
    result = solve(
        readings,
        chain=survey.machine.chain,
        method=chosen,
        angles=angles or None,
        straightness=head.straightness,
        assumed=assumed,
    )
    solved = (
        *head.findings,
        *twice,
        *(with_line(survey, each) for each in result.findings),
        *one_scale(survey, result),
        *assumed_findings(survey, len(readings), unmeasured),
    )
    replayed.book.suspect(suspected(replayed.book, solved))
    findings = (
        *proof_findings(survey, replayed.files, readings),
        *compensation_findings(survey),
        *unchecked(survey, {*(one.name for one in unmeasured), *(environment or {})}),
        *clock_findings(replayed.book),
        *settled_findings(replayed.book, solved, stated=environment or {}),
    )
    described = replace(
        with_tolerance(result, survey.tolerance.by_quantity()),
        findings=findings,
        sources=tuple(
            Source(role="log", name=log.path.name, sha256=digest(log.path))
            for log in replayed.logs
        ),
        survey=_facts(replayed),
        conditions=_conditions(replayed, environment or {}, unmeasured),
        history=tuple(dict.fromkeys(replayed.findings)),
    )
    return described, render_readings(readings)


def readings_of(
    replayed: Replayed, environment: Mapping[str, float] | None = None
) -> Readings:
    """Return the readings of replayed logs; ``environment`` as in `solve_logs`."""
    return tabulate(replayed.survey, replayed.book.passes, environment or {})


def _folder(replayed: Replayed) -> Path:
    return replayed.logs[0].path.parent


def _write_readings(out: Path, text: str) -> None:
    files, solved = hashed({out / READINGS: text}), (out / RESULT).exists()
    if solved or not all(holds(path, data) for path, data in files.items()):
        write_together(files, over=not solved)


def _require_settled(replayed: Replayed, out: Path) -> None:
    still = replayed.book.doubts()
    if not still:
        return
    suspects = {doubt for each in replayed.book.passes for doubt in each.suspected}
    named = joined([doubt.words for doubt in still])
    note_judgement(
        out,
        Judgement(
            time_s=time.time(),
            stops=replayed.book.stops,
            reason=named,
            doubts=tuple(each for each in still if each in suspects),
        ),
    )
    command = (
        f"stepdiag accept {shlex.quote(str(_folder(replayed)))} {still[0].place} --reason ..."
    )
    known = still[-1].names_the_cure
    remedy = (
        message("or-accept-by", command=command)
        if known
        else message("again-or-accept-by", command=command)
    )
    raise DataError(
        str(_folder(replayed)), expected=message("undoubted"), found=named, remedy=remedy
    )


def _facts(replayed: Replayed) -> Facts:
    survey, run = replayed.survey, replayed.run
    identity = survey.identity
    begun, ended = (
        datetime.fromtimestamp(edge_s, UTC).strftime("%Y-%m-%d %H:%M UTC")
        for edge_s in span_s(replayed.book)
    )
    facts = Facts(
        machine=identity.machine,
        survey=identity.name,
        operator=run.get("operator", identity.operator),
        workpiece=run.get("workpiece", identity.workpiece),
        date=survey_date(replayed).isoformat(),
        begun=begun,
        ended=ended,
        temperature_note=identity.temperature_note,
        event=identity.event,
        corrected=" | ".join(map(str, corrections_in(_folder(replayed)))),
        **msgspec.structs.asdict(survey.report),
        wavelength_nm=None if survey.laser.compensated else survey.laser.wavelength_nm,
        at_20_c=survey.machine.apply_expansion,
    )
    return compensation_of(survey, replayed.files).facts(facts)


def _conditions(
    replayed: Replayed, environment: Mapping[str, float], unmeasured: Sequence[Held]
) -> Conditions:
    """Return the least and the largest value of each sensor over the used stops, and the conditions
    without a sensor.

    A value in ``environment`` replaces the values of a sensor. An ``unmeasured`` condition has the
    value of the survey file.
    """
    stops = [stop for each in replayed.book.passes for stop in each.chosen().values()]
    seen = {
        name: [value for stop in stops if (value := getattr(stop, name)) is not None]
        for name in NAMES
    }
    ranges = {name: (min(values), max(values)) for name, values in seen.items() if values}
    assumed = {one.name: getattr(replayed.survey.environment, one.name) for one in unmeasured}
    return Conditions(
        **{**ranges, **{name: (value, value) for name, value in environment.items()}},
        assumed=AssumedConditions(**assumed) if assumed else None,
    )


def head_of_logs(replayed: Replayed) -> HeadMeasured:
    """Return the results of the 4-DOF head's runs in replayed logs."""
    return evaluate_head(
        replayed.survey, replayed.book.passes, replayed.files, _angles(replayed) or {}
    )


def survey_date(replayed: Replayed) -> date:
    """Return the day on which the last stop was captured (UTC)."""
    return datetime.fromtimestamp(span_s(replayed.book)[1], UTC).date()


def _require_all(replayed: Replayed) -> None:
    book = replayed.book
    whole = {(each.route.setup, each.number) for each in book.passes if each.whole}
    open_passes = {
        setup: [n for n in book.wanted() if (setup, n) not in whole]
        for setup in replayed.survey.plan.all_setups
    }
    missing = [
        message("setup-passes", setup=setup, numbers=[str(number) for number in numbers])
        for setup, numbers in open_passes.items()
        if numbers
    ]
    if not missing:
        return
    broken = [each for each in book.passes if not each.whole and each.number in book.wanted()]
    why = joined(
        [
            message(
                "setup-pass-why",
                setup=each.route.setup,
                number=each.number,
                why=each.why_incomplete(),
            )
            for each in broken
        ]
    )
    folder = str(_folder(replayed))
    raise DataError(
        folder,
        expected=message("every-pass"),
        found=message("missing", which=missing),
        remedy=why or message("drive-missing"),
    )


def _angles(replayed: Replayed) -> Angles | None:
    name = replayed.survey.solver.angles
    if not name:
        return None
    return parse_angles(_text(replayed, name), name)


def _text(replayed: Replayed, name: str) -> str:
    data = replayed.files.get(name)
    if data is None:
        raise DataError(name, expected=message("named-in-log"), found=message("nothing"))
    return as_text(data, name)


def _export_all(
    replayed: Replayed, result: Result, out: Path
) -> tuple[tuple[ExportReport, ...], dict[str, Words]]:
    written, refusals = [], dict[str, Words]()
    for wanted in replayed.survey.exports:
        folder = out / wanted.controller
        try:
            tables = tables_for(replayed.files, wanted.profile)
            control = controller_named(wanted.controller)
            profile = parse_profile(
                _text(replayed, wanted.profile),
                wanted.profile,
                control,
                result.volume,
                tables,
            )
            written.append(
                export(
                    result,
                    wanted.controller,
                    profile,
                    out_dir=folder,
                    today=survey_date(replayed),
                )
            )
        except (SafetyError, UsageError, DataError) as error:
            refusals[wanted.controller] = (
                message("refusal-with-code", refusal=error.message, code=error.code)
                if isinstance(error, SafetyError)
                else error.message
            )
            _leave_reason(folder, error)
    return tuple(written), refusals


def _leave_reason(folder: Path, error: StepdiagError) -> None:
    code = error.code if isinstance(error, SafetyError) else "refused"
    write_once(folder / REFUSED, f"{code}: {error}\n")
