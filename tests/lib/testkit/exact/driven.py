"""A whole survey of the exact virtual machine as events, spoiled by faults: from the wires' bytes
to the files a control loads.

The machine's errors are straight lines between the stops: tables can hold them, so what is left
after loading them is the survey's doing.
"""

import json
import struct
from dataclasses import dataclass, field

import numpy as np

from stepdiag.base.findings import Finding
from stepdiag.base.result.field import without_rigid_motion
from stepdiag.base.volume import Volume
from stepdiag.daq.recording.session import Round, Session
from stepdiag.daq.recording.sinks import DirectSink
from stepdiag.daq.survey.file import parse_survey
from stepdiag.virtual.control.siemens import SiemensControl
from stepdiag.virtual.drive.sequence import Box
from stepdiag.virtual.drive.setups import Alignment, aligned_setup
from stepdiag.virtual.physics.error_functions import (
    Amplitudes,
    ErrorSet,
    Table,
    random_errors,
)
from stepdiag.virtual.physics.machine import Machine
from testkit.cli import stepdiag
from testkit.ordinary.measured import simulate_pass
from testkit.timeline import SETUPS as NUMBERS
from testkit.timeline import Standstill, Timeline, survey_text

BOX_MM = (300.0, 200.0, 100.0)
SETUPS = ("ppp", "npp", "pnp", "ppn", "linear-x", "linear-y", "linear-z")
ERRS = Amplitudes(
    positioning_um=6.0,
    straightness_um=5.0,
    angle_urad=1.0,
    scale_um_m=30.0,
    squareness_urad=25.0,
)
RATE_HZ, POLL_HZ = 100.0, 20.0
"""So slow that a survey is recorded in a second of the processor."""
WALL_OFFSET_NS = 1_800_000_000 * 10**9
PROFILE = (
    '[machine]\nname = "virtual"\ncontroller = "siemens"\nmeasured_with = '
    '"off"\n[limits]\nslope_um_mm = 2.0\n'
)
AXIS = '[axes.{letter}]\nname = "AX{number}"\nstep_mm = {step!r}\nreference_mm = 0.0\n'
SECTIONS = 4


@dataclass(frozen=True)
class Fault:
    """One fault at a stop: on the way to it (``slip``, ``beam``, ``reset``), while the machine
    stands there, or right after.

    Of a dwell that is ``cut`` the value is what is left of it in seconds.
    """

    kind: str
    setup: str = "ppp"
    number: int = 1
    stop: int = 3
    value: float = 0.0


def machine_of(seed, size=BOX_MM, n=2, errs=ERRS):
    """Return a drawn machine whose displacements are straight between the stops."""
    drawn = random_errors(seed, (0.0, 0.0, 0.0), size, errs)
    functions = dict(drawn.functions)
    for name in [name for name in functions if name[1] in "XYZ"]:
        at = np.linspace(0.0, size["XYZ".index(name[2])], n + 1)
        functions[name] = Table(tuple(at.tolist()), tuple(functions[name](at).tolist()))
    return Machine(
        errors=ErrorSet(
            low_mm=drawn.low_mm,
            size_mm=size,
            functions=functions,
            squareness_urad=drawn.squareness_urad,
        )
    )


@dataclass
class Bench(Timeline):
    """A timeline that also tells what faults make of count, registers and bytes. Spans are (from,
    to) in seconds."""

    steps: list = field(default_factory=list)
    """(moment, mm): the count goes wrong by so much."""
    frozen: list = field(default_factory=list)
    garbage: list = field(default_factory=list)
    alarms: list = field(default_factory=list)
    dead: list = field(default_factory=list)
    """Spans in which the registers stay as they were."""
    flickers: list = field(default_factory=list)
    sensors: list = field(default_factory=list)
    """(from, to, index, value): one of the four registers of the sensors."""
    lag_s: float = 0.0
    sign: float = 1.0

    def columns(self):
        t, value, beam = super().columns()
        for moment, mm in self.steps:
            value = value + mm * (t >= moment)
        for begin, end in self.frozen:
            inside = (t >= begin) & (t < end)
            value = np.where(inside, value[np.argmax(inside)], value)
        return t, self.sign * value, beam

    def laser(self):
        return [
            _spoiled(chunk) if _within(chunk.arrival_ns * 1e-9, self.garbage) else chunk
            for chunk in super().laser()
        ]

    def registers(self, now, heartbeat):
        for begin, end in self.dead:
            if begin <= now < end:
                return super().registers(begin, int(begin * self.poll_hz))
        beat, count, bits, *rest = struct.unpack(
            ">HHHHiiiHHHH", super().registers(now, heartbeat)
        )
        if self.lag_s:
            _, count, _, setup, *place = struct.unpack(
                ">HHHHiiiHHHH", super().registers(now - self.lag_s, heartbeat)
            )
            rest = [setup, *place]
        bits |= 4 * _within(now, self.alarms)
        bits &= ~1 if _within(now, self.flickers) else ~0
        for begin, end, index, told in self.sensors:
            if begin <= now < end:
                rest[4 + index] = told
        return struct.pack(">HHHHiiiHHHH", beat, count, bits, *rest)


def _within(now, spans):
    return any(begin <= now < end for begin, end in spans)


def _spoiled(chunk):
    return type(chunk)(
        chunk.stream,
        chunk.arrival_ns,
        bytes(byte ^ 0x55 if index % 3 else byte for index, byte in enumerate(chunk.data)),
    )


class Program:
    """Drives the passes of a survey one after the other and meets its faults."""

    def __init__(
        self,
        machine,
        *,
        size=BOX_MM,
        n=2,
        back=False,
        faults=(),
        seed=0,
        decimals=None,
        swapped=(),
        order="xyz",
        dwell_s=0.55,
        overrun=True,
    ):
        self.machine, self.back, self.order, self.dwell_s = machine, back, order, dwell_s
        self.box = Box(size_mm=size, increments=n, decimals=decimals)
        self.stops, self.spans, self.count_mm = [], [], 0.0
        self.faults = list(faults)
        self.rng = np.random.default_rng(seed)
        self.swapped, self.overrun = dict(swapped), overrun

    def drive(self, setup, passes=None):
        """Drive the passes of a setup: the mirror is set up for it first, with the beam
        interrupted."""
        driven = self.swapped.get(setup, setup)
        how = Alignment() if "-" in setup else Alignment(mirror_mrad=(0.3, -0.2))
        numbers = passes or ((1, 2) if self.back else (1,))
        first = simulate_pass(
            self.machine, self.box, driven, numbers[0], alignment=how, axis_order=self.order
        )
        self._stand(first.position_mm[0], 0.0, setup=0, seconds=0.6, shown=False, counts=0)
        self.spans.append(("lost", len(self.stops) - 1, float(self.rng.uniform(-50, 50))))
        self.count_mm = -first.first_mm
        for number in numbers:
            self._pass(setup, driven, number, how)

    def _pass(self, setup, driven, number, how):
        taken = simulate_pass(
            self.machine, self.box, driven, number, alignment=how, axis_order=self.order
        )
        reads = taken.first_mm + taken.reading_mm
        placed = aligned_setup(self.machine, self.box, driven, how)
        name = NUMBERS[setup]
        towards = 2.0 * np.sign(taken.position_mm[1] - taken.position_mm[0])
        before_mm = -2.0 if number % 2 else 2.0
        if self.overrun:
            self._stand(
                taken.position_mm[0] - towards,
                reads[0],
                setup=name,
                seconds=0.03,
                shown=False,
                counts=0,
                off_mm=before_mm,
            )
        stop, beside = 0, {}
        while stop < len(reads):
            here = [
                fault
                for fault in self.faults
                if (fault.setup, fault.number, fault.stop) == (setup, number, stop)
            ]
            self.faults = [fault for fault in self.faults if fault not in here]
            kinds = {fault.kind: fault.value for fault in here}
            if "slip" in kinds:
                self.count_mm += kinds["slip"] * 1e-3
            if "skipped" in kinds:
                stop += 1
                continue
            beside = {
                "shown": "unsignalled" not in kinds,
                "counts": {"doubled": 2, "missed": 0}.get(next(iter(kinds), ""), 1),
            }
            self._stand(
                taken.position_mm[stop],
                reads[stop],
                setup=name,
                seconds=kinds.get("cut", self.dwell_s),
                **beside,
            )
            at = len(self.stops) - 1
            self.spans += [(kind, at, value) for kind, value in kinds.items()]
            if "hold" in kinds and stop + 1 < len(reads):
                middle = 0.5 * (taken.position_mm[stop] + taken.position_mm[stop + 1])
                read = self.machine.indicated_mm(placed, middle[None, :])[0]
                self._stand(middle, read, setup=name, counts=0)
            if "home" in kinds:
                self._stand(
                    taken.position_mm[0] - 20.0, reads[0] - 40.0, setup=name, counts=0
                )
            if "touched" in kinds:
                self.count_mm += kinds["touched"] * 1e-3
            if "left" in kinds:
                return
            if "abort" in kinds:
                stop = max(stop - int(kinds["abort"]), 0)
                self._stand(
                    taken.position_mm[stop] - towards,
                    reads[stop],
                    setup=name,
                    seconds=0.03,
                    shown=False,
                    counts=0,
                    off_mm=before_mm,
                )
                continue
            stop += 1

    def finish(self, seconds=3.0):
        """Leave the last stop: a machine without signals shows only so that it has stood there."""
        last = self.stops[-1]
        self.stops.append(Standstill(last.position, last.reading + 7.0, 0, seconds, 0, False))

    def _stand(
        self, position, reading, *, setup, seconds=0.55, shown=True, counts=1, off_mm=0.0
    ):
        place = tuple(float(value) for value in position)
        self.stops.append(
            Standstill(
                place, float(reading + self.count_mm + off_mm), setup, seconds, counts, shown
            )
        )

    def events(self, *, noise_um=0.1, bench=Bench, **more):
        """Return everything that recorder and PLC link would hand over; ``bench`` is the class of
        the timeline."""
        pace = {"rate_hz": RATE_HZ, "poll_hz": POLL_HZ, "move_s": 0.3, "lost_mm": 0.0}
        bench = bench(self.stops, seed=3, noise_um=noise_um, **(pace | more))
        times = bench.schedule()
        for kind, at, value in self.spans:
            begin, end = times[at]
            if kind == "lost":
                bench.beam_lost.append((begin, end - 0.1))
                bench.steps.append((begin, value))
            elif kind == "beam":
                bench.beam_lost.append((begin - 0.2, begin - 0.1))
                bench.steps.append((begin - 0.15, value))
            elif kind == "reset":
                bench.zeroed_at.append(begin - 0.15)
            elif kind == "jump":
                bench.steps.append((0.5 * (begin + end) + 0.08, value * 1e-3))
            elif kind == "frozen":
                bench.frozen.append((begin + 0.1, end + value))
            elif kind == "garbage":
                bench.garbage.append((begin - 0.2, begin + value))
            elif kind == "silent":
                bench.poll_gaps.append((begin - 0.1, begin + value))
            elif kind == "alarm":
                bench.alarms.append((begin - 0.15, begin + 0.1))
            elif kind == "dead":
                bench.dead.append((begin + 0.2, begin + value))
            elif kind == "flicker":
                bench.flickers.append((begin + 0.15, begin + 0.2))
            elif kind in ("material", "air", "pressure", "humidity"):
                bench.sensors.append(
                    (
                        begin - 0.3,
                        end + 0.1,
                        ("material", "air", "pressure", "humidity").index(kind),
                        int(value),
                    )
                )
        return bench.events()


def survey_file(*, size=BOX_MM, n=2, back=False, signals="", setups=SETUPS, compensated=True):
    """Return the survey file of a bench."""
    text = survey_text(
        size=size, n=n, setups=setups, back=back, signals=signals, rate_hz=RATE_HZ
    )
    text = text.replace("compensated = true", f"compensated = {str(compensated).lower()}")
    return text.replace("[laser]", '[machine]\ncompensation = "off"\n[laser]', 1)


def recorded(folder, text, events, sink=None):
    """Record the events of a survey into a folder of logs as the daemon would; return the session
    and what it found."""
    said = []
    survey, offset = parse_survey(text, "survey.toml"), WALL_OFFSET_NS
    session = Session(
        survey,
        text,
        Round(folder, {}),
        sink or DirectSink(),
        on_outcome=said.append,
        wall_offset_ns=lambda: offset,
    )
    for event in events:
        session.consume(event)
    session.close("the bench has ended")
    return session, [each for each in said if isinstance(each, Finding)]


@dataclass(frozen=True)
class Judged:
    """What became of a survey: exit codes of solve, export and verify (None: not tried), the
    volume's true rms error in um before and with the files loaded (None: no files), and the codes
    and words of what stands in the result."""

    solve: int
    export: int | None
    verify: int | None
    before_um: float
    after_um: float | None
    codes: frozenset
    words: str
    lines: tuple = ()
    """The lines of the survey file that the result's findings name."""
    unseen: dict = field(default_factory=dict)
    """The passes in which a slip may go unseen, as the result names them (``ppp/1``), each with the
    effect on the volume of a slip of 1 um."""


def judged(folder, logs, machine, size=BOX_MM):
    """Solve the logs, export, verify, load the files: by the command line, as a person would."""
    result = folder / "result.json"
    before = rms_um(machine, (), size)
    told = stepdiag("solve", logs, "--out", result)
    if told.code not in (0, 3) or not result.exists():
        return Judged(
            told.code, None, None, before, None, frozenset(), told.refusal or told.out
        )
    solved = json.loads(result.read_text(encoding="utf-8"))
    findings, unseen = solved["findings"], _unseen(solved.get("unseen_slip"))
    lines = tuple(line for each in findings for line in _lines_of(each.get("arguments")))
    codes, words = (
        frozenset(each["code"] for each in findings if each["severity"] != "info"),
        " | ".join(each["text"] for each in findings),
    )
    profile = folder / "siemens.toml"
    axes = (
        AXIS.format(letter=letter, number=at + 1, step=length / SECTIONS)
        for at, (letter, length) in enumerate(zip("XYZ", size, strict=True))
    )
    profile.write_text(
        "".join(
            [
                PROFILE,
                *axes,
                "[siemens]\nmeasuring_system = 1\nold_enabled = true\nold_weight = 1.0\n",
            ]
        ),
        encoding="utf-8",
    )
    out = folder / "export"
    done = stepdiag(
        "export", result, "--controller", "siemens", "--profile", profile, "--out", out
    )
    if done.code:
        return Judged(
            told.code,
            done.code,
            None,
            before,
            None,
            codes,
            f"{words} | {done.refusal}",
            lines,
        )
    files = [path for path in sorted(out.glob("*.INI")) if "_RESTORE" not in path.name]
    verified = stepdiag("verify", result, *files, "--profile", profile)
    after = rms_um(machine, files, size)
    return Judged(told.code, 0, verified.code, before, after, codes, words, lines, unseen)


def _unseen(slips):
    """Return the passes in which a slip may go unseen, each with the effect of 1 um of it."""
    sizes = [each for each in (slips or {}).values() if each and each["half_um"]]
    return {
        name: each["volume_um"] / each["half_um"] for each in sizes for name in each["passes"]
    }


def _lines_of(arguments):
    """Return the lines of the survey file that a finding's message names, itself or within
    another."""
    if not isinstance(arguments, dict):
        return []
    own = [str(arguments["line"])] if "line" in arguments else []
    return own + [line for value in arguments.values() for line in _lines_of(value)]


def rms_um(machine, files, size=BOX_MM):
    """Return the rms error of the tool over the volume with files loaded, without the shift and
    turn of the workpiece."""
    control = SiemensControl()
    for file in files:
        control.load(file.read_text(encoding="ascii"))
    machine.compensations = control.tables() if files else ()
    axes = [np.linspace(0.0, length, 5) for length in size]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    volume = Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=size, increments=2)
    left = without_rigid_motion(volume, points, machine.error_at(points))
    machine.compensations = ()
    return float(np.sqrt(np.mean(np.sum(left**2, axis=1))))
