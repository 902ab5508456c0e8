"""Siemens controls over S7 communication (ISO on TCP, port 102): the only user of python-snap7
(extra ``stepdiag[s7]``).

One telegram requests all ranges, so a block contains the values of one moment of the control's
cycle. python-snap7 repeats no request: after a missing answer the connection is closed, and the
next connection requests the present values.
"""

import logging
import re
import struct
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

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
    StaleAnswerError,
    lost,
)
from stepdiag.daq.records.events import ReadRange

if TYPE_CHECKING:
    from snap7.client import Client
    from snap7.error import S7Error

logging.getLogger("snap7").setLevel(
    logging.CRITICAL
)  # failures of snap7 are raised as errors, and the reconnector reports each error once

Result = TypeVar("Result")
AGAIN_FIRST_S, AGAIN_LONGEST_S = 1.0, 30.0
"""First and longest time in s until a refused range is requested again, because its data block may
be loaded later. The time doubles at each refusal. The values of a poll with such a request do not
have one common moment.
"""
_FIREWALL = message("firewall-s7")
_REFUSED = re.compile(r"failed: (?P<words>.+) \(0x(?P<code>[0-9a-f]{2})\)\Z")
_REMEDIES = {
    "03": message("do-s7-forbidden"),
    "05": message("do-s7-shorter"),
    "0a": message("do-s7-no-block"),
}
_OTHER = re.compile(r"TPKT version|protocol ID")


@dataclass(frozen=True, slots=True, kw_only=True)
class S7Settings:
    host: str
    port: int = 102
    rack: int = 0
    slot: int = 2
    timeout_s: float = 0.3

    @property
    def address(self) -> str:
        return f"S7 {self.host}:{self.port} rack {self.rack} slot {self.slot}"


class S7Link(BlockingLink):
    """A connection to the control, made by `open_link`, ended by ``close``. ``clock`` returns the
    present time in s.
    """

    def __init__(
        self,
        settings: S7Settings,
        ranges: Sequence[ReadRange],
        client: "Client",
        waiter: Waiter,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(settings.address, settings.timeout_s, ranges, waiter)
        self._client = client
        self._clock = clock
        self._refused: dict[ReadRange, RefusedRequestError] = {}
        self._again_s = 0.0
        self._wait_s = AGAIN_FIRST_S

    def _fetch_all(self) -> list[bytes]:
        """Request all ranges in one telegram. After a refusal the accepted ranges are requested in
        one telegram, and from time to time each range separately.
        """
        wanted = [each for each in self._ranges if each not in self._refused]
        if wanted and not (self._refused and self._clock() >= self._again_s):
            try:
                given = self._together(wanted)
            except RefusedRequestError as refusal:
                return self._each_alone(refusal)
            self.refusals.update(self._refused)
            return [given.get(each, b"") for each in self._ranges]
        return self._each_alone(None)

    def _together(self, wanted: list[ReadRange]) -> dict[ReadRange, bytes]:
        from snap7.type import Area

        items = [
            {
                "area": Area.DB,
                "db_number": int(each.table[2:]),
                "start": each.address,
                "size": each.count,
            }
            for each in wanted
        ]
        answers = self._ask(
            message("reading-all"), lambda: self._client.read_multi_vars(items)[1]
        )
        return {
            each: self._whole(each, bytes(data))
            for each, data in zip(wanted, answers, strict=True)
        }

    def _each_alone(self, refusal: RefusedRequestError | None) -> list[bytes]:
        """Request each range separately to find the refused ranges. Raises ``refusal`` if no single
        range is refused.
        """
        data = super()._fetch_all()
        self._refused, self._again_s = dict(self.refusals), self._clock() + self._wait_s
        self._wait_s = (
            min(2 * self._wait_s, AGAIN_LONGEST_S) if self._refused else AGAIN_FIRST_S
        )
        if refusal is not None and not self._refused:
            raise refusal
        return data

    def _fetch(self, wanted: ReadRange) -> bytes:
        what = message(
            "reading-bytes", count=wanted.count, table=wanted.table, address=wanted.address
        )
        return bytes(
            self._ask(
                what,
                lambda: self._client.db_read(
                    int(wanted.table[2:]), wanted.address, wanted.count
                ),
            )
        )

    def _write(self, table: str, address: int, value: int) -> None:
        data = bytearray(struct.pack(">H", value))
        self._ask(
            message("writing-word", table=table, address=address),
            lambda: self._client.db_write(int(table[2:]), address, data),
        )

    def _ask(self, what: Message, work: Callable[[], Result]) -> Result:
        from snap7.error import S7Error, S7TimeoutError

        try:
            return work()
        except S7TimeoutError as error:
            raise silent(self._address, self._timeout_s) from error
        except (S7Error, OSError, struct.error) as error:
            raise _refusal(self._address, what, error) from error


async def open_link(settings: S7Settings, ranges: Sequence[ReadRange]) -> S7Link:
    """Connect to the control, to read ``ranges``. Raises LostConnectionError with the reason of a
    failure.
    """
    try:
        from snap7.client import Client
    except ImportError as error:
        raise not_installed(settings.address, "s7") from error
    client = Client()
    client.multi_read_max_gap = 0  # the control may forbid the addresses between two signals

    def end() -> None:
        if client.connection is not None:
            hang_up(client.connection.socket)

    waiter = Waiter("s7", end, client.disconnect)
    await opened(
        waiter, lambda: _connect(client, settings), settings.address, 3.0 * CONNECT_S
    )
    return S7Link(settings, ranges, client, waiter)


def _connect(client: "Client", settings: S7Settings) -> None:
    from snap7.error import S7Error

    try:
        client.connect(settings.host, settings.rack, settings.slot, settings.port)
        if client.connection is not None and client.connection.socket is not None:
            client.connection.socket.settimeout(settings.timeout_s)
    except S7Error as error:
        raise _no_connection(settings, error) from error


def _no_connection(settings: S7Settings, error: "S7Error") -> DeviceError:
    from snap7.error import S7TimeoutError

    if isinstance(error.__context__, OSError) and not isinstance(error, S7TimeoutError):
        found, remedy = unreachable(
            error.__context__, CONNECT_S, message("protocol-s7"), _FIREWALL
        )
        return LostConnectionError(
            settings.address,
            expected=message("expects-connection"),
            found=found,
            remedy=remedy,
        )
    if _OTHER.search(str(error)):
        found, remedy = (
            message("found-other-bytes", bytes=str(error)),
            message("do-other-product"),
        )
    elif isinstance(error, S7TimeoutError):
        found, remedy = (
            message("found-silence-for", seconds_s=CONNECT_S),
            message("do-nobody-s7"),
        )
    else:
        refusal, rack = message("found-refusal", what=str(error)), message("do-rack")
        return LostConnectionError(
            settings.address, expected=message("expects-s7"), found=refusal, remedy=rack
        )
    return LostConnectionError(
        settings.address, expected=message("expects-s7"), found=found, remedy=remedy
    )


def _refusal(address: str, what: Message, error: Exception) -> DeviceError:
    refused = _REFUSED.search(str(error))
    if refused is not None:
        remedy = _REMEDIES.get(refused["code"], message("do-manual"))
        return RefusedRequestError(
            address,
            expected=message("expects-answer-to", what=what),
            found=refused["words"].lower(),
            remedy=remedy,
        )
    if getattr(error, "error_code", None) is not None:
        asked, protected = message("expects-answer-to", what=what), message("do-protected")
        return RefusedRequestError(
            address, expected=asked, found=str(error), remedy=protected
        )
    from snap7.error import S7ConnectionError

    if isinstance(error, S7ConnectionError | OSError) and not _OTHER.search(str(error)):
        return lost(address)
    between = message("do-other-or-between")
    return StaleAnswerError(
        address,
        expected=message("expects-answer-to", what=what),
        found=str(error),
        remedy=between,
    )
