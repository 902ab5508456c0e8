"""The readable report of an export: plain text for the service engineer. Equal exports give equal
bytes.
"""

import hashlib
from collections.abc import Iterator, Sequence

from stepdiag.base.compensation import stated_in
from stepdiag.base.findings import Finding
from stepdiag.base.result.basis import Basis, basis_of, scales_in_words
from stepdiag.exporters.files.numbers import fixed
from stepdiag.exporters.safety.checks import Case, movement_um
from stepdiag.exporters.safety.read_back import BEFORE, STEPS
from stepdiag.exporters.safety.state import proof_needed
from stepdiag.exporters.safety.verify import Prediction
from stepdiag.exporters.tables.controller import Plan
from stepdiag.exporters.tables.tables import Table


def report_text(
    case: Case, plan: Plan, findings: Sequence[Finding], prediction: Prediction
) -> str:
    sections = (
        _head(case),
        _findings(findings),
        _effect(case, prediction, unproven=proof_needed(findings)),
        _basis(basis_of(case.result)),
        _tables(case, plan),
        _changes(case),
        _steps(case),
    )
    return "\n".join(line for section in sections for line in (*section, ""))


def _head(case: Case) -> Iterator[str]:
    result, machine = case.result, case.profile.machine
    yield f"Compensation for {case.controller.title}"
    yield f"machine: {machine.name}; profile: {case.profile.source}"
    yield (
        f"result: sha256 {hashlib.sha256(result.to_json().encode()).hexdigest()}, method "
        f"{result.method}, chain {result.chain}"
    )
    yield (
        f"written by {result.software.name} {result.software.version}; lengths in mm, errors in "
        "µm, e = actual - commanded"
    )
    yield f"directions: {machine.direction}; compensation while measuring: {_state(case)}"
    for letter, axis in case.profile.axes.items():
        yield (
            f"axis {letter}: {axis.name}, {case.profile.grid_words(letter)}, zero at "
            f"{axis.reference_mm:g}"
        )
    for curve in case.curves:
        yield f"{curve.name} = {' + '.join(curve.parts)}"


def _state(case: Case) -> str:
    statement = stated_in(case.result)
    return (
        statement.words()
        if statement.state
        else f"{case.profile.machine.measured_with} (as the profile says)"
    )


def _findings(findings: Sequence[Finding]) -> Iterator[str]:
    yield "REMARKS"
    for severity in ("error", "warning", "info"):
        yield from (
            f"  {severity:<8} {item.code}: {item.words}"
            for item in findings
            if item.severity == severity
        )


def _effect(case: Case, prediction: Prediction, *, unproven: bool) -> Iterator[str]:
    yield "PREDICTED VOLUMETRIC ERROR anywhere in the volume, in µm (k = 2)"
    if unproven:
        yield "  NO PROMISE before the proof run (`stepdiag proof`): see compensation-contradicted"
    yield f"  {'':<30}{'rms':>16}{'largest':>16}"
    for name, figures in prediction.predicted.parts().items():
        for when, found in figures.items():
            yield (
                "  "
                f"{name + ', ' + when:<30}{found.rms_um.words()!s:>16}"
                f"{found.largest_um.bound()!s:>16}"
            )
    if any(not scale.identified for scale in case.result.scale.values()):
        yield (
            "  scales that the survey does not identify are in neither figure: measure linear "
            "runs to see and to correct them"
        )
    yield (
        "  what remains: what angles do away from the middle (no table of one axis holds it), "
        "the rounding, and the curves between points"
    )


def _basis(found: Basis) -> Iterator[str]:
    yield "WHAT TABLES AND U REST ON"
    names = {"as_measured": "as measured", "at_20_c": "at 20 C"}
    if found.tables is not None:
        warm = (
            "how warm the machine was, was not measured throughout"
            if found.material_c is None
            else f"the machine was {found.material_c:.2f} C warm"
        )
        yield f"  the tables correct lengths {names[found.tables]}; {warm}"
        if found.scales:
            yield f"  scales {names[found.tables]}, µm/m (k = 2): {scales_in_words(found.scales)}"
        yield (
            f"  scales {names[found.beside]}, in no table: "
            f"{scales_in_words(found.other) or 'not known'}"
        )
    yield from (
        f"  {name} {value:g}: assumed where no sensor measured it"
        for name, value in found.air.items()
    )
    yield from (f"  {name:<24}{value:>12g}" for name, value in found.assumed.items())
    if found.tool_um is not None:
        yield (
            "  errors hold where the beam met the mirror (tool offset 0); a tool tip 100 mm "
            f"from it may differ by {found.tool_um:.1f} µm"
        )


def _tables(case: Case, plan: Plan) -> Iterator[str]:
    for kind in dict.fromkeys(table.kind for table in plan.tables):
        law = next(table.law for table in plan.tables if table.kind == kind)
        yield f"LAW of {kind}: {law.words}"
    for table in plan.tables:
        yield from (
            "",
            f"TABLE {table.label}, one unit is {table.quantum_um:g} µm",
            *_report_rows(case, table),
        )
    for table in plan.listed:
        yield from (
            "",
            f"NOT IN ANY FILE: {table.label}, one unit is {table.quantum_um:g} µm",
            *_report_rows(case, table),
        )


def _report_rows(case: Case, table: Table) -> Iterator[str]:
    yield from (f"  {row}" for row in case.controller.readable(table, case.profile))


def _changes(case: Case) -> Iterator[str]:
    for table in case.tables:
        before = [old for old in case.previous if old.name == table.name]
        if before:
            yield f"CHANGE of {table.label}: movement in µm"
            yield f"  {'position mm':>14} {'old':>10} {'new':>10} {'change':>10}"
            old, new = movement_um(table, before), movement_um(table, [table])
            for at, was, will in zip(table.position_mm, old, new, strict=True):
                yield (
                    f"  {at:>14.4f} {fixed(was, 3):>10} {fixed(will, 3):>10} "
                    f"{fixed(will - was, 3):>10}"
                )


def _before(case: Case) -> Iterator[str]:
    if case.controller.name in BEFORE:
        yield (
            f"{BEFORE[case.controller.name]}, and compare: `stepdiag verify RESULT FOLDER "
            "--profile PROFILE --before FILE...`. Load only where it ends with exit code 0."
        )


def _steps(case: Case) -> Iterator[str]:
    yield "LOADING"
    untested = (
        "Files named _UNTESTED_SIGN: make the sign test first, then export again with its record "
        "in the profile."
    )
    steps = (*_before(case), *case.controller.instructions(case.profile), untested)
    yield from (f"  {number}. {step}" for number, step in enumerate(steps, start=1))
    if case.controller.name in STEPS:
        yield "READ BACK"
        yield f"  1. {STEPS[case.controller.name]}"
        yield (
            "  2. stepdiag verify RESULT FOLDER --profile PROFILE --read-back FILE: every number "
            "and switch, as the control holds it now."
        )
    yield "CHECK AFTER LOADING"
    yield (
        "  1. Reference all axes. Drive to the reference position: no jump when the table is "
        "switched on."
    )
    yield (
        "  2. Measure one axis again: the residual must be smaller than before; otherwise load "
        "the restore files."
    )
    yield "  3. Measure the diagonals again, and lines that were not part of the survey."
