"""Writes the NC programs of a survey for a control."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from stepdiag.base.errors import SafetyError, UsageError
from stepdiag.base.messages import message
from stepdiag.base.names import AXES
from stepdiag.base.volume import ROUNDING_MM
from stepdiag.exporters.programs.dialect import Dialect, Job
from stepdiag.exporters.programs.fanuc import Fanuc
from stepdiag.exporters.programs.heidenhain import Heidenhain
from stepdiag.exporters.programs.linuxcnc import LinuxCNC
from stepdiag.exporters.programs.sequence import Sequence, check
from stepdiag.exporters.programs.sequence import travel_mm as travel_of
from stepdiag.exporters.programs.siemens import Siemens
from stepdiag.exporters.programs.signals import Signals

_DIALECTS: Mapping[str, Dialect] = MappingProxyType(
    {dialect.control: dialect for dialect in (Fanuc(), Siemens(), Heidenhain(), LinuxCNC())}
)
CONTROLS = tuple(_DIALECTS)
"""The controls for which `nc_programs` can write."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """An NC program: its file name, its setup, and the bytes of the file (ASCII with the control's
    line ends).
    """

    name: str
    setup: str
    data: bytes


def nc_programs(
    sequence: Sequence,
    control: str,
    *,
    signals: Signals | None = None,
    decimals: int | None = None,
    travel_mm: Mapping[str, tuple[float, float]] | None = None,
) -> tuple[Program, ...]:
    """Return one program for each setup of the sequence, in the order of the setups.

    ``signals`` contains the texts of this machine (None: the control's defaults). ``decimals`` is
    the number of decimal places of the control's input increment in mm. ``travel_mm`` contains the
    software limits by axis (x, y, z).

    Raises ``UsageError`` for an unknown control, a sequence that cannot be driven, a position that
    the control would round, and a handshake without a text that waits for the PLC. Raises
    ``SafetyError`` (code ``beyond-travel.program``) if a stop or an approach is outside
    ``travel_mm``.
    """
    check(sequence)
    _keep_within(sequence, travel_mm or {})
    dialect = _dialect(control)
    chosen = signals or dialect.signals
    if sequence.handshake and not chosen.wait:
        raise UsageError(
            f"{control}: program.wait",
            expected=message("block-waits-until-plc"),
            found=message("nothing"),
            remedy=message("ask-machine-builder-for"),
        )
    jobs = [
        Job(
            sequence=sequence,
            setup=setup,
            signals=chosen,
            decimals=dialect.decimals if decimals is None else decimals,
        )
        for setup in sequence.setups
    ]
    return tuple(
        Program(
            name=dialect.file_name(job),
            setup=job.setup,
            data=dialect.render(job).encode("ascii"),
        )
        for job in jobs
    )


def _keep_within(sequence: Sequence, limits_mm: Mapping[str, tuple[float, float]]) -> None:
    for setup in sequence.setups:
        low, high = travel_of(sequence, setup)
        for index, axis in enumerate(AXES):
            least, most = limits_mm.get(axis, (-math.inf, math.inf))
            if low[index] < least - ROUNDING_MM or high[index] > most + ROUNDING_MM:
                raise SafetyError(
                    f"plan.setups: {setup}, {axis.upper()}",
                    code="beyond-travel.program",
                    expected=message("positions-within-travel", least_mm=least, most_mm=most),
                    found=message(
                        "to-mm-overrun-included", low_mm=low[index], high_mm=high[index]
                    ),
                    remedy=message("smaller-plan-overrun-mm"),
                )


def default_signals(control: str) -> Signals:
    return _dialect(control).signals


def default_decimals(control: str) -> int:
    return _dialect(control).decimals


def program_name(sequence: Sequence, control: str, setup: str) -> str:
    """Return the file name under which the operator starts the program of a setup (``O8002`` for
    npp on Fanuc).
    """
    dialect = _dialect(control)
    return dialect.file_name(
        Job(
            sequence=sequence, setup=setup, signals=dialect.signals, decimals=dialect.decimals
        )
    )


def _dialect(control: str) -> Dialect:
    if control not in _DIALECTS:
        raise UsageError(
            "controller", expected=message("one-of", names=CONTROLS), found=repr(control)
        )
    return _DIALECTS[control]
