"""The last check: separate code reads the final text for a control and compares it with the checked
plan.

Whatever fault an earlier step contains, no control gets an invalid number, a power of ten, more
digits than it accepts, positions that do not ascend, or values that differ from the checked
values.
"""

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

from stepdiag.base.errors import SafetyError
from stepdiag.base.findings import Finding, error
from stepdiag.base.messages import Message, message
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.safety.checks import LIMITS, Case, run_checks
from stepdiag.exporters.safety.read_back import differences
from stepdiag.exporters.safety.standing import Standing
from stepdiag.exporters.safety.verdicts.judge import judge

_NO_NUMBER = re.compile(r"(?<![A-Za-z_])(?:nan|inf|infinity)(?![A-Za-z_])", re.IGNORECASE)
_POWER = re.compile(r"(?<![A-Za-z0-9_.])[-+]?\d+(?:\.\d*)?[eE][-+]?\d+(?![A-Za-z0-9_.])")
_NUMBER = re.compile(r"(?<![A-Za-z0-9_.])[-+]?(\d+)(?:\.(\d*))?(?![A-Za-z0-9_.])")
_BARE_POINT = re.compile(r"(?<![0-9])\.\d|--\d|\+-\d|-\+\d")
_DIGITS, _DECIMALS = 12, 9
"""Largest number of digits before and after the point. The identity of a control has twelve digits;
a position in inches has nine decimals.
"""
_PAST = 3
"""Largest number of lines that a refusal names."""


def require_clean(files: Sequence[ControlFile], own: Sequence[ControlFile] = ()) -> None:
    """Raise ``SafetyError`` (code ``file-unsound.text``) for text that a control could misread.

    Notes for people, and unchanged lines of the machine's ``own`` files, are not checked.
    """
    known = {line for file in own for line in file.data.splitlines()}
    for file in files:
        found = [*_suspicious(file, known)][:_PAST] if file.role != "note" else []
        if found:
            raise SafetyError(
                file.name,
                code="file-unsound.text",
                expected=message("plain-numbers", digits=_DIGITS, decimals=_DECIMALS),
                found=message("semicolon-list", items=found),
                remedy=message("report-it-nothing-was"),
            )


def gate_findings(case: Case, standing: Standing) -> Iterator[Finding]:
    """Yield the faults of the tables that a control reads from the written text: differences from
    the checked plan, violations of limits and travel, and wrong tables by the verdicts of `verify`.

    ``standing`` contains the tables of the control after it has read the written text.
    """
    profile, read = case.profile, standing.new
    written = {table.identity for table in read}
    # A file may also contain unchanged old tables of the machine.
    kept = {each.identity: each for each in standing.before if each.identity in written}
    planned = {table.identity: table for table in case.tables}
    for each in differences([*(kept | planned).values()], read):
        yield error("file-unsound.read-back", what=each.words)
    beside = [table for identity, table in kept.items() if identity not in planned]
    yield from run_checks(replace(case, tables=beside), LIMITS)
    yield from (
        Finding(code=each.code, severity="error", text=each.text, message=each.words)
        for each in judge(case.result, read, standing, profile)
        if not each.harmless
    )
    for table in read:
        travel = (
            profile.axis(table.input_axis).travel_mm
            if table.input_axis in profile.axes
            else None
        )
        if travel is None or table.law.ends == "extended" or not table.value_um.any():
            continue  # zeros have no effect at any position: they remove an old table
        step = float(table.position_mm[1] - table.position_mm[0])
        if (
            table.position_mm[0] < travel[0] - step
            or table.position_mm[-1] > travel[1] + step
        ):
            first, last = table.position_mm[[0, -1]]
            yield error(
                "beyond-travel",
                label=table.label,
                first=first,
                last_mm=last,
                low=travel[0],
                high_mm=travel[1],
            )


def _suspicious(file: ControlFile, known: Collection[bytes]) -> Iterator[Message]:
    for number, raw in enumerate(file.data.splitlines(), start=1):
        if raw in known:
            continue
        line = raw.decode("ascii", errors="replace")
        if not raw.isascii():
            yield message("line-not-ascii", line=number)
            continue
        odd = _NO_NUMBER.search(line) or _POWER.search(line) or _BARE_POINT.search(line)
        if odd is None:
            odd = next(
                (
                    each
                    for each in _NUMBER.finditer(line)
                    if len(each[1]) > _DIGITS or len(each[2] or "") > _DECIMALS
                ),
                None,
            )
        if odd is not None:
            yield message("line-holds", line=number, words=odd.group())
