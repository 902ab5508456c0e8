"""The common interface of all controls, for every protocol: open a link, read, write, and close."""

from collections.abc import Mapping, Sequence
from typing import Protocol

from stepdiag.daq.links.controls import lsv2, modbus, s7
from stepdiag.daq.links.controls.modbus_errors import RefusedRequestError
from stepdiag.daq.links.ports.lateness import Lateness
from stepdiag.daq.records.events import ModbusBlock, ReadRange

MachineSettings = modbus.ModbusSettings | s7.S7Settings | lsv2.Lsv2Settings


class MachineLink(Protocol):
    lateness: Lateness

    @property
    def refusals(self) -> Mapping[ReadRange, RefusedRequestError]:
        """The ranges that the control refused in the last poll, with the errors."""
        ...

    async def read(self) -> ModbusBlock:
        """Poll the ranges. A refused range has no data (``b""``) and is listed in ``refusals``.

        Raises RefusedRequestError if every range is refused, another DeviceError if the control
        does not answer.
        """
        ...

    async def write_word(self, table: str, address: int, value: int) -> None:
        """Write the low 16 bits of ``value``. Raises the errors of ``read``."""
        ...

    def close(self) -> None: ...


async def open_machine(settings: MachineSettings, ranges: Sequence[ReadRange]) -> MachineLink:
    """Connect to the control, to read ``ranges``. Raises DeviceError if the control is absent or
    refuses.
    """
    if isinstance(settings, s7.S7Settings):
        return await s7.open_link(settings, ranges)
    if isinstance(settings, lsv2.Lsv2Settings):
        return await lsv2.open_link(settings, ranges)
    return await modbus.open_link(settings, ranges)
