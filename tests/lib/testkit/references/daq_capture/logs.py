"""Whole logs into a capture, played from reference files: a machine and a laser of the four basic
operations."""

import struct
from binascii import crc_hqx
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np

from stepdiag.base.findings import Finding
from stepdiag.daq.capture.by_laser import ByLaser
from stepdiag.daq.capture.capture import Capture
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.log_start import CaptureStart, PassHint
from stepdiag.daq.capture.outcome import Ended
from stepdiag.daq.capture.standing.dwell import Dwell
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.records.events import Chunk, LinkEvent, Loss, ModbusBlock
from stepdiag.daq.survey.file import laser_decoder
from stepdiag.daq.timing.stream import Break, StreamBuffer
from testkit.references import plain
from testkit.references.daq_capture.told import brief, hint_of, noise, survey_of
from testkit.timeline import BLOCK, Standstill, Timeline, arrival


@dataclass
class Machine(Timeline):
    """A timeline whose PLC and streams have what machines in halls have. Of the timeline: its
    schedule and its registers."""

    late_s: dict[str, float] = field(default_factory=dict)
    """By how much registers lag behind the stop signal: ``position``, ``count``, ``stopped``."""
    running_in: bool = False
    flicker: list[Any] = field(default_factory=list)
    """Spans after the arrival at every stop in which the stop signal is away."""
    frozen: list[float] = field(default_factory=lambda: [0.0, 0.0])
    alarm: list[float] = field(default_factory=lambda: [0.0, 0.0])
    aborted_s: float = 1e9
    """When the program ends before its time."""
    words: dict[str, Any] = field(default_factory=dict)
    """Registers that say something else from a time on: address -> [[from, value]]."""
    slips: list[Any] = field(default_factory=list)
    """(time, mm): the count slips without a word."""
    spikes: list[Any] = field(default_factory=list)
    """(time, mm): one wrong line."""
    dither_um: float = 0.0
    drift_um_s: float = 0.0
    resolution_mm: float = 0.0
    stuck: list[float] = field(default_factory=lambda: [0.0, 0.0])
    """While the laser sends one value."""
    garbage_at: list[float] = field(default_factory=list)
    links: list[Any] = field(default_factory=list)
    """(time, link, state, detail) or (time, "loss", events, bytes)."""
    deaf: list[Any] = field(default_factory=list)
    """Spans in which the laser's line brings nothing."""
    over_mm: list[Any] = field(default_factory=list)
    """(from, to, mm): the machine is elsewhere, as the laser sees it."""

    def columns(self) -> Any:
        """Return times in s, readings in mm, strength of the beam: ramps between the stops, at each
        a swing that dies away."""
        t = np.arange(int(self.duration * self.rate_hz)) / self.rate_hz
        times = self.schedule()
        value = np.interp(
            t,
            [0.0, *np.ravel(times)],
            [self.stops[0].reading, *np.repeat([stop.reading for stop in self.stops], 2)],
        )
        for begin, end in times:
            x = np.maximum(t - begin, 0.0) / 0.03
            value += np.where(
                (t >= begin) & (t < end), 5e-3 * x * (1.0 - x) / (1.0 + x * x * x * x), 0.0
            )
        for begin, end, off_mm in self.over_mm:
            value += np.where(
                (t >= begin) & (t < end),
                4.0 * off_mm * (t - begin) * (end - t) / (end - begin) ** 2,
                0.0,
            )
        value += 1e-3 * np.array(noise(len(t), self.seed, self.noise_um))
        value += 1e-3 * (
            self.dither_um * (np.abs(t * 11.0 % 1.0 - 0.5) * 4.0 - 1.0) + self.drift_um_s * t
        )
        beam = np.full(len(t), 0.9)
        for begin, end in self.beam_lost:
            beam[(t >= begin) & (t < end)] = 0.05
            value += self.lost_mm * (t >= begin)
        for moment in self.zeroed_at:
            value -= np.interp(moment, t, value) * (t >= moment)
        for moment, off_mm in self.slips:
            value += off_mm * (t >= moment)
        for moment, off_mm in self.spikes:
            value[np.searchsorted(t, moment)] += off_mm
        if self.resolution_mm:
            value = np.round(value / self.resolution_mm) * self.resolution_mm
        held = (t >= self.stuck[0]) & (t < self.stuck[1])
        value[held] = value[held][:1]
        return t, value, beam

    def laser(self) -> Any:
        """Return chunks of 4 to 8 lines, each handed over some hundred microseconds after its last
        one."""
        t, value, beam = self.columns()
        chunks, pick = [], 0
        while pick < len(t):
            end = min(pick + 4 + pick * 7 % 5, len(t))
            lines = "".join(
                f"{(k + 65000) % 65536} {value[k]:.6f} {beam[k]:.2f}\r\n"
                for k in range(pick, end)
            ).encode()
            arrival_ns = (round(t[end - 1] * 1e6) + 1000 + pick * 37 % 400) * 1000
            if any(
                arrival_ns >= moment * 1e9 > t[pick - 1] * 1e9 for moment in self.garbage_at
            ):
                lines = b"what is that\r\n" + lines
            if not any(begin <= arrival_ns * 1e-9 < until for begin, until in self.deaf):
                chunks.append(Chunk("laser", arrival_ns, lines))
            pick = end
        return chunks

    def polls(self) -> Any:
        """Return the register blocks of polls with 3 to 8 ms between request and answer; the PLC's
        state is that of mid-way."""
        blocks: list[Any] = []
        for k in range(int(self.duration * self.poll_hz)):
            send_ns = round(k * 1e6 / self.poll_hz) * 1000 + k * 389 % 20 * 100_000
            recv_ns = send_ns + 3_000_000 + k * 617 % 50 * 100_000
            if any(begin <= send_ns * 1e-9 < end for begin, end in self.poll_gaps):
                blocks.append(LinkEvent(recv_ns, "machine", "silent"))
            else:
                blocks.append(
                    ModbusBlock(
                        send_ns,
                        recv_ns,
                        BLOCK,
                        (self.registers((send_ns + recv_ns) * 0.5e-9, k),),
                    )
                )
        return blocks

    def registers(self, now: float, heartbeat: int) -> bytes:
        """Return the 28 bytes of the contract's block at a time."""
        if self.frozen[0] <= now < self.frozen[1]:
            now, heartbeat = self.frozen[0], int(self.frozen[0] * self.poll_hz)
        data = bytearray(super().registers(now, heartbeat))
        for name, first, last in (("count", 2, 4), ("stopped", 4, 6), ("position", 8, 20)):
            if name in self.late_s:
                data[first:last] = super().registers(now - self.late_s[name], heartbeat)[
                    first:last
                ]
        if self.running_in:
            times = np.ravel(self.schedule())
            places = np.repeat([stop.position for stop in self.stops], 2, axis=0)
            then = now - self.late_s.get("position", 0.0)
            data[8:20] = struct.pack(
                ">iii",
                *(round(float(np.interp(then, times, axis)) * 1e4) for axis in places.T),
            )
        (bits,) = struct.unpack(">H", data[4:6])
        since = next(
            (now - begin for begin, end in self.schedule() if begin <= now < end), None
        )
        if since is not None and any(begin <= since < end for begin, end in self.flicker):
            bits &= ~1
        if self.alarm[0] <= now < self.alarm[1]:
            bits |= 4
        if now >= self.aborted_s:
            bits &= ~2
        data[4:6] = struct.pack(">H", bits)
        for address, said in self.words.items():
            values = [value for moment, value in said if now >= moment]
            if values:
                data[2 * int(address) : 2 * int(address) + 2] = struct.pack(
                    ">H", values[-1] & 0xFFFF
                )
        return bytes(data)

    def events(self) -> Any:
        """Return all events in the order in which they arrive."""
        more = [
            Loss(int(moment * 1e9), *rest, "the disk is full")
            if link == "loss"
            else _change(int(moment * 1e9), link, *rest)
            for moment, link, *rest in self.links
        ]
        return sorted([*self.laser(), *self.polls(), *more], key=arrival)


MACHINE = {"seed": 3, "rate_hz": 50.0, "poll_hz": 25.0, "move_s": 0.4}
"""What is not told of a machine."""


def _stop(
    x_mm: float,
    y_mm: float,
    z_mm: float,
    reading_mm: float,
    setup: int = 1,
    seconds: float = 0.7,
    counts: int = 1,
    shown: int = 1,
) -> Standstill:
    return Standstill((x_mm, y_mm, z_mm), reading_mm, setup, seconds, counts, bool(shown))


def _change(time_ns: int, link: Any, state: Any, detail: str = "") -> LinkEvent:
    """Return a change of a link, its losses apart from its state as the links report them."""
    state_words, found, lost = detail.partition("bytes lost: ")
    return LinkEvent(
        time_ns,
        link,
        state,
        state_words.removesuffix("; "),
        tuple(lost.split("; ")) if found else (),
    )


def log(told: dict[str, Any]) -> Any:
    """Play a timeline into a capture, each pass that ends beginning the next log; return everything
    that came of it."""
    machine = Machine(
        **MACHINE | told["machine"] | {"stops": [_stop(*row) for row in told["stops"]]}
    )
    survey = survey_of(
        told | {"survey": {"n": 2, "dwell": 0.7, "rate_hz": machine.rate_hz} | told["survey"]}
    )
    events = machine.events()
    if survey.plc.silent:
        events = [each for each in events if isinstance(each, Chunk)]
    if "head" in told:
        events = sorted([*events, *_head_chunks(told["head"], machine)], key=arrival)
    if "air" in told:
        events = sorted(
            [
                *events,
                *(
                    Chunk("air", int(moment * 1e9), text.encode())
                    for moment, text in told["air"]
                ),
            ],
            key=arrival,
        )
    book, said = PassBook(survey), []
    start = book.start(skip_open_dwell=False)
    if "start" in told:
        hints = {
            setup: hint_of(said) for setup, said in told["start"].get("hints", {}).items()
        }
        start = msgspec.convert(
            msgspec.to_builtins(start) | told["start"] | ({"hints": hints} if hints else {}),
            CaptureStart,
        )
    if survey.plc.silent:
        first = next(iter(start.hints))
        start = msgspec.structs.replace(start, hints={first: start.hints[first]})
    capture, before = Capture(survey, start), ("", "")
    for event in events:
        outcomes = capture.feed(event)
        book.add_all(each for each in outcomes if isinstance(each, CapturedStop))
        said += _told((*outcomes, *book.news()))
        state = f"waits {capture.machine_waits:d}, driven out {capture.driven_out:d}"
        if state != before[0]:
            said.append(f"{arrival(event)}: {state}")
        standing = f"standing {capture.standing is not None:d}" if outcomes else before[1]
        if standing != before[1]:
            said.append(standing)
        before = (state, standing)
        if any(isinstance(each, Ended) for each in outcomes) and not told.get("one_log"):
            left, beyond = capture.left_over(), capture.went_beyond()
            said.append(f"next log: {brief(left)}, {beyond}, {capture.standing is not None}")
            capture = Capture(
                survey,
                book.start(
                    skip_open_dwell=capture.standing is not None, breaks=left, beyond=beyond
                ),
            )
    said += _told(capture.finish())
    return {"outcomes": said, "left_over": plain(capture.left_over())}


def _told(outcomes: Iterable[Any]) -> list[Any]:
    """Return outcomes, a stop as several rows; what nobody can check in a survey is said in words
    by `said.unsaid`."""
    said: list[Any] = []
    for each in outcomes:
        if isinstance(each, Finding) and each.setup is None:
            said.append(
                brief(each) if each.severity == "error" else f"{each.severity} {each.code}"
            )
        else:
            said += brief(each) if isinstance(each, CapturedStop) else [brief(each)]
    return said


def _head_chunks(told: dict[str, Any], machine: Machine) -> list[Chunk]:
    """Return the lines of a head whose spot stands where ``lateral`` says at each stop; dark and
    saturated in spans.

    ``angles``: those of an autocollimator, in seconds of arc.
    """
    rate_hz, chunks = told["rate_hz"], []
    times = machine.schedule()
    for k in range(int(machine.duration * rate_hz)):
        t = k / rate_hz
        index = max([at for at, (begin, _) in enumerate(times) if begin <= t], default=0)
        x = max(t - times[index][0], 0.0) / 0.03
        if "angles" in told:
            first, second = (
                angle
                + (40.0 - 8.0 * more) / (1.0 + x * x * x * x)
                + 0.1 * (k * 7919 % 11 - 5)
                for more, angle in enumerate(told["angles"][index])
            )
            valid = 0 if any(a <= t < b for a, b in told.get("dark", [])) else 3
            chunks.append(
                Chunk(
                    "head",
                    round((t + 0.002) * 1e6) * 1000,
                    f"3 00{valid} {first:.2f} {second:.2f}\r".encode(),
                )
            )
            continue
        light = 0 if any(a <= t < b for a, b in told.get("dark", [])) else 1
        swing = 4000.0 / (1.0 + x * x * x * x) + 300 * ((k * 7919) % 11 - 5)
        values = []
        for along_x, along_y in told["lateral"][index]:
            values += [
                round(light * (along_x + swing)),
                round(light * (along_y + 0.3 * swing)),
                light * 1_000_000,
            ]
        status = sum(bit for bit, a, b in told.get("status", []) if a <= t < b)
        body = f"4D,{k},{status}," + ",".join(map(str, values))
        chunks.append(
            Chunk(
                "head",
                round((t + 0.002) * 1e6) * 1000,
                f"${body}*{crc_hqx(body.encode(), 0xFFFF):04X}\r\n".encode(),
            )
        )
    return chunks


SURVEY = """
[survey]
name = "q"
machine = "m"
[volume]
size_mm = [300.0, 200.0, 100.0]
increments = 2
[plan]
setups = ["{setup}"]
dwell_s = 1.0
[laser]
format = "line"
port = "/dev/null"
[laser.line]
pattern = '(?P<position>[-+0-9.]+) (?P<counter>[0-9]+) (?P<beam>[0-9.]+)'
counter_modulus = 0
rate_hz = {rate_hz}
[plc]
transport = "none"
[environment]
source = "fixed"
"""
"""A machine without signals."""


def by_laser(told: dict[str, Any]) -> Any:
    """Lay readings before who places stops by the laser alone, in chunks of a tenth of a second."""
    rate_hz, level, rows = told.get("rate_hz", 100), told.get("level_mm", 0.0), []
    survey = survey_of(
        {"text": SURVEY.format(setup=told.get("setup", "ppp"), rate_hz=rate_hz)}
    )
    laser, found = StreamBuffer(laser_decoder(survey)), []
    hint = msgspec.convert(hint_of(told.get("hint", {})), PassHint)
    start = CaptureStart(
        hints={told.get("setup", "ppp"): hint},
        breaks=tuple(Break(*each) for each in told.get("breaks", [])),
    )
    places = ByLaser(survey, start, laser)
    for act in told["acts"]:
        to_mm, move_s, stand_s, beam = [*act, 1.0][:4]
        moves = max(1, int(move_s * rate_hz))
        rows += [(level + (to_mm - level) * (k + 1) / moves, beam) for k in range(moves)]
        rows += [
            (to_mm + 2e-4 * ((k * 31) % 7 - 3), beam) for k in range(int(stand_s * rate_hz))
        ]
        level = to_mm
    size = rate_hz // 10
    for first in range(0, len(rows), size):
        part = rows[first : first + size]
        now_ns = (
            1_000_000_000
            + (first + len(part)) * 1_000_000_000 // rate_hz
            - (first // size % 3 == 0)
        )
        laser.feed(
            "".join(
                f"{mm:.6f} {first + k + 1} {beam}\n" for k, (mm, beam) in enumerate(part)
            ).encode(),
            now_ns,
        )
        dwells, outcomes = places.look(now_ns)
        found += [
            [now_ns, *brief(each)] if isinstance(each, Dwell) else f"{now_ns} {brief(each)}"
            for each in (*dwells, *outcomes)
        ]
    return found
