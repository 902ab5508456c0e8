"""Serial lines: a thread reads and stamps bytes, and the event loop supervises the thread.

The reading thread takes the time stamp right after the read: a time stamp taken behind a queue
would be late by milliseconds while other Python code runs. A read takes all waiting bytes in one
call; reading lines would cost three hundred times more.
"""

import time
from collections.abc import Callable, Sequence

from stepdiag.base.errors import DeviceError
from stepdiag.base.messages import message
from stepdiag.daq.links.ports.device import SerialSettings
from stepdiag.daq.links.ports.port import OpenPort
from stepdiag.daq.links.ports.port_thread import PortThread
from stepdiag.daq.links.reconnect import Report
from stepdiag.daq.timing.host_clock import stamp_ns
from stepdiag.daq.timing.samples import (
    AskingDecoder,
    Decoder,
    GreetingDecoder,
    PolledDecoder,
    RespondingDecoder,
)

ANSWER_TIMEOUT_S = 0.5
"""Longest time in s to the first byte of the answer of a polled instrument."""
PLAIN_GAP_S, LOW_LATENCY_GAP_S = 0.02, 0.005
"""Silence in s that ends an answer, on a plain and on a low-latency line, if the survey file
contains no other time. A plain USB adapter may delay bytes by 16 ms.
"""
GATHER_S = 0.02
"""Bytes that arrive within this time in s form one chunk: separate chunks for a thousand lines a
second would use an eighth of a core.
"""
LARGEST_CHUNK = 16_384
"""Largest chunk in bytes; a chunk of this size of the shortest lines is decoded in 0.1 s."""
BUSY_BYTES_PER_S = 100_000
"""Rate in bytes per s above which the reader reads without sleeping and without counting the
waiting bytes, because a pty stores only 4 KiB.
"""
NEVER_SILENT_S = 3.0
"""Longest time in s for which a line may still send after a missing answer; the bytes of this time
are discarded.
"""
_READ_S = 0.02
"""Longest wait of a read in s; after this silence the gathered bytes are passed on."""

Respond = Callable[[bytes], bytes]
"""A function that takes received bytes and returns the answer to send; empty for no answer."""
OnChunk = Callable[[bytes, int], None]
"""A function that takes bytes and their arrival time (`daq.timing.host_clock`, ns, whole
microseconds). The function is called in the reading thread, and its exception ends this thread.
"""


class SerialStream:
    """A line whose instrument sends without requests; a Reconnector runs ``session``.

    A chunk contains the bytes of up to 20 ms; its time is the arrival of the last byte.
    """

    def __init__(
        self,
        settings: SerialSettings,
        on_chunk: OnChunk,
        *,
        greeting: bytes = b"",
        responder: Callable[[], Respond] | None = None,
    ) -> None:
        """``greeting`` is sent after every opening of the line, to start the instrument;
        ``responder`` returns a function that makes the answers to the instrument.
        """
        self._settings = settings
        self._on_chunk = on_chunk
        self._greeting = greeting
        self._responder = responder
        self._port: OpenPort | None = None

    async def session(self, report: Report) -> None:
        """Pass chunks on until the line is lost. Raises DeviceError."""
        await PortThread(self._settings, self._read).serve(report)

    def hurry(self) -> None:
        """Pass the received bytes on at once; any thread may call this method."""
        if self._port is not None:
            self._port.hurry()

    def _read(self, port: OpenPort) -> None:
        self._port = port
        if self._greeting:
            port.write(self._greeting)
        respond = self._responder() if self._responder is not None else None
        pace = _Pace()
        while port.wanted:
            if pace.sleeps:
                port.pause(GATHER_S)
            data, last_ns, reads = _gather(
                port, 0.0 if pace.sleeps else GATHER_S, busy=pace.busy
            )
            pace.note(len(data), reads)
            if data:
                self._on_chunk(data, last_ns)
            if data and respond is not None and (answer := respond(data)):
                port.write(answer)


class PolledSerial:
    """A line whose instrument answers requests; the time of an answer is the middle between request
    and answer.

    After a time-out the line must be silent for the length of the time-out before the next request,
    because a late answer would be assigned to the next request. Bytes in this time are discarded.
    """

    def __init__(
        self,
        settings: SerialSettings,
        on_chunk: OnChunk,
        *,
        request: bytes,
        interval_s: float,
        others: Sequence[tuple[bytes, float]] = (),
        greeting: bytes = b"",
    ) -> None:
        """``others`` are further requests, each (request, interval in s), sent when due;
        ``greeting`` is sent after the opening of the line.
        """
        self._settings = settings
        self._on_chunk = on_chunk
        self._request = request
        self._interval_s = interval_s
        self._others = tuple(others)
        self._greeting = greeting

    async def session(self, report: Report) -> None:
        """Send requests and pass the answers on until the line is lost. Raises DeviceError."""
        await PortThread(self._settings, self._poll).serve(report)

    def _poll(self, port: OpenPort) -> None:
        gap_s = LOW_LATENCY_GAP_S if port.low_latency else PLAIN_GAP_S
        if self._greeting:
            port.write(self._greeting)
            _await_silence(port)
        due_s = time.monotonic()
        others_due_s = [due_s] * len(self._others)
        while port.wanted:
            if not self._ask(port, gap_s, self._request):
                _await_silence(port)
            for number, (request, interval_s) in enumerate(self._others):
                if time.monotonic() >= others_due_s[number]:
                    others_due_s[number] = time.monotonic() + interval_s
                    if not self._ask(port, gap_s, request):
                        _await_silence(port)
                    break  # one at a time, so that the reading is requested in between
            due_s = max(due_s + self._interval_s, time.monotonic())
            port.pause(due_s - time.monotonic())

    def _ask(self, port: OpenPort, gap_s: float, request: bytes) -> bool:
        port.write(request)
        sent_ns = stamp_ns()
        data = port.read(ANSWER_TIMEOUT_S)
        middle_ns = (sent_ns + stamp_ns()) // 2_000 * 1_000
        answered = bool(data)
        while data:
            self._on_chunk(data, middle_ns)
            data = port.read(gap_s)
        return answered


def instrument_line(
    settings: SerialSettings, decoder: Decoder, on_chunk: OnChunk
) -> SerialStream | PolledSerial:
    """Return the line for the instrument of ``decoder``, polled or not, with the decoder's requests
    and greeting.
    """
    greeting = decoder.greeting if isinstance(decoder, GreetingDecoder) else b""
    if not isinstance(decoder, PolledDecoder):
        responder = decoder.responder if isinstance(decoder, RespondingDecoder) else None
        return SerialStream(settings, on_chunk, greeting=greeting, responder=responder)
    others = decoder.others if isinstance(decoder, AskingDecoder) else ()
    return PolledSerial(
        settings,
        on_chunk,
        request=decoder.request,
        interval_s=decoder.poll_interval_s,
        others=others,
        greeting=greeting,
    )


class _Pace:
    """Decides whether the reader sleeps before the next chunk. The reader does not sleep on a
    ``busy`` line, nor on a slow line on which no byte would arrive during the sleep.
    """

    def __init__(self) -> None:
        self.sleeps = self.busy = False
        self._since_s = time.monotonic()

    def note(self, size: int, reads: int) -> None:
        now_s = time.monotonic()
        self.busy = size > BUSY_BYTES_PER_S * (now_s - self._since_s)
        self._since_s = now_s
        self.sleeps = reads > 1 and not self.busy


def _gather(port: OpenPort, seconds: float, *, busy: bool) -> tuple[bytes, int, int]:
    """Return the waiting bytes and the bytes that arrive within ``seconds``, the time of the last
    byte in ns, and the number of reads that returned bytes.

    The first read may find old bytes; the second read waits for a new byte. Bytes before a loss of
    the line are returned, and the next call raises the loss.
    """
    parts: list[bytes] = []
    size, last_ns, end_s = 0, 0, time.monotonic() + seconds
    while data := _read(port, bool(parts), busy):
        last_ns = stamp_ns()
        parts.append(data)
        size += len(data)
        if size > LARGEST_CHUNK or (len(parts) > 1 and time.monotonic() >= end_s):
            break
    return b"".join(parts), last_ns, len(parts)


def _read(port: OpenPort, gathered: bool, busy: bool) -> bytes:
    try:
        return port.read_on() if busy else port.read(_READ_S)
    except DeviceError:
        if not gathered:
            raise
        return b""


def _await_silence(port: OpenPort) -> None:
    """Discard bytes until the line is silent. Raises DeviceError if the line does not become
    silent.
    """
    until_s = time.monotonic() + NEVER_SILENT_S
    while port.wanted and (data := port.read(ANSWER_TIMEOUT_S)):
        if time.monotonic() > until_s:
            raise DeviceError(
                message("where-port", name=port.name),
                expected=message("falls-silent"),
                found=message("speaks-on", bytes=data[:12].hex(" ")),
                remedy=message("other-stands-there"),
            )
