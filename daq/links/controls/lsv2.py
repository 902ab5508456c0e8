"""Heidenhain controls over LSV2 (TCP 19000): the only user of pyLSV2 (extra ``stepdiag[lsv2]``).

Values that the NC program passes to the PLC with FN 19 are double words in the PLC's memory, low
byte first. Reading this memory needs the login PLCDEBUG. The library's safe mode excludes this
login together with writing, so safe mode is off; this module never writes.
"""

import errno
import logging
import os
import socket
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from stepdiag.base.errors import DeviceError
from stepdiag.base.messages import Message, message
from stepdiag.daq.links.controls.blocking import (
    CONNECT_S,
    BlockingLink,
    Waiter,
    hang_up,
    not_installed,
    opened,
    silent,
    unreachable,
)
from stepdiag.daq.links.controls.modbus_errors import (
    LostConnectionError,
    RefusedRequestError,
    lost,
)
from stepdiag.daq.links.ports.device import LARGEST_READ
from stepdiag.daq.records.events import ReadRange

if TYPE_CHECKING:
    from pyLSV2 import LSV2

_LARGEST_ANSWER = 1_000_000
"""Largest answer in bytes. A read of a PLC's memory has 255 bytes, but a faulty device can send
gigabytes while the connection is being made.
"""
_MEMORIES = {"B": "BYTE", "M": "MARKER", "I": "INPUT", "O": "OUTPUT"}
_FIREWALL = message("firewall-lsv2")


@dataclass(frozen=True, slots=True, kw_only=True)
class Lsv2Settings:
    host: str
    port: int = 19000
    timeout_s: float = 0.3

    @property
    def address(self) -> str:
        return f"LSV2 {self.host}:{self.port}"


class Lsv2Link(BlockingLink):
    def __init__(
        self,
        settings: Lsv2Settings,
        ranges: Sequence[ReadRange],
        client: "LSV2",
        waiter: Waiter,
    ) -> None:
        super().__init__(settings.address, settings.timeout_s, ranges, waiter)
        self._client = client

    def _fetch(self, wanted: ReadRange) -> bytes:
        from pyLSV2.const import MemoryType
        from pyLSV2.err import LSV2InputException

        what = message(
            "reading-memory", count=wanted.count, table=wanted.table, address=wanted.address
        )
        try:
            values = self._client.read_plc_memory(
                wanted.address, MemoryType[_MEMORIES[wanted.table]], wanted.count
            )
        except LSV2InputException as error:
            remedy = message("do-memory")
            raise RefusedRequestError(
                self._address,
                expected=message("expects-answer-to", what=what),
                found=str(error),
                remedy=remedy,
            ) from error
        except TimeoutError as error:
            raise silent(self._address, self._timeout_s) from error
        except OSError as error:
            raise lost(self._address) from error
        except Exception as error:
            raise _senseless(self._address, error) from error
        if not values:
            remedy = message("do-symbolic")
            raise RefusedRequestError(
                self._address,
                expected=message("expects-answer-to", what=what),
                found=_answer_of(self._client),
                remedy=remedy,
            )
        return bytes(int(value) & 0xFF for value in values)

    def _write(self, table: str, address: int, value: int) -> None:
        raise RefusedRequestError(
            self._address,
            expected=message("expects-not-written"),
            found=message("found-count-for", count=value, table=table, address=address),
        )


@dataclass(slots=True)
class _Line:
    """The socket for the library. A connection that ends within an answer raises an error, and an
    answer has a largest length.

    Without this class the library reads from an ended connection for ever, and allocates as much
    memory as the device requests.
    """

    socket: Any
    answered: int = 0

    def send(self, data: bytes) -> int:
        self.answered = 0
        return int(self.socket.send(data))

    def recv(self, count: int) -> bytes:
        """Return the bytes that have arrived. Raises ConnectionResetError at the end of the
        connection, ValueError for a too long answer.
        """
        data: bytes = self.socket.recv(min(count, LARGEST_READ))
        if not data:
            raise ConnectionResetError(errno.ECONNRESET, os.strerror(errno.ECONNRESET))
        self.answered += len(data)
        if self.answered > _LARGEST_ANSWER:
            raise ValueError(f"an answer of more than {_LARGEST_ANSWER} bytes")
        return data

    def __getattr__(self, name: str) -> Any:
        return getattr(self.socket, name)


async def open_link(settings: Lsv2Settings, ranges: Sequence[ReadRange]) -> Lsv2Link:
    """Connect to the control, to read ``ranges``. Raises LostConnectionError with the reason of a
    failure.
    """
    try:
        from pyLSV2 import LSV2
    except ImportError as error:
        raise not_installed(settings.address, "lsv2") from error
    _hush()
    made: list[LSV2] = []

    def connect() -> None:
        try:
            made.append(LSV2(settings.host, settings.port, CONNECT_S, safe_mode=False))
        except OSError as error:
            raise _no_connection(settings, error) from error
        _connect(made[0], settings)

    def end() -> None:
        for each in made:
            hang_up(_socket(each))

    def close() -> None:
        for each in made:
            _socket(each).close()

    waiter = Waiter("lsv2", end, close)
    await opened(waiter, connect, settings.address, 3.0 * CONNECT_S)
    return Lsv2Link(settings, ranges, made[0], waiter)


def _connect(client: "LSV2", settings: Lsv2Settings) -> None:
    from pyLSV2.const import Login

    low = client._llcom  # noqa: SLF001 - the library has no other way to its socket
    low._tcpsock = _Line(low._tcpsock)  # noqa: SLF001
    try:
        client.connect()
        allowed = client.login(Login.PLCDEBUG)
    except OSError as error:
        raise (
            _unanswered(settings)
            if low._is_connected and isinstance(error, TimeoutError)  # noqa: SLF001
            else _no_connection(settings, error)
        ) from error
    except Exception as error:
        raise _senseless(settings.address, error) from error
    if not allowed:
        remedy = message("do-password")
        raise LostConnectionError(
            settings.address,
            expected=message("expects-login"),
            found=_answer_of(client),
            remedy=remedy,
        )
    _socket(client).settimeout(settings.timeout_s)


def _no_connection(settings: Lsv2Settings, error: OSError) -> DeviceError:
    found, remedy = unreachable(error, CONNECT_S, message("protocol-lsv2"), _FIREWALL)
    return LostConnectionError(
        settings.address, expected=message("expects-lsv2"), found=found, remedy=remedy
    )


def _unanswered(settings: Lsv2Settings) -> DeviceError:
    remedy = message("do-nobody-lsv2")
    return LostConnectionError(
        settings.address,
        expected=message("expects-lsv2"),
        found=message("found-silence-for", seconds_s=CONNECT_S),
        remedy=remedy,
    )


def _senseless(address: str, error: Exception) -> DeviceError:
    """Return the error for an answer outside the protocol, for which the library may raise any
    error.

    The connection is then closed: answers have no number, so the rest of the answer would be read
    as the next answer.
    """
    remedy = message("do-other-product")
    found = message("found-other-bytes", bytes=f"{type(error).__name__}: {str(error)[:120]}")
    return LostConnectionError(
        address, expected=message("expects-lsv2"), found=found, remedy=remedy
    )


def _answer_of(client: "LSV2") -> Message:
    return message("found-refusal", what=client.last_error.e_code.name)


def _socket(client: "LSV2") -> socket.socket:
    found: socket.socket = client._llcom._tcpsock  # noqa: SLF001
    return found


def _is_of_others(record: logging.LogRecord) -> bool:
    return "pyLSV2" not in record.pathname


def _hush() -> None:
    """Keep the library's log entries out of the journal, because the reconnector reports each error
    once. Some entries come from the root logger.
    """
    for name in ("LSV2 Client", "LSV2 TCP"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    root = logging.getLogger()
    root.addFilter(_is_of_others)  # adding the same function again has no effect
