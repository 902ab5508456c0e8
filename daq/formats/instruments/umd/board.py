"""The properties of a uMD board from its low-speed codes.

One line in 32 (uMD0: in 256) contains a code (field 6) with data (field 7); reference: instruments
1.A.
"""

from dataclasses import dataclass
from typing import Literal

from stepdiag.base.messages import Words, message
from stepdiag.daq.formats.instruments.umd.reading import PhaseUse, Reading

SIGNAL_CODES = {1: message("laser-power"), 2: message("signal-strength")}
"""Codes of values without a documented scale: the values are reported, but not used."""
ENVIRONMENT_CODES = {
    3: ("temperature_1_c", 0.01),
    4: ("temperature_2_c", 0.01),
    5: ("pressure_hpa", 0.01),
    6: ("relative_humidity_percent", 0.1),
}
RATE_CODE = 8  # rate / 100 Hz; a uMD1 changes its rate with the REF frequency
FIRMWARE_CODE = 10  # version x 100; from v264 on the sub-version in the high 16 bits
HOMODYNE_CODE = 20  # low byte homodyne axes, next byte counts per cycle
FIRMWARE_FLAGS_CODE = 112  # flags from v264 on; in older firmware a diagnostic value

EIGHT_BIT_PHASE_FLAG = 2
UMD0_RATE_HZ = 244.14
"""Sample rate of a uMD0 in Hz. A uMD0 counts only the lines that it sends, so a lost sample leaves
no gap; uMD1 and uMD2 count samples.
"""
WRONG_PHASE_FIRMWARE = 315
"""Firmware v3.15e of a uMD2 splits the phase wrongly: about half of the values differ by a whole
count.
"""
SPLIT_VERSION_FIRMWARE = range(264, 300)
"""Firmware v264.xx restarts its version numbers after v3.15e (315); uMD1 v60.00 sends 6000."""


@dataclass(frozen=True, slots=True)
class Remark:
    """A remark caused by a low-speed code; the fields are those of `daq.timing.samples.Notice`."""

    code: Literal["rate", "device", "environment"]
    why: Words = ""
    value: float | None = None
    name: str = ""


class Board:
    """The known properties of a uMD board. ``phase_bits`` (8 or 16) overrides the width of the
    phase field that the firmware sends.
    """

    def __init__(self, phase_bits: int | None) -> None:
        self.rate_hz: float | None = None
        self._homodyne: bool | None = None
        self._counts_per_cycle = 1
        self._phase_bits = phase_bits
        self._codes: dict[int, int] = {}
        self.reading = self._read()
        """The rules for the next lines; a change of the board's properties creates a new object."""

    @property
    def counts_every_sample(self) -> bool:
        """Return whether a lost sample leaves a gap in the sequence number; False until the rate
        excludes a uMD0.
        """
        return self.rate_hz is not None and abs(self.rate_hz / UMD0_RATE_HZ - 1) > 0.01

    def knows(self, code: int, data: int) -> bool:
        return self._codes.get(code) == data

    def hear(self, code: int, data: int) -> Remark | None:
        """Process a low-speed code with its data, and return its remark. A value of air or material
        always has a remark; any other code has a remark only if its data changed.
        """
        if code in ENVIRONMENT_CODES:
            name, scale = ENVIRONMENT_CODES[code]
            return Remark("environment", value=data * scale, name=name)
        if self._codes.get(code) == data:
            return None
        self._codes[code] = data
        remark = self._learn(code, data)
        self.reading = self._read()
        return remark

    def _learn(self, code: int, data: int) -> Remark | None:
        if code == RATE_CODE:
            return self._hear_rate(data)
        if code == HOMODYNE_CODE:
            return self._hear_homodyne(data)
        if code == FIRMWARE_CODE:
            return self._hear_firmware(data)
        if code in SIGNAL_CODES:
            return Remark("device", SIGNAL_CODES[code], float(data))
        return None

    def _hear_rate(self, data: int) -> Remark:
        if data <= 0:
            return Remark("device", message("rate-not-used", rate=str(data / 100)))
        self.rate_hz = data / 100
        return Remark("rate", value=self.rate_hz)

    def _hear_homodyne(self, data: int) -> Remark:
        axes, counts = data & 0xFF, (data >> 8) & 0xFF
        self._homodyne = axes > 0
        self._counts_per_cycle = max(counts, 1) if self._homodyne else 1
        return Remark(
            "device",
            message("homodyne", axes=axes, counts=self._counts_per_cycle),
            float(axes),
        )

    def _hear_firmware(self, data: int) -> Remark:
        version = data & 0xFFFF
        wrong = self._phase_bits is None and version == WRONG_PHASE_FIRMWARE
        return Remark(
            "device",
            message("firmware-phase", number=version)
            if wrong
            else message("firmware", number=version),
            float(version),
        )

    def _read(self) -> Reading:
        return Reading(
            rate_hz=self.rate_hz,
            homodyne=self._homodyne,
            counts_per_cycle=self._counts_per_cycle,
            phase_use=self._phase_use(),
        )

    def _phase_use(self) -> PhaseUse:
        if self._phase_bits is not None:
            return "8-bit" if self._phase_bits == 8 else "16-bit"
        firmware = self._codes.get(FIRMWARE_CODE)
        if firmware is None:
            return "unknown"
        if firmware < 0x10000 and firmware not in SPLIT_VERSION_FIRMWARE:
            return "ignored" if firmware == WRONG_PHASE_FIRMWARE else "8-bit"
        flags = self._codes.get(FIRMWARE_FLAGS_CODE)
        if flags is None:
            return "unknown"
        return "8-bit" if flags & EIGHT_BIT_PHASE_FLAG else "16-bit"
