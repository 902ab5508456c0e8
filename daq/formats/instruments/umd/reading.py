"""From the numbers of a uMD line to interferometer cycles and flags.

The rules are those of the display's own program (reference: instruments 1.A), which subtracts the
phase. A second public decoder adds the phase, but its author calls the result wrong.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stepdiag.daq.formats.framing.batch import mark
from stepdiag.daq.timing.samples import Flag

PhaseUse = Literal["unknown", "8-bit", "16-bit", "ignored"]

_PHASE_STEPS = {"8-bit": 256.0, "16-bit": 65536.0}
_PHASE_ERRORS = 0x7E00
"""Bits of the phase field that report a missing first or second REF edge or a missing MEAS edge,
and the bits of the corresponding edges at the board's port PORTB. A negative phase is valid.
"""
_SLEW_MARGIN_HZ = 100_000.0
"""Margin of the slew limits in Hz. The target is too fast for the board if MEAS is below 0.1 MHz,
or above twice REF minus 0.1 MHz.
"""

Column = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """Rules for the lines of a uMD board. ``rate_hz`` converts counts per sample to frequencies;
    ``homodyne`` is None until the board sends this property.
    """

    rate_hz: float | None
    homodyne: bool | None
    counts_per_cycle: int
    phase_use: PhaseUse

    def interpret(
        self, ref: Column, meas: Column, displacement: Column, phase: Column
    ) -> tuple[NDArray[np.float64], NDArray[np.uint16]]:
        """Return the displacement in cycles and the `Flag` bits, both of shape (rows,). A cycle is
        half a wavelength divided by the optics factor.
        """
        flags = np.zeros(len(ref), dtype=np.uint16)
        counts = displacement.astype(np.float64)
        if phase.any():
            counts -= self._fraction(phase, flags)
        if not self.homodyne:
            self._judge_beam(ref, meas, flags)
        if self.homodyne is None:
            counts[ref == 0] = (
                np.nan
            )  # without REF the head has no light, or the board counts quarters of a cycle
        return counts / self.counts_per_cycle, flags

    def _fraction(self, phase: Column, flags: NDArray[np.uint16]) -> NDArray[np.float64]:
        if self.phase_use == "16-bit":
            return phase / _PHASE_STEPS["16-bit"]
        wrong = ((phase & _PHASE_ERRORS) != 0) & (phase >= 0)
        if self.phase_use == "unknown":
            wrong = phase != 0
        if self.phase_use == "ignored":
            mark(flags, wrong, Flag.PHASE_ERROR)
            return np.zeros(len(phase))
        fraction = phase / _PHASE_STEPS["8-bit"]
        if wrong.any():
            mark(flags, wrong, Flag.PHASE_ERROR)
            fraction[wrong] = 0.0
        return fraction

    def _judge_beam(self, ref: Column, meas: Column, flags: NDArray[np.uint16]) -> None:
        """Flag lost beams and slew errors from the counts of REF and MEAS per sample. A homodyne
        board sends neither REF nor MEAS.
        """
        if not (ref.all() and meas.all()):
            mark(flags, ref == 0, Flag.HEAD_ERROR)
            mark(flags, meas == 0, Flag.BEAM_LOST)
        if self.rate_hz is None:
            return
        margin = _SLEW_MARGIN_HZ / self.rate_hz
        too_fast = (meas < margin) | (meas > 2 * ref - margin)
        if too_fast.any():
            mark(flags, too_fast & (ref > 0) & (meas > 0), Flag.SLEW)
