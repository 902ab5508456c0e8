"""RFC 2217, the com port option of Telnet: a serial line of a terminal server with its settings.
The module converts bytes to bytes and uses no socket.

Telnet commands begin with IAC (255); IAC IAC is one byte 255 of data (RFC 854). The line carries
data in both directions, so the program requests binary transmission for both (RFC 856). Option 44
carries the settings, and the answer to a setting contains the active value (RFC 2217, 3).
"""

import struct
from typing import Literal

from stepdiag.base.messages import Message, message
from stepdiag.daq.links.ports.device import SerialSettings

_IAC, _DONT, _DO, _WONT, _WILL, _SB, _SE = 255, 254, 253, 252, 251, 250, 240
_BINARY, _SUPPRESS_GO_AHEAD, _COM_PORT = 0, 3, 44
_OURS = (_BINARY, _SUPPRESS_GO_AHEAD, _COM_PORT)
_THEIRS = (_BINARY, _SUPPRESS_GO_AHEAD)
_BAUD, _SIZE, _PARITY, _STOP, _CONTROL = 1, 2, 3, 4, 5
_SERVER = 100
"""Number that the server adds to the code of a command in its answer."""
_PARITIES = {"N": 1, "O": 2, "E": 3}
_NO_FLOW_CONTROL = 1
_DTR, _RTS = {True: 8, False: 9}, {True: 11, False: 12}
_NAMES = {_BAUD: "baud", _SIZE: "data bits", _PARITY: "parity", _STOP: "stop bits"}
_LONGEST_COMMAND = 256
"""Largest number of stored bytes of a subnegotiation, so that a server without an end mark cannot
fill the memory.
"""
State = Literal["data", "iac", "option", "command", "command-iac"]


class ComPort:
    """The Telnet part of a connection: finds the data of the line in the received bytes, and makes
    the answers. The received bytes may be divided in any way.
    """

    def __init__(self, settings: SerialSettings) -> None:
        self._settings = settings
        self._state: State = "data"
        self._verb = 0
        self._command = bytearray()
        self._answers = bytearray()
        self._asked: dict[int, bytes] = {}
        self._agreed: set[int] = set()
        self.speaks = False
        """Whether the server has sent a Telnet command."""
        self.refused: Message | None = None
        """The reason why the server does not accept the settings; None while no answer contradicts
        the settings.
        """

    @property
    def settled(self) -> bool:
        return bool(self._asked) and self._agreed >= set(self._asked)

    @property
    def agreed(self) -> Message:
        line = self._settings
        return message(
            "line-agreed",
            baud=line.baud,
            frame=f"{line.bytesize}{line.parity}{line.stopbits}",
        )

    def opening(self) -> bytes:
        return b"".join(bytes((_IAC, _WILL, option)) for option in _OURS) + b"".join(
            bytes((_IAC, _DO, option)) for option in _THEIRS
        )

    def answers(self) -> bytes:
        """Return the answers to the received bytes, each once."""
        data = bytes(self._answers)
        self._answers.clear()
        return data

    def escaped(self, data: bytes) -> bytes:
        """Return data for the line with every byte 255 doubled."""
        return data.replace(b"\xff", b"\xff\xff")

    def feed(self, data: bytes) -> bytes:
        """Return the data of the line in the received bytes."""
        if self._state == "data" and _IAC not in data:
            return data
        line = bytearray()
        for byte in data:
            self._take(byte, line)
        return bytes(line)

    def _take(self, byte: int, line: bytearray) -> None:
        match self._state:
            case "data" if byte == _IAC:
                self._state = "iac"
            case "data":
                line.append(byte)
            case "iac":
                self._after_iac(byte, line)
            case "option":
                self._state = "data"
                self._negotiate(self._verb, byte)
            case "command":
                self._in_command(byte)
            case "command-iac":
                self._state = "data" if byte == _SE else "command"
                if byte == _SE:
                    self._heed(bytes(self._command))
                else:
                    self._command.append(byte)

    def _after_iac(self, byte: int, line: bytearray) -> None:
        self._state = "data"
        if byte == _IAC:
            line.append(byte)
        elif byte in (_WILL, _WONT, _DO, _DONT):
            self._verb, self._state = byte, "option"
        elif byte == _SB:
            self._command.clear()
            self._state = "command"

    def _in_command(self, byte: int) -> None:
        if byte == _IAC:
            self._state = "command-iac"
        elif len(self._command) < _LONGEST_COMMAND:
            self._command.append(byte)

    def _negotiate(self, verb: int, option: int) -> None:
        self.speaks = True
        if verb == _DO and option == _COM_PORT and not self._asked:
            self._ask()
        elif verb == _DONT and option == _COM_PORT:
            self.refused = message("found-no-settings")
        elif verb == _DO and option not in _OURS:
            self._answers += bytes((_IAC, _WONT, option))
        elif verb == _WILL and option not in (*_THEIRS, _COM_PORT):
            self._answers += bytes((_IAC, _DONT, option))

    def _ask(self) -> None:
        line = self._settings
        self._asked = {
            _BAUD: struct.pack(">I", line.baud),
            _SIZE: bytes((line.bytesize,)),
            _PARITY: bytes((_PARITIES[line.parity],)),
            _STOP: bytes((line.stopbits,)),
        }
        control = (_NO_FLOW_CONTROL, _DTR[line.dtr], _RTS[line.rts])
        for command, value in (
            *self._asked.items(),
            *((_CONTROL, bytes((value,))) for value in control),
        ):
            self._answers += (
                bytes((_IAC, _SB, _COM_PORT, command))
                + self.escaped(value)
                + bytes((_IAC, _SE))
            )

    def _heed(self, command: bytes) -> None:
        if len(command) < 3 or command[0] != _COM_PORT:
            return
        which, value = command[1] - _SERVER, command[2:]
        if which not in self._asked:
            return
        if value == self._asked[which]:
            self._agreed.add(which)
        else:
            found, wanted = (
                int.from_bytes(each, "big") for each in (value, self._asked[which])
            )
            self.refused = message(
                "found-keeps", setting=_NAMES[which], found=found, wanted=wanted
            )
