#!/usr/bin/python3
"""stepdiag_modbus: a HAL userspace component of LinuxCNC that serves the register block of stepdiag
over Modbus TCP.

    loadusr -Wn stepdiag /usr/bin/python3 ./stepdiag_modbus.py --host 192.168.1.20 --port 1502

stepdiag.hal beside this file contains this line and connects the pins; `stepdiag program
--controller linuxcnc` writes both. The component shows the program's state (setup, stop counter,
stopped), whether the control stands in position, and the commanded positions of the axes. Function
codes 3 and 4 read registers 0 to 13, function codes 6 and 16 write register 100, ``captured``: no
other register can be written, and no input of the control can be set except the one for which the
program waits. The component needs only the control's own Python (3.7 or newer).
"""

from __future__ import annotations

import argparse
import os
import select
import signal
import socket
import struct
import sys
import time

import hal
import linuxcnc

NAME = "stepdiag"
STATUS_S = 0.05
BEAT_S = 0.4
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3
REGISTERS = 14
CAPTURED = 100
MOST_CLIENTS = 8
LONGEST_FRAME = 260
AXES = "xyz"
USUAL = {"material-c": 20.0, "air-c": 20.0, "pressure-hpa": 1013.25, "humidity-percent": 50.0}
"""Values of air and material that the component sends until sensors are connected to its pins;
`stepdiag check` shows these values.
"""


class Block:
    """The registers with the present state of the control."""

    def __init__(self, pins: hal.component, unit_mm: float) -> None:
        self._pins, self._unit_mm = pins, unit_mm
        self._status: linuxcnc.stat | None = None
        self._looked_s = 0.0
        self._runs = self._fails = False

    def registers(self) -> list[int]:
        """Return registers 0 to 13 (contract of stepdiag: docs/service-engineer.md, section 2)."""
        self._look()
        pins = self._pins
        # an output keeps its value when a program ends or is aborted: then the machine stands at no
        # stop
        stopped = bool(pins["stopped"]) and bool(pins["in-position"]) and self._runs
        words = [
            int(time.monotonic() / BEAT_S) % 65536,
            round(pins["count"]) % 65536,
            stopped | self._runs << 1 | self._fails << 2,
            round(pins["setup"]) % 65536,
        ]
        for axis in AXES:
            tenths = round(pins["position-" + axis] * self._unit_mm * 1e4)
            words += struct.unpack(
                ">HH", struct.pack(">i", max(-(2**31), min(2**31 - 1, tenths)))
            )
        hundredths = (round(pins[name] * 100) for name in ("material-c", "air-c"))
        tenths_more = (
            round(pins[name] * 10) for name in ("pressure-hpa", "humidity-percent")
        )
        return [
            *words,
            *(value & 0xFFFF for value in hundredths),
            *(value & 0xFFFF for value in tenths_more),
        ]

    def take_captured(self, count: int) -> None:
        """Set the pin from which the program reads the number of the captured stop."""
        self._pins["captured"] = float(count)

    def _look(self) -> None:
        """Query the state of the control at most every `STATUS_S`, because each query loads the
        control.
        """
        if time.monotonic() - self._looked_s < STATUS_S:
            return
        self._looked_s = time.monotonic()
        try:
            self._status = self._status or linuxcnc.stat()
            self._status.poll()
        except linuxcnc.error:  # HAL is started before the control's other parts
            self._fails = True
            return
        self._runs = self._status.interp_state != linuxcnc.INTERP_IDLE
        self._fails = self._status.task_state != linuxcnc.STATE_ON


def answer(request: bytes, block: Block) -> bytes:
    """Return the reply to one Modbus request; request and reply have no MBAP header."""
    function = request[0]
    if function in (3, 4) and len(request) == 5:
        first, count = struct.unpack(">HH", request[1:])
        if not 1 <= count <= 125:
            return bytes([function | 0x80, ILLEGAL_VALUE])
        if first + count > REGISTERS:
            return bytes([function | 0x80, ILLEGAL_ADDRESS])
        return struct.pack(
            f">BB{count}H", function, 2 * count, *block.registers()[first : first + count]
        )
    if function == 6 and len(request) == 5:
        return written(function, request, request[1:3], request[3:5], block)
    if function == 16 and len(request) == 8 and request[3:6] == b"\x00\x01\x02":
        return written(function, request[:5], request[1:3], request[6:8], block)
    return bytes([function | 0x80, ILLEGAL_ADDRESS if function == 16 else ILLEGAL_FUNCTION])


def written(function: int, reply: bytes, address: bytes, value: bytes, block: Block) -> bytes:
    """Store a value written to ``captured``, and return the reply: an error for any other
    register.
    """
    if struct.unpack(">H", address) != (CAPTURED,):
        return bytes([function | 0x80, ILLEGAL_ADDRESS])
    block.take_captured(struct.unpack(">H", value)[0])
    return reply


class Client:
    """A connection, which joins received pieces into complete requests."""

    def __init__(self, link: socket.socket) -> None:
        self.link, self._received = link, b""

    def serve(self, block: Block) -> bool:
        """Answer the received bytes; return False for an ended connection, a client that accepts no
        answer, or bytes that are not Modbus TCP.
        """
        try:
            data = self.link.recv(4096)
        except BlockingIOError:
            return True
        except OSError:
            return False
        self._received += data
        while len(self._received) >= 8:
            number, protocol, length = struct.unpack(">HHH", self._received[:6])
            if protocol != 0 or not 2 <= length <= LONGEST_FRAME:
                return False
            if len(self._received) < 6 + length:
                break
            unit, request = self._received[6], self._received[7 : 6 + length]
            self._received = self._received[6 + length :]
            reply = answer(request, block)
            try:
                self.link.sendall(
                    struct.pack(">HHHB", number, 0, len(reply) + 1, unit) + reply
                )
            except OSError:
                return False
        return bool(data)


def served(door: socket.socket, block: Block) -> None:
    """Answer all clients until the control ends this component; with too many connections, the
    oldest is closed.
    """
    clients: list[Client] = []
    while True:
        ready, _, _ = select.select([door, *(client.link for client in clients)], [], [])
        gone = [
            client for client in clients if client.link in ready and not client.serve(block)
        ]
        if door in ready:
            link, _ = door.accept()
            link.setblocking(False)
            link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            clients.append(Client(link))
        if len(clients) - len(gone) > MOST_CLIENTS:
            gone.append(next(client for client in clients if client not in gone))
        for client in gone:
            client.link.close()
        clients = [client for client in clients if client not in gone]


def wired() -> hal.component:
    """Return the component with its pins."""
    pins = hal.component(NAME)
    for name in ("setup", "count", *("position-" + axis for axis in AXES), *USUAL):
        pins.newpin(name, hal.HAL_FLOAT, hal.HAL_IN)
    for name in ("stopped", "in-position"):
        pins.newpin(name, hal.HAL_BIT, hal.HAL_IN)
    pins.newpin("captured", hal.HAL_FLOAT, hal.HAL_OUT)
    for name, value in USUAL.items():
        pins[name] = value
    return pins


def inches() -> bool:
    """Return whether the control's length unit is the inch."""
    path = os.environ.get("INI_FILE_NAME")
    units = linuxcnc.ini(path).find("TRAJ", "LINEAR_UNITS") if path else None
    return (units or "mm").lower() in ("in", "inch", "imperial")


def main() -> None:
    """Create the pins and serve the register block."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        help="the address to listen on: the control's own on the network of the box",
    )
    parser.add_argument(
        "--port", type=int, default=1502, help="below 1024 only administrators may listen"
    )
    options = parser.parse_args()
    with socket.socket() as door:
        door.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        door.bind((options.host, options.port))
        door.listen(MOST_CLIENTS)
        signal.signal(
            signal.SIGTERM, lambda *_: sys.exit()
        )  # how the control ends its components
        pins = wired()
        pins.ready()
        try:
            served(door, Block(pins, 25.4 if inches() else 1.0))
        finally:
            pins.exit()


if __name__ == "__main__":
    main()
