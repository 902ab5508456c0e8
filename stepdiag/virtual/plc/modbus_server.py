"""The PLC on the network and on a serial line: a thread that answers request after request."""

import contextlib
import selectors
import socket
import struct
import threading
import time

from stepdiag.virtual.base.clock import Clock
from stepdiag.virtual.base.faults import Fault, FaultBoard
from stepdiag.virtual.base.ports import SerialLine
from stepdiag.virtual.base.reserved import reserved_port
from stepdiag.virtual.plc.attention import Attention
from stepdiag.virtual.plc.modbus import GATEWAY_TARGET_FAILED, checksum, frame_length, respond
from stepdiag.virtual.plc.plc import Plc

_LOOK_S = 0.02
_RTU_SILENCE_S = 0.05
_HEADER = struct.Struct(">HHHB")


class Slave:
    """The PLC with the state of its line: answering, silent, late or off."""

    def __init__(
        self, plc: Plc, *, unit: int, clock: Clock, faults: FaultBoard, attention: Attention
    ) -> None:
        self.unit = unit
        self._plc = plc
        self._clock = clock
        self._faults = faults
        self._attention = attention
        self._reboots: Fault | None = None

    def off(self) -> bool:
        """Return whether the PLC reboots now. After the reboot, the stop counter begins again at 0,
        unless the PLC keeps the counter."""
        now = self._faults.active("plc-reboot", self._clock.wall_s())
        if self._reboots is not None and now is None:
            self._plc.reboot(counts_on=self._reboots.value != 0.0)
        self._reboots = now
        return now is not None

    def answer(self, request: bytes) -> bytes | None:
        """Return the response PDU to a request PDU, possibly late, or None if the PLC does not
        answer."""
        now = self._clock.wall_s()
        self._attention.looked(now)
        if self._faults.active("plc-silent", now):
            return None
        if late := self._faults.active("plc-late", now):
            time.sleep(late.value)
        return respond(self._plc, request)


class TcpSlave:
    """Modbus TCP on loopback: any number of connections, served by one thread like a PLC cycle."""

    def __init__(self, slave: Slave, *, host: str = "127.0.0.1", port: int = 0) -> None:
        self._slave = slave
        self._selector = selectors.DefaultSelector()
        self._streams: dict[socket.socket, bytes] = {}
        self._listener: socket.socket | None = None
        self._address = (host, port or reserved_port())
        self._listen()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="virtual-plc-tcp")

    @property
    def port(self) -> int:
        return self._address[1]

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self._hang_up()
        self._selector.close()

    def _listen(self) -> None:
        self._listener = socket.create_server(self._address)
        self._listener.setblocking(False)
        self._selector.register(self._listener, selectors.EVENT_READ)

    def _hang_up(self) -> None:
        for stream in list(self._streams):
            self._drop(stream)
        if self._listener is not None:
            self._selector.unregister(self._listener)
            self._listener.close()
            self._listener = None

    def _run(self) -> None:
        while not self._stop.is_set():
            if self._slave.off():
                self._hang_up()
                time.sleep(_LOOK_S)
                continue
            if self._listener is None:
                self._listen()
            for key, _ in self._selector.select(_LOOK_S):
                if key.fileobj is self._listener:
                    self._accept(self._listener)
                elif isinstance(key.fileobj, socket.socket):
                    self._receive(key.fileobj)

    def _accept(self, listener: socket.socket) -> None:
        with contextlib.suppress(OSError):
            stream, _ = listener.accept()
            stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._streams[stream] = b""
            self._selector.register(stream, selectors.EVENT_READ)

    def _drop(self, stream: socket.socket) -> None:
        self._selector.unregister(stream)
        del self._streams[stream]
        stream.close()

    def _receive(self, stream: socket.socket) -> None:
        try:
            received = stream.recv(4096)
            if not received:
                self._drop(stream)
                return
            self._streams[stream] = self._serve(stream, self._streams[stream] + received)
        except OSError:
            self._drop(stream)

    def _serve(self, stream: socket.socket, received: bytes) -> bytes:
        while len(received) > _HEADER.size:
            transaction, protocol, length, unit = _HEADER.unpack_from(received)
            end = 6 + length
            if len(received) < end:
                break
            request, received = received[_HEADER.size : end], received[end:]
            if unit != self._slave.unit:
                response: bytes | None = bytes([request[0] | 0x80, GATEWAY_TARGET_FAILED])
            else:
                response = self._slave.answer(request)
            if response is not None:
                stream.sendall(
                    _HEADER.pack(transaction, protocol, len(response) + 1, unit) + response
                )
        return received


class RtuSlave:
    """Modbus RTU on a pty; requests for other units and broken frames get no answer."""

    def __init__(self, slave: Slave, line: SerialLine) -> None:
        self._slave = slave
        self._line = line
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="virtual-plc-rtu")

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self._line.unplug()

    def _run(self) -> None:
        received = b""
        while not self._stop.is_set():
            more = self._line.read(_RTU_SILENCE_S)
            received = received + more if more else b""
            length = frame_length(received)
            if self._slave.off():
                received = b""
            while length is not None and len(received) >= length:
                self._serve(received[:length])
                received = received[length:]
                length = frame_length(received)

    def _serve(self, frame: bytes) -> None:
        body = frame[:-2]
        if checksum(body) != frame[-2:] or frame[0] != self._slave.unit:
            return
        response = self._slave.answer(body[1:])
        if response is not None:
            answer = bytes([self._slave.unit]) + response
            self._line.write(answer + checksum(answer))
