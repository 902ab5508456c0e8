"""The template of the survey file with the answers for a first survey."""

import json
import re
from collections.abc import Iterable
from dataclasses import dataclass

from stepdiag.base.volume import in_step
from stepdiag.daq.survey.controls import control_section
from stepdiag.daq.survey.file import parse_survey
from stepdiag.daq.survey.template import template

OWN_AIR = ("ids3010", "lasertex")
"""Formats of lasers with their own sensors of air and material."""
_BAUDS = {"lasertex": 3_000_000}
_WITHOUT_AIR = ("siemens-828d", "siemens-840dsl", "heidenhain", "none")
_ADVISED = (
    'axis_orders = ["xyz", "yzx", "zxy"]',
    "alternate_orders = true",
    "targets = 40",
)
LEAST, USUAL, MOST = 8, 10, 20
"""Least, usual and largest number of increments in a new survey."""
_ROUNDING_MM = 1e-6
"""Largest difference in mm from whole micrometres that rounding can cause."""
_SILENT = 'transport = "none"\n'


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineClass:
    """The class of a machine for ``[uncertainty]``: a key of `CLASSES`, the machine's feedback from
    `FEEDBACKS`, and the pitch of the screws in mm.
    """

    name: str = "ordinary"
    feedback: str = "screw"
    pitch_mm: float = 10.0

    def settings(self) -> list[tuple[str, str, str]]:
        return [
            ("uncertainty", "machine_class", _quoted(self.name)),
            ("uncertainty", "feedback", _quoted(self.feedback)),
            ("uncertainty", "pitch_mm", str(float(self.pitch_mm))),
        ]


@dataclass(frozen=True, slots=True, kw_only=True)
class Answers:
    """The answers for a first survey: ``control`` is one of `CONTROLS` or "none"; ``tcp_port`` 0
    means the usual port of the control's protocol.
    """

    name: str
    machine: str
    size_mm: tuple[float, float, float]
    laser_port: str
    laser_format: str
    control: str
    host: str = ""
    tcp_port: int = 0
    origin_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    increments: int = 10
    chain: str = "FXYZ"
    compensation: str = "?"
    baud: int = 0
    usual: MachineClass = MachineClass()


def composed(answers: Answers, source: str) -> str:
    """Return the text of the survey file. Raises the reader's UsageError for an impossible
    answer.
    """
    text = _advised()
    for section, key, value in _settings(answers):
        text = _set(text, section, key, value)
    before, _, rest = text.partition("[plc]\n")
    after = rest.partition("[stop]\n")[2]
    text = f"{before}[plc]\n{_plc(answers)}\n[stop]\n{after}"
    parse_survey(text, source)
    return text


def begun(usual: MachineClass, source: str) -> str:
    """Return the template with a class of machine. Raises the reader's UsageError for an impossible
    value.
    """
    text = _advised()
    for section, key, value in usual.settings():
        text = _set(text, section, key, value)
    size_mm = parse_survey(text, source).box.size_mm
    return _set(text, "volume", "increments", str(increments_for(size_mm, usual.pitch_mm)))


def _advised() -> str:
    """Return the template with the recommended settings for a new survey. Each repeat has another
    order of axes. Linear runs have separate targets, because these show the waves of a screw.
    """
    text = template()
    for line in _ADVISED:
        text = text.replace(f"\n#{line}\n", f"\n{line}\n")
    return text


def increments_for(size_mm: Iterable[float], pitch_mm: float) -> int:
    """Return the best number of increments. The steps are whole micrometres, because NC programs
    write whole micrometres. No step should be a whole or half number of turns of a screw
    (`in_step`). If every number has such steps, fewer steps of whole turns are better, then fewer
    steps of half turns. Of several equally good numbers, the number nearest to `USUAL` is returned.
    """
    size = list(size_mm)
    whole = [
        n
        for n in range(LEAST, MOST + 1)
        if all(abs(edge_mm / n - round(edge_mm / n, 3)) < _ROUNDING_MM for edge_mm in size)
    ]

    def unfit(n: int) -> tuple[bool, int, int, int, int]:
        steps = [edge_mm / n for edge_mm in size]
        # `in_step` finds whole and half multiples of a pitch: twice the pitch gives whole turns.
        turns = sum(in_step(step_mm, 2.0 * pitch_mm) for step_mm in steps)
        half_turns = sum(in_step(step_mm, pitch_mm) for step_mm in steps)
        return half_turns > 0, turns, half_turns, abs(n - USUAL), -n

    return min(whole or [USUAL], key=unfit)


def plc_section(control: str, host: str, tcp_port: int) -> str:
    """Return the text below ``[plc]`` for a control at a host; ``tcp_port`` 0 means the usual port
    of the control's protocol.
    """
    section = control_section(control, host)
    line = f"host = {_quoted(host)}\n"
    return section.replace(
        f'host = "{host}"\n', f"{line}port = {tcp_port}\n" if tcp_port else line, 1
    )


def _plc(answers: Answers) -> str:
    return (
        _SILENT
        if answers.control == "none"
        else plc_section(answers.control, answers.host, answers.tcp_port)
    )


def _settings(answers: Answers) -> list[tuple[str, str, str]]:
    air = "fixed" if answers.control in _WITHOUT_AIR else "plc"
    if answers.laser_format in OWN_AIR:
        air = "laser"
    return [
        ("survey", "name", _quoted(answers.name)),
        ("survey", "machine", _quoted(answers.machine)),
        ("volume", "origin_mm", str([float(each) for each in answers.origin_mm])),
        ("volume", "size_mm", str([float(each) for each in answers.size_mm])),
        ("volume", "increments", str(answers.increments)),
        ("machine", "chain", _quoted(answers.chain)),
        ("machine", "compensation", _quoted(answers.compensation)),
        ("laser", "format", _quoted(answers.laser_format)),
        ("laser", "port", _quoted(answers.laser_port)),
        ("laser", "baud", str(answers.baud or _BAUDS.get(answers.laser_format, 115200))),
        ("environment", "source", _quoted(air)),
        *answers.usual.settings(),
    ]


def _set(text: str, section: str, key: str, value: str) -> str:
    pattern = re.compile(rf"(^\[{section}\]\n(?:(?!\[).*\n)*?){key} = .*\n", re.MULTILINE)
    changed, count = pattern.subn(lambda found: f"{found[1]}{key} = {value}\n", text, count=1)
    if count != 1:
        raise ValueError(f"the template has no {section}.{key}")
    return changed


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
