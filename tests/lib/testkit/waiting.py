"""A machine that waits at every stop until its program reads the answer, in virtual time: the
product's NC programs, a laser and a register block before the real session and the real handshake.

The computer may stall: then nothing is read and nothing is polled. The laser may lag behind the
machine, and the stop signal may flicker.
"""

import math
import re
import struct
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from stepdiag.base.findings import Finding
from stepdiag.daemon.driving import sequence_of
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.naming.route import route_of
from stepdiag.daq.recording.handshake import Handshake
from stepdiag.daq.recording.session import Round, Session
from stepdiag.daq.recording.sinks import Nowhere
from stepdiag.daq.records.events import Chunk, ModbusBlock
from stepdiag.daq.survey.file import parse_survey
from stepdiag.exporters.programs import nc_programs
from testkit.timeline import BLOCK, survey_text

STEP_S, SAMPLE_S, POLL_S, ANSWER_S = 0.002, 0.004, 0.01, 0.003
DWELL_S = 0.12
MOST_WAIT_S = 30.0
"""A machine that stands longer waits in vain: no drawn stall is a third of it."""


def survey_of(plan='setups = ["ppp"]', signals="", size=(300.0, 180.0, 120.0)):
    """Return the survey file of a hasty machine with the handshake; ``plan`` are lines of
    `[plan]`."""
    text = survey_text(size=size, n=2, dwell=DWELL_S, signals=signals)
    for line, instead in {
        'setups = ["ppp"]': plan,
        "settle_s = 0.15": "settle_s = 0.02",
        "min_window_s = 0.2": "min_window_s = 0.05",
        "poll_hz = 40": "poll_hz = 100",
    }.items():
        assert line in text
        text = text.replace(line, instead)
    return text + "[plc.handshake]\nenabled = true\n"


@dataclass(frozen=True)
class Disturbed:
    """Rates a second, and mean durations in s, of what disturbs a survey."""

    stalls: float = 0.0
    stalled_s: float = 0.6
    lags: float = 0.0
    lagged_s: float = 0.4
    flickers: float = 0.0
    flicker_s: float = 0.3
    cut_at: tuple = ()
    """Program (from 0) and stop counts of it on the way to which the beam is cut."""
    aborted_at: tuple = ()
    """Program and stop count of it at which the operator aborts the program."""


UNDISTURBED = Disturbed()


@dataclass
class Driven:
    """What came of a survey: stops and findings with their times, and the longest wait."""

    session: Session
    stops: list = field(default_factory=list)
    findings: list = field(default_factory=list)
    longest_s: float = 0.0
    waits_in_vain: str = ""

    @property
    def errors(self):
        """Return the codes of the findings that are errors."""
        return [each.code for each in self.findings if each.severity == "error"]


class Program:
    """The moves and stops of an NC program for LinuxCNC, and the laser's nominal reading at any
    position."""

    def __init__(self, survey, setup):
        (text,) = (
            program.data.decode()
            for program in nc_programs(sequence_of(survey), "linuxcnc")
            if program.setup == setup
        )
        self.items, self.code = [], 0
        for line in text.splitlines():
            if found := re.match(r"G53 G1 X(\S+) Y(\S+) Z(\S+) F", line):
                self.items.append(np.array([float(each) for each in found.groups()]))
            elif found := re.match(r"M68 E1 Q(\d+)", line):
                self.items.append(int(found[1]))
            elif found := re.match(r"M68 E0 Q([1-9]\d*)", line):
                self.code = int(found[1])
        route = route_of(survey.planned, setup, 1)
        self._zero = route.stops_mm[0]
        self._along, *_ = np.linalg.lstsq(
            route.stops_mm - self._zero, route.nominal_mm, rcond=None
        )

    def reading_mm(self, position):
        return float((position - self._zero) @ self._along)


class WaitingMachine:
    """Drives programs in turn; ``captured`` is the register that its program waits for."""

    def __init__(self, programs, rng, disturbed):
        self._programs, self._rng, self._disturbed = programs, rng, disturbed
        self._speed_mm_s = rng.uniform(200, 1500)
        self._times, self._readings = [0.0], [0.0]
        self._until = 0.5
        self._number, self._at = -1, 0
        self._offset_mm = 0.0
        self._target = self.position = self._shown = np.zeros(3)
        self._shown_from = self._flicker_until = self._since = 0.0
        self._beam_from = self._lag_until = self._lag_from = 0.0
        self.state, self.count, self.captured = "idle", 0, int(rng.integers(0, 30))
        self.longest_s = 0.0

    @property
    def _program(self):
        return self._programs[self._number]

    def advance(self, now):
        """Do what the machine does in the step that ends now. Returns whether it goes on."""
        if self.state == "stands":
            self._wait(now)
        elif now >= self._until:
            getattr(self, f"_{self.state}")(now)
        if now >= self._shown_from:
            self._shown = self.position
        return self._number < len(self._programs)

    def _idle(self, now):
        """Put the laser up for the next program, and cut the beam meanwhile; for the same program
        once more, leave it as it is."""
        before = self._program if self._number >= 0 else None
        self._number, self._at = self._number + 1, 0
        if self._number == len(self._programs):
            return
        self._until, self.state, self._target = now + 0.4, "moves", self.position
        if before is self._program:
            return
        self._beam_from = now + 0.2
        self._offset_mm = self._rng.uniform(-50, 50)
        self._knot(now + 1e-3, self._program.reading_mm(self.position) + self._offset_mm)

    def _moves(self, now):
        """End a move, and begin the next item of the program."""
        self.position = self._target
        if self._at == len(self._program.items):
            self.state, self._until = "idle", now + self._rng.uniform(1, 2)
            return
        item = self._program.items[self._at]
        self._at += 1
        if isinstance(item, int):
            self.state, self.count, self._since = "stands", item, now
            self._shown_from = now + self._rng.uniform(0, 0.03)
            return
        self._target = item
        self._until = (
            now + 0.02 + float(np.linalg.norm(item - self.position)) / self._speed_mm_s
        )
        if (self._number, self.count) in self._disturbed.cut_at:
            self._beam_from, self._offset_mm = self._until, self._offset_mm + 3.3
        self._times.append(now)
        self._readings.append(self._readings[-1])
        self._knot(self._until, self._program.reading_mm(item) + self._offset_mm)

    def _wait(self, now):
        if self._rng.random() < STEP_S * self._disturbed.flickers:
            self._flicker_until = now + self._rng.exponential(self._disturbed.flicker_s)
        self.longest_s = max(self.longest_s, now - self._since)
        if now - self._since >= DWELL_S and self.captured == self.count:
            aborted = (self._number, self.count) in self._disturbed.aborted_at
            self.state = "idle" if aborted else "moves"
            self._until = now + aborted * self._rng.uniform(1, 2)
            self._target = self.position

    def _knot(self, time_s, reading_mm):
        self._times.append(time_s)
        self._readings.append(reading_mm)

    def sample(self, now):
        """Return the laser's reading in mm and its beam."""
        if now > self._lag_until and self._rng.random() < SAMPLE_S * self._disturbed.lags:
            self._lag_from = now
            self._lag_until = now + self._rng.exponential(self._disturbed.lagged_s)
        at = self._lag_from if now < self._lag_until else now
        value = np.interp(at - 0.01, self._times[-12:], self._readings[-12:])
        return value + self._rng.normal(0, 1e-4), 0.9 if now > self._beam_from else 0.05

    def registers(self, now, beat):
        """Return the contract's register block."""
        running = 0 <= self._number < len(self._programs) and self.state != "idle"
        stopped = self.state == "stands" and now > self._flicker_until
        place = [round(value * 1e4) for value in self._shown]
        return struct.pack(
            ">HHHHiiiHHHH",
            beat % 65536,
            self.count,
            stopped | running << 1,
            self._program.code if running else 0,
            *place,
            2010,
            2150,
            10132,
            455,
        )


class Computer:
    """Reads the laser and polls the machine, unless it is stalled, and writes the answers."""

    def __init__(self, survey, text, machine, rng, disturbed):
        self._machine, self._rng, self._disturbed = machine, rng, disturbed
        self._now = 0.0
        self._answers = []
        self._lines = []
        self._counter = 65000
        self._sample_at = self._poll_at = self._read_at = 0.0
        self._asked_s = None
        self._stalled_until = 0.0
        self._beats = 0
        session = Session(
            survey,
            text,
            Round(Path("nowhere"), {}),
            Nowhere(),
            on_outcome=self._heed,
            wall_offset_ns=lambda: 0,
        )
        self.driven = Driven(session)
        self._handshake = Handshake(self._answer, None, survey.plan.dwell_s)

    def _heed(self, outcome):
        if isinstance(outcome, CapturedStop):
            self.driven.stops.append(outcome)
            self._handshake.captured(outcome)
        elif isinstance(outcome, Finding):
            self.driven.findings.append(outcome)

    def _answer(self, count):
        self._answers.append((self._now + self._rng.uniform(0.003, 0.02), count))

    def advance(self, now):
        """Do what laser and computer do in the step that ends now."""
        self._now = now
        while self._answers and self._answers[0][0] <= now:
            self._machine.captured = self._answers.pop(0)[1]
        if now >= self._sample_at:
            self._sample_at += SAMPLE_S
            value, beam = self._machine.sample(now)
            self._lines.append(f"{self._counter % 65536} {value:.6f} {beam:.2f}\r\n")
            self._counter += 1
        if now > self._stalled_until and self._rng.random() < STEP_S * self._disturbed.stalls:
            self._stalled_until = now + self._rng.exponential(self._disturbed.stalled_s)
        if now >= self._stalled_until:
            self._work(now)

    def _work(self, now):
        session, now_ns = self.driven.session, int(now * 1e9)
        if now >= self._read_at and self._lines:
            self._read_at = now + self._rng.uniform(0.005, 0.015)
            chunk, self._lines = "".join(self._lines).encode(), []
            session.consume(Chunk("laser", now_ns, chunk))
        if self._asked_s is None and now >= self._poll_at:
            self._asked_s, self._poll_at = now, now + POLL_S
        elif self._asked_s is not None and now >= self._asked_s + ANSWER_S:
            self._beats += 1
            data = self._machine.registers(now, self._beats)
            sent_ns, self._asked_s = int(self._asked_s * 1e9), None
            session.consume(ModbusBlock(sent_ns, now_ns, BLOCK, (data,)))
            self._handshake.look(session.signals, now_ns, lambda: "capturing the stop")


def driven(text, setups, seed, disturbed=UNDISTURBED):
    """Drive the programs of setups one after another, and return what came of it."""
    rng, survey = np.random.default_rng(seed), parse_survey(text, "survey.toml")
    programs = {each: Program(survey, each) for each in setups}
    machine = WaitingMachine([programs[each] for each in setups], rng, disturbed)
    computer = Computer(survey, text, machine, rng, disturbed)
    found = computer.driven
    for step in range(1, math.ceil(600 / STEP_S)):
        if not machine.advance(step * STEP_S):
            found.longest_s = machine.longest_s
            return found
        computer.advance(step * STEP_S)
        if machine.longest_s > MOST_WAIT_S:
            found.waits_in_vain = f"count {machine.count}, answer {machine.captured}"
            return found
    raise AssertionError("the programs do not end within ten minutes")
