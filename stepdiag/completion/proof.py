"""The proof run as a separate survey: its survey file, and its verdict after the last pass."""

import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime
from pathlib import Path, PurePath

import msgspec

from stepdiag.base.files import as_text
from stepdiag.base.findings import Finding, Severity, finding
from stepdiag.base.messages import Message, message
from stepdiag.base.readings.readings import Readings, parse_readings
from stepdiag.base.result.result import Result, parse_result
from stepdiag.daq.records.survey_folder import READINGS, RESULT
from stepdiag.daq.survey.amended import as_proof
from stepdiag.daq.survey.bundle import active_in, read_bundle, tables_for
from stepdiag.daq.survey.file import parse_survey, read_text
from stepdiag.daq.survey.models import Proof as Section
from stepdiag.daq.survey.models import Survey
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.profiles.file import parse_profile, quick_profile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.proof.judge import Proof, Proved, prove
from stepdiag.exporters.proof.plan import ProofPlan, plan_proof
from stepdiag.exporters.safety.sign_evidence import subject
from stepdiag.exporters.safety.verdicts.lattice import parts_of
from stepdiag.exporters.safety.verdicts.verdict import Code
from stepdiag.exporters.safety.verify import acting_in
from stepdiag.exporters.tables import lattice
from stepdiag.exporters.tables.controller import Controller
from stepdiag.exporters.tables.profile import Profile, SignTestRecord
from stepdiag.exporters.tables.tables import Table

_STATES: Mapping[Code | None, Message] = {
    "right": message("proof-right"),
    "sign-turned": message("proof-turned"),
    "missing": message("proof-missing"),
    "scaled": message("proof-scaled"),
    "axes-swapped": message("proof-swapped"),
    None: message("proof-open"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ProofFiles:
    """Paths for the plan of a proof run: the survey file, the folders of the result and of the
    export, and the profile."""

    survey: Path
    round: Path
    loaded: Path
    profile: Path | None
    controller: str

    def beside(self, path: Path) -> str:
        """Return a path relative to the folder of the survey file."""
        return PurePath(os.path.relpath(path, self.survey.parent)).as_posix()


def planned(
    given: ProofFiles, acting: Sequence[Path], minutes: float
) -> tuple[ProofPlan, str]:
    """Return the plan of a proof run for the active files ``acting``, and the survey file of the
    proof run. Raises the errors of `loaded_in` and `plan_proof`."""
    text = read_text(given.survey)
    survey = parse_survey(text, given.survey.name)
    proof = Section(
        controller=given.controller,
        result=given.beside(given.round / RESULT),
        readings=given.beside(given.round / READINGS),
        profile="" if given.profile is None else given.beside(given.profile),
    )
    active = [given.beside(path) for path in acting]
    name, day = (
        f"{survey.identity.name}-proof-{given.round.name}",
        datetime.now(tz=UTC).date(),
    )

    def with_setups(setups: Sequence[str], repeats: int) -> str:
        plan = msgspec.structs.replace(
            survey.plan,
            setups=tuple(setups),
            repeats=repeats,
            axis_orders=survey.plan.axis_orders[
                : None if survey.plan.alternate_orders else 1
            ],
            beam_offset=(),
        )
        return as_proof(
            text, given.survey.name, name=name, plan=plan, active=active, day=day, proof=proof
        )

    draft = parse_survey(with_setups(survey.plan.setups, 1), given.survey.name)
    held = loaded_in(draft, read_bundle(given.survey, draft))
    if held is None:
        raise AssertionError("a survey file with a section [proof]")
    plan = plan_proof(held.result, held.readings, survey.planned, held.tables()[0], minutes)
    return plan, with_setups(plan.setups, plan.repeats)


@dataclass(frozen=True, slots=True, kw_only=True)
class Loaded:
    """The basis of a proof run: the earlier survey's result and readings, and the loaded files."""

    result: Result
    readings: Readings
    controller: Controller
    profile: Profile
    files: tuple[ControlFile, ...]

    def tables(self) -> tuple[tuple[Table, ...], tuple[Table, ...]]:
        """Return the tables that are active now, and the tables that were active during the earlier
        survey. A lattice is represented by its curves and products."""
        if len(self.files) == 1 and lattice.recognises(self.files[0]):
            on = self.profile.machine.measured_with == "on"
            return self._parts(self.files), self._parts(self.profile.existing if on else ())
        return acting_in(self.result, self.controller, self.files, self.profile)

    def _parts(self, files: Sequence[ControlFile]) -> tuple[Table, ...]:
        held = [lattice.parse(file) for file in files if lattice.recognises(file)]
        return tuple(
            part
            for each in held
            for part in parts_of(each.correction_um, each.axes_mm, self.result.volume)
        )


def loaded_in(survey: Survey, files: Mapping[str, bytes]) -> Loaded | None:
    """Return the basis of a proof run from the ``files`` in its survey file, or None for any other
    survey.

    Raises DataError or UsageError for a damaged file.
    """
    if survey.proof is None:
        return None
    named, control = survey.proof, controller_named(survey.proof.controller)
    result = parse_result(as_text(files[named.result], named.result), named.result)
    profile = (
        parse_profile(
            as_text(files[named.profile], named.profile),
            named.profile,
            control,
            result.volume,
            tables_for(files, named.profile),
        )
        if named.profile
        else quick_profile(control, result.volume)
    )
    return Loaded(
        result=result,
        readings=parse_readings(
            as_text(files[named.readings], named.readings), named.readings
        ),
        controller=control,
        profile=profile,
        files=tuple(
            ControlFile(name=PurePath(name).name, data=data)
            for name, data in active_in(survey, files).items()
        ),
    )


def proof_of(survey: Survey, files: Mapping[str, bytes], readings: Readings) -> Proof | None:
    """Return the verdict about a proof run from its readings, or None for any other survey. Raises
    the errors of `loaded_in`."""
    held = loaded_in(survey, files)
    return (
        None if held is None else prove(held.result, held.readings, readings, *held.tables())
    )


def proof_findings(
    survey: Survey, files: Mapping[str, bytes], readings: Readings
) -> Iterator[Finding]:
    """Yield the finding with the verdict about a proof run; nothing for any other survey. Raises
    the errors of `loaded_in`."""
    found = proof_of(survey, files, readings)
    if found is not None:
        severity: Mapping[str, Severity] = {
            "keep": "info",
            "restore": "error",
            "undecided": "warning",
        }
        yield finding(severity[found.action], action_words(found))


def action_words(proof: Proof) -> Message:
    """Return the finding with the verdict about a proof run and the next action."""
    wrong, undecided = (
        [words_of(each) for each in proof.tables if each.state == state]
        for state in ("wrong", "undecided")
    )
    if wrong:
        return message("proof.wrong", wrong=wrong)
    if undecided:
        further = proof.further
        return (
            message("proof.undecided", open=undecided, further=further)
            if further
            else message("proof.open", open=undecided)
        )
    factors = [
        message("proof-factor", name=each.function, factor=each.factor, expanded=2.0 * each.u)
        for each in proof.tables
    ]
    return message("proof", each=factors)


def words_of(each: Proved) -> Message:
    """Return the message with the verdict about the tables of one function."""
    return message(
        "proof-table",
        name=each.function,
        state=_STATES[each.code],
        factor=each.factor,
        expanded=2.0 * each.u,
    )


def sign_records(
    held: Loaded, proof: Proof, runs: bytes, day: date
) -> Iterator[SignTestRecord]:
    """Yield, for each kind of table, the sign that a proof run showed, as an entry of a profile;
    nothing if the tables must be removed."""
    if proof.action != "keep":
        return
    about, senses = (
        subject(held.controller.name, held.profile),
        {table.kind: table.law.sense for table in held.tables()[0]},
    )
    for kind in dict.fromkeys(each.kind for each in proof.tables):
        yield SignTestRecord(
            kind=kind,
            date=day,
            verdict=senses[kind],
            machine=about.machine,
            control=about.control,
            measuring_system=about.system,
            function=next(each.function for each in proof.tables if each.kind == kind),
            bump_sha256=[hashlib.sha256(file.data).hexdigest() for file in held.files],
            runs_sha256=[hashlib.sha256(runs).hexdigest()],
        )
