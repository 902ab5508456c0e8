"""Names of ports.

- ``/dev/serial/by-id/...`` is a serial port of this computer.
- ``socket://host:port`` is a line of a terminal server: its unchanged bytes come over TCP. The baud
  rate is set at the terminal server.
- ``rfc2217://host:port`` is a line of a terminal server whose baud rate, parity and handshake lines
  are set from here (RFC 2217).
"""

import re
from dataclasses import dataclass
from typing import Literal

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message

_SCHEME = re.compile(r"(?P<scheme>[A-Za-z][A-Za-z0-9+.-]*)://(?P<rest>.*)\Z", re.DOTALL)
_PLACE = re.compile(
    r"(?:\[(?P<six>[0-9A-Fa-f:.%a-z]+)\]|(?P<host>[A-Za-z0-9][A-Za-z0-9._-]{0,252}))(?::(?P<port>"
    r"[0-9]{1,5}))?\Z"
)


@dataclass(frozen=True, slots=True)
class NetworkLine:
    scheme: Literal["socket", "rfc2217"]
    host: str
    port: int


def network_line(name: str, field: str = "port") -> NetworkLine | None:
    """Return the network line of a port name; None for a port of this computer.

    Raises UsageError for ``field`` if the scheme, host or port is invalid.
    """
    found = _SCHEME.match(name)
    if found is None:
        return None
    scheme, place = found["scheme"].lower(), host_and_port(found["rest"].removesuffix("/"))
    if scheme not in ("socket", "rfc2217") or place is None:
        raise UsageError(
            field,
            expected=message("expects-port"),
            found=repr(name),
            remedy=message("do-host-then-port"),
        )
    return NetworkLine("socket" if scheme == "socket" else "rfc2217", *place)


def host_and_port(text: str, usual_port: int = 0) -> tuple[str, int] | None:
    """Return host and port of HOST:PORT or [ADDRESS]:PORT; None for any other text. A text without
    a port is valid if ``usual_port`` is given.
    """
    place = _PLACE.match(text)
    if place is None:
        return None
    port, host = (
        usual_port if place["port"] is None else int(place["port"]),
        place["six"] or place["host"],
    )
    return (host, port) if 0 < port < 65536 and can_be_host(host) else None


def require_host_and_port(option: str, text: str, usual_port: int) -> tuple[str, int]:
    """Return host and port of a text (`host_and_port`). Raises UsageError for ``option`` if the
    text is invalid.
    """
    found = host_and_port(text, usual_port)
    if found is None:
        raise UsageError(option, expected=message("host-forms"), found=repr(text))
    return found


def can_be_host(name: str) -> bool:
    """Return whether a host name can be looked up: every part between two dots has 1 to 63 letters.

    A look-up of an invalid name raises an error of Python that is no network error.
    """
    try:
        name.encode("idna")
    except UnicodeError:
        return False
    return "\0" not in name
