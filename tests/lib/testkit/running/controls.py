"""Controls that speak their own protocol, in front of the virtual machine: each asks its PLC when
it is asked itself.

The S7 side is the library's own server. The LSV2 side is written from the public description of the
telegrams: 4 bytes of length, most significant first, 4 letters, then as much data.
"""

import socket
import struct
import threading
from contextlib import contextmanager

from snap7.server import Server
from snap7.type import SrvArea

from stepdiag.virtual.base.reserved import reserved_port


class VirtualPlc:
    """The register block of the virtual machine, read over Modbus TCP."""

    def __init__(self, port):
        self._connection = socket.create_connection(("127.0.0.1", port), timeout=60.0)
        self._lock = threading.Lock()

    def close(self):
        self._connection.close()

    def read(self):
        """Return registers 0 to 13."""
        return struct.unpack(">14H", self._exchange(struct.pack(">BHH", 3, 0, 14))[2:])

    def captured(self, count):
        self._exchange(struct.pack(">BHHBH", 16, 100, 1, 2, count))

    def _exchange(self, pdu):
        with self._lock:
            self._connection.sendall(struct.pack(">HHHB", 1, 0, len(pdu) + 1, 1) + pdu)
            length = struct.unpack(">HHHB", self._exactly(7))[2]
            return self._exactly(length - 1)

    def _exactly(self, count):
        data = b""
        while len(data) < count:
            more = self._connection.recv(count - len(data))
            if not more:
                raise ConnectionResetError("the virtual machine has gone")
            data += more
        return data


class _S7Server(Server):
    """The library's server, whose memory is made new before each answer."""

    def __init__(self, refresh, written):
        super().__init__(log=False)
        self.host = "127.0.0.1"
        self._refresh, self._written = refresh, written

    def _process_request(self, request_data, client_address):
        self._refresh()
        answer = super()._process_request(request_data, client_address)
        self._written()
        return answer


class S7Control:
    """An 828D: DB4900 words 0, 2, 4, 6 of the program, DB3900 to 3902 the axes (byte 0 bit 7 exact
    stop fine)."""

    def __init__(self, plc, port=0):
        self.words, self._plc = bytearray(8), plc
        self.axes = [bytearray(2) for _ in range(3)]
        self._told = self.telegrams = 0
        self.port = port or reserved_port()
        self.start()

    def start(self):
        self.server = _S7Server(self._refresh, self._take)
        self.server.register_area(SrvArea.DB, 4900, self.words)
        for number, axis in enumerate(self.axes):
            self.server.register_area(SrvArea.DB, 3900 + number, axis)
        self.server.start(self.port)

    def stop(self):
        self.server.stop()

    def _refresh(self):
        self.telegrams += 1
        if self._plc is None:
            return
        block = self._plc.read()
        stands = block[2] & 1
        self.words[:6] = struct.pack(">HHH", block[3], block[1], stands)
        for axis in self.axes:
            axis[0] = 0xC0 if stands else 0

    def _take(self):
        told = struct.unpack(">H", self.words[6:8])[0]
        if told != self._told and self._plc is not None:
            self._told = told
            self._plc.captured(told)


class TncControl:
    """A TNC: FN 19's numbers in D280 and D284 (0 under way), axes in position in W1026; D and W low
    byte first."""

    WORDS_AT = 0x4000
    WORDS = 2048

    def __init__(self, plc=None, *, password="", answer=None):
        self.memory = bytearray(2 * self.WORDS)
        self.asked = []
        self._plc, self._password, self._answer = plc, password, answer
        self._ended = threading.Event()
        self._threads = []
        self.port = reserved_port()
        self.start()

    def start(self):
        self._ended.clear()
        self._listener = socket.create_server(("127.0.0.1", self.port))
        self._listener.settimeout(0.05)
        self._threads = [threading.Thread(target=self._accept)]
        self._threads[0].start()

    def stop(self):
        self._ended.set()
        for thread in self._threads:
            thread.join()
        self._listener.close()

    def _accept(self):
        while not self._ended.is_set():
            try:
                connection, _ = self._listener.accept()
            except TimeoutError:
                continue
            self._threads.append(threading.Thread(target=self._serve, args=(connection,)))
            self._threads[-1].start()

    def _serve(self, connection):
        received = b""
        with connection:
            connection.settimeout(0.05)
            while not self._ended.is_set():
                try:
                    more = connection.recv(4096)
                except TimeoutError:
                    continue
                except OSError:
                    return
                if not more:
                    return
                received += more
                while (
                    len(received) >= 8
                    and len(received) >= 8 + struct.unpack(">L", received[:4])[0]
                ):
                    end = 8 + struct.unpack(">L", received[:4])[0]
                    letters, data, received = (
                        received[4:8].decode(),
                        received[8:end],
                        received[end:],
                    )
                    self.asked.append((letters, data))
                    answer = self._answer(letters, data) if self._answer else None
                    try:
                        connection.sendall(
                            answer
                            if answer is not None
                            else telegram(*self._respond(letters, data))
                        )
                    except OSError:
                        return

    def _respond(self, letters, data):
        if letters == "A_LG":
            user, _, rest = data.partition(b"\0")
            wrong = (
                user == b"PLCDEBUG"
                and self._password
                and rest.rstrip(b"\0").decode() != self._password
            )
            return ("T_ER", bytes([1, 22])) if wrong else ("T_OK", b"")
        if letters in ("A_LO", "C_CC"):
            return "T_OK", b""
        if letters == "R_VR":
            return "S_VR", (
                b"iTNC530\x00340490 08\x00PLC 1\x00%0000000" if not data else b"340490\x00"
            )
        if letters == "R_PR":
            return "S_PR", self._parameters()
        if letters == "R_MB":
            return self._memory(*struct.unpack(">LB", data))
        return "T_ER", bytes([1, 21])

    def _parameters(self):
        places = [
            0x1000,
            1000,
            0x2000,
            256,
            0x3000,
            256,
            0x3100,
            48,
            0x3200,
            48,
            self.WORDS_AT,
            self.WORDS,
            0x8000,
            16,
        ]
        return struct.pack(
            ">14L8B8L2BH4B2L2HL",
            *places,
            80,
            *[0] * 7,
            *[0] * 8,
            2,
            0,
            256,
            1,
            1,
            1,
            1,
            0,
            0,
            0,
            0,
            0,
        )

    def _memory(self, address, count):
        place = address - self.WORDS_AT
        if self._plc is not None:
            self._refresh(self._plc.read())
        if not 0 <= place <= len(self.memory) - count:
            return "T_ER", bytes([1, 24])
        return "S_MB", bytes(self.memory[place : place + count])

    def _refresh(self, block):
        stands = block[2] & 1
        self.memory[280:288] = struct.pack("<ll", block[3], block[1] if stands else 0)
        self.memory[1026:1028] = struct.pack("<H", 7 if stands else 0)


def telegram(letters, data=b""):
    """Return a telegram as it is sent."""
    return struct.pack(">L", len(data)) + letters.encode() + data


@contextmanager
def s7_control(port=None):
    """Run an 828D in front of the virtual machine whose Modbus port is given, or with a memory of
    its own."""
    yield from _running(S7Control, port)


@contextmanager
def tnc_control(port=None, **options):
    """Run a TNC in front of the virtual machine whose Modbus port is given, or with a memory of its
    own."""
    yield from _running(TncControl, port, **options)


def _running(kind, port, **options):
    plc = None if port is None else VirtualPlc(port)
    control = kind(plc, **options)
    try:
        yield control
    finally:
        control.stop()
        if plc is not None:
            plc.close()
