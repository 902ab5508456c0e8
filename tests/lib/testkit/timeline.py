"""A machine and a laser as a list of events: what the capture sees, without a socket, in any
disorder a test wants.

It knows the contract's register block and nothing of the code that decodes it.
"""

import struct
from dataclasses import dataclass, field, replace

import numpy as np

from stepdiag.daq.records.events import Chunk, LinkEvent, ModbusBlock, ReadRange

SURVEY = """
[survey]
name = "bench"
machine = "virtual"
[volume]
size_mm = [{size}]
increments = {n}
[plan]
setups = [{setups}]
return_pass = {back}
dwell_s = {dwell}
[laser]
format = "line"
port = "/dev/null"
compensated = true
[laser.line]
pattern = '(?P<counter>\\d+) (?P<position>-?\\d+\\.\\d+) (?P<beam>\\d\\.\\d+)'
counter_modulus = 65536
beam_threshold = 0.2
rate_hz = {rate}
[plc]
poll_hz = 40
{signals}
[stop]
settle_s = 0.15
min_window_s = 0.2
"""

STOPPED_ONLY = '[plc.signals.stopped]\naddress = 2\ntype = "bit"\nbit = 0\n'
SETUPS = {
    "ppp": 1,
    "npp": 2,
    "pnp": 3,
    "ppn": 4,
    "linear-x": 11,
    "linear-y": 12,
    "linear-z": 13,
}
BLOCK = (ReadRange("holding", 0, 14),)


def survey_text(
    *,
    size=(300.0, 200.0, 100.0),
    n=3,
    setups=("ppp",),
    back=False,
    dwell=0.8,
    signals="",
    rate_hz=250.0,
):
    """Return a survey file for the timeline."""
    named = ", ".join(f'"{setup}"' for setup in setups)
    return SURVEY.format(
        size=", ".join(map(str, size)),
        n=n,
        setups=named,
        back=str(back).lower(),
        dwell=dwell,
        signals=signals,
        rate=rate_hz,
    )


@dataclass
class Standstill:
    """One dwell of the machine: where it stands, and what its PLC says."""

    position: tuple
    reading: float
    setup: int = 1
    seconds: float = 0.8
    counts: int = 1
    shown: bool = True


def diagonal(setup, size=(300.0, 200.0, 100.0), n=3, *, back=False):
    """Return the standstills of a body diagonal, worked out by hand: x, y, z in turn from the
    corner that the name says."""
    signs = np.array([1 if letter == "p" else -1 for letter in setup])
    size = np.array(size)
    unit = signs * size / np.linalg.norm(size)
    place = np.where(signs > 0, 0.0, size)
    places = [place.copy()]
    for _ in range(n):
        for axis in range(3):
            place = place.copy()
            place[axis] += signs[axis] * size[axis] / n
            places.append(place.copy())
    start = places[0]
    stops = [
        Standstill(tuple(float(v) for v in p), float((p - start) @ unit), SETUPS[setup])
        for p in places
    ]
    return stops[::-1] if back else stops


@dataclass
class Timeline:
    """Plays standstills into events. Times in seconds from zero; every random choice from
    ``seed``."""

    stops: list
    seed: int = 0
    rate_hz: float = 250.0
    poll_hz: float = 40.0
    move_s: float = 0.5
    noise_um: float = 0.2
    lead_s: float = 1.0
    first_count: int = 65530
    beam_lost: list = field(default_factory=list)
    """Spans (from, to) in seconds in which the beam is lost; the count goes wrong by ``lost_mm``
    each time."""
    lost_mm: float = 3.3
    zeroed_at: list = field(default_factory=list)
    poll_gaps: list = field(default_factory=list)
    """Spans in which the PLC does not answer."""

    def schedule(self):
        """Return (arrival, departure) of every standstill in seconds."""
        times, now = [], self.lead_s
        for stop in self.stops:
            times.append((now, now + stop.seconds))
            now += stop.seconds + self.move_s
        return times

    @property
    def duration(self):
        return self.schedule()[-1][1] + 1.0

    def reading(self, t):
        """Return the laser's true reading at times t: standing with a settling swing of 5 µm,
        moving in between."""
        knots_t, knots_r = [0.0], [self.stops[0].reading]
        for (begin, end), stop in zip(self.schedule(), self.stops, strict=True):
            knots_t += [begin, end]
            knots_r += [stop.reading, stop.reading]
        value = np.interp(t, knots_t, knots_r)
        for begin, end in self.schedule():
            swing = (t >= begin) & (t < end)
            since = np.maximum(t - begin, 0.0)
            value = value + np.where(
                swing, 5e-3 * np.exp(-since / 0.03) * np.sin(150 * since), 0.0
            )
        return value

    def columns(self):
        """Return the samples as the instrument makes them: times in s, readings in mm, strength of
        the beam."""
        rng = np.random.default_rng(self.seed)
        t = np.arange(0, self.duration, 1 / self.rate_hz)
        value = self.reading(t) + rng.normal(0, self.noise_um * 1e-3, len(t))
        beam = np.full(len(t), 0.9)
        for begin, end in self.beam_lost:
            beam[(t >= begin) & (t < end)] = 0.05
            value = value + self.lost_mm * (t >= begin)
        for moment in self.zeroed_at:
            value = value - np.interp(moment, t, value) * (t >= moment)
        return t, value, beam

    def laser(self):
        """Return chunks of lines ``counter position beam`` as a reader thread would hand them
        over."""
        t, value, beam = self.columns()
        rng = np.random.default_rng(self.seed + 2)
        chunks, arrivals = (
            [],
            np.maximum.accumulate(t + 0.001 + rng.exponential(3e-4, len(t))),
        )
        pick = 0
        while pick < len(t):
            size = int(rng.integers(1, 10))
            lines = "".join(
                f"{(k + 65000) % 65536} {value[k]:.6f} {beam[k]:.2f}\r\n"
                for k in range(pick, min(pick + size, len(t)))
            )
            last = min(pick + size, len(t)) - 1
            chunks.append(Chunk("laser", int(arrivals[last] * 1e6) * 1000, lines.encode()))
            pick += size
        return chunks

    def polls(self):
        """Return the register blocks of polls with 3 to 8 ms between request and answer; the PLC's
        state is that of mid-way."""
        rng = np.random.default_rng(self.seed + 1)
        blocks = []
        for k in range(int(self.duration * self.poll_hz)):
            send = k / self.poll_hz + rng.uniform(0, 2e-3)
            recv = send + rng.uniform(3e-3, 8e-3)
            if any(begin <= send < end for begin, end in self.poll_gaps):
                blocks.append(LinkEvent(int(recv * 1e9), "machine", "silent"))
                continue
            data = self.registers((send + recv) / 2, k)
            blocks.append(ModbusBlock(int(send * 1e9), int(recv * 1e9), BLOCK, (data,)))
        return blocks

    def registers(self, now, heartbeat):
        """Return the 28 bytes of the contract's block at a time."""
        times = self.schedule()
        inside = next(
            (
                k
                for k, (begin, end) in enumerate(times)
                if begin <= now < end and self.stops[k].shown
            ),
            None,
        )
        begun = [k for k, (begin, _) in enumerate(times) if begin <= now]
        count = (self.first_count + sum(self.stops[k].counts for k in begun)) % 65536
        last = self.stops[begun[-1]] if begun else self.stops[0]
        running = now < times[-1][1] + 0.3
        place = [round(v * 1e4) for v in last.position]
        bits = (inside is not None) | (running << 1)
        return struct.pack(
            ">HHHHiiiHHHH",
            heartbeat % 65536,
            count,
            bits,
            last.setup if running else 0,
            *place,
            2010,
            2150,
            10132,
            455,
        )

    def events(self):
        """Return all events in the order in which they arrive."""
        return sorted([*self.laser(), *self.polls()], key=arrival)


def arrival(event):
    """Return when an event reached the host."""
    return (
        event.arrival_ns
        if isinstance(event, Chunk)
        else event.recv_ns
        if isinstance(event, ModbusBlock)
        else event.time_ns
    )


def skipped(stops, index):
    """Return standstills of which Modbus does not show one (the counter still counts it)."""
    return [replace(stop, shown=k != index) for k, stop in enumerate(stops)]
