"""The statements that the dialect of each control defines, and the common translation of passes
into blocks.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.base.names import AXES
from stepdiag.base.setups import CODED_FROM, setup_code, setup_of
from stepdiag.exporters.programs.jogs import Jog
from stepdiag.exporters.programs.sequence import Pass, Sequence, Stop, passes_of, travel_mm
from stepdiag.exporters.programs.signals import Signals


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """Input for one program: a setup of a sequence, the number of the setup in the control, and the
    signals of the machine.
    """

    sequence: Sequence
    setup: str
    signals: Signals
    decimals: int

    @property
    def register(self) -> int:
        return setup_code(self.setup, self.sequence.setups)

    @property
    def base(self) -> str:
        return setup_of(self.setup).base

    @property
    def word(self) -> str:
        """Return the setup's name in letters, digits and underscores, for file names."""
        return self.setup.replace("-", "_").replace("+", "_")

    @property
    def program_number(self) -> int:
        """Return the number of the program: 8000 plus the setup number plus a hundred for each beam
        offset, or 7000 + k for the k-th setup of the plan.
        """
        if self.register > CODED_FROM:
            return 7000 + self.register - CODED_FROM
        return 8000 + self.register + 100 * setup_of(self.setup).shift


class Dialect(ABC):
    """The dialect of a control. Subclasses have no state; ``signals`` are the control's default
    signals.
    """

    control: str
    title: str
    newline = "\r\n"
    decimals = 3
    """Decimal places of a programmed position in mm, by the control's usual input increment."""
    opening: tuple[str, ...] = ()
    closing: tuple[str, ...]
    """First and last lines of the file; ``{stem}`` is the file name without its ending."""
    numbered = False
    """Whether every line of a program begins with its number, from 0."""
    signals: Signals
    needs: tuple[str, ...]
    """Requirements of the default signals on the PLC and the control, with their source."""

    checked: tuple[str, ...]
    """Text about the checks of a program before its first move, and about the facts that no program
    can check.
    """

    @abstractmethod
    def file_name(self, job: Job) -> str:
        """Return the program's file name."""

    @abstractmethod
    def comment(self, text: str) -> str:
        """Return a comment block. ``text`` is ASCII without brackets."""

    @abstractmethod
    def start(self) -> list[str]:
        """Return the first blocks of a program, which set known modes, refuse an active offset or
        transformation, and halt until the operator continues.
        """

    @abstractmethod
    def ask(self, text: str) -> list[str]:
        """Return the blocks of a halt with a text for the operator. ``text`` is ASCII without
        brackets.
        """

    @abstractmethod
    def move(self, position: tuple[str, str, str], feed: str) -> str:
        """Return the block of a straight move in machine coordinates, at measuring feed, with an
        exact stop.
        """

    @abstractmethod
    def dwell(self, seconds: str) -> list[str]:
        """Return the blocks of a dwell."""

    def number(self, value: float) -> str:
        """Return the text of a decimal number in the form that the control reads."""
        return plain(value)

    def render(self, job: Job) -> str:
        _check_increment(job)
        blocks = [self.comment(line) for line in self._header(job)]
        blocks += self.start()
        blocks += job.signals.blocks("begin", setup=job.register)
        passes = passes_of(job.sequence, job.setup)
        for each in passes:
            blocks += self._pass_blocks(job, each, passes)
        blocks += job.signals.blocks("end", setup=0)
        return "".join(line + self.newline for line in self._framed(job, blocks))

    def _framed(self, job: Job, blocks: list[str]) -> list[str]:
        stem = self.file_name(job).partition(".")[0]
        first, last = (
            [line.format(stem=stem) for line in lines]
            for lines in (self.opening, self.closing)
        )
        lines = [*first, *blocks, *last]
        return (
            [f"{number} {line}" for number, line in enumerate(lines)]
            if self.numbered
            else lines
        )

    def _header(self, job: Job) -> Iterator[str]:
        sequence = job.sequence
        low, high = travel_mm(sequence, job.setup)
        orders = sequence.plan.run_of(job.setup).driven_orders or (sequence.axis_order,)
        several = setup_of(job.setup).kind in ("step", "face")
        order = f", axis order {' '.join(orders)}" if several else ""
        yield f"stepdiag survey {_ascii(sequence.name)}: setup {_spoken(job.setup)}{order}"
        yield (
            f"{job.sequence.volume.increments} increments, feed {plain(sequence.feed_mm_min)} "
            f"mm/min, dwell {plain(sequence.dwell_s)} s"
        )
        yield "machine coordinates, travel in mm with overrun:"
        for name, least, most in zip(AXES, low, high, strict=True):
            yield (
                f"  {name} from {plain(round(least, job.decimals))} to "
                f"{plain(round(most, job.decimals))}"
            )
        yield "the first move goes straight from where the axes stand to the first point"
        yield f"the plc shows setup {job.register} while this runs, 0 at the end"
        if any(each.jogs for each in passes_of(sequence, job.setup)):
            yield (
                "this run commissions the head: the other axes are jogged at both ends, the "
                "operator is asked to wobble and to block"
            )
        if sequence.handshake:
            yield "handshake: every stop is held until the plc shows its counter as captured"
        yield from self.checked
        yield "not yet proven on this machine: first run in single block, feed override low"
        yield from (
            self.needs
            if job.signals == self.signals
            else ("signals to the plc as the profile of this machine states them",)
        )

    def _pass_blocks(self, job: Job, each: Pass, passes: tuple[Pass, ...]) -> Iterator[str]:
        way = "outward" if each.outward else "return"
        yield self.comment(
            f"{_spoken(job.setup)} pass {each.number} of {passes[-1].number}, {way}"
        )
        if each.approach_mm is not None:
            yield self.comment("approach from outside: backlash taken up")
            yield self._moved(job, each.approach_mm)
        for stop in each.stops:
            for jog in each.jogs.get(stop.stop, ()):
                yield from self._jog_blocks(job, jog)
            yield from self._stop_blocks(job, each, stop)

    def _jog_blocks(self, job: Job, jog: Jog) -> Iterator[str]:
        yield self._moved(job, jog.position_mm)
        if jog.ask:
            yield from self.ask(jog.ask)
        if jog.stand_s > 0.0:
            yield from self.dwell(self.number(jog.stand_s))

    def _stop_blocks(self, job: Job, each: Pass, stop: Stop) -> Iterator[str]:
        axis = f"{stop.axis} moves" if stop.axis else "first stop"
        yield self.comment(
            f"{_spoken(job.setup)} pass {each.number} stop {stop.stop + 1} of {len(each.stops)}: "
            f"{axis}"
        )
        yield self._moved(job, stop.position_mm)
        yield from job.signals.blocks("stand", setup=job.register, count=stop.count)
        yield from self.dwell(self.number(job.sequence.dwell_s))
        if job.sequence.handshake:
            yield from job.signals.blocks("wait", setup=job.register, count=stop.count)
        yield from job.signals.blocks("leave", setup=job.register, count=stop.count)

    def _moved(self, job: Job, point: tuple[float, float, float]) -> str:
        x, y, z = (self.number(round(value, job.decimals)) for value in point)
        return self.move((x, y, z), self.number(job.sequence.feed_mm_min))


def plain(value: float) -> str:
    text = np.format_float_positional(value + 0.0, trim="-")
    return "0" if text == "-0" else text


def _check_increment(job: Job) -> None:
    """Raise ``UsageError`` if a commanded position is no multiple of the control's input increment.

    A control would round the position, and the stop would differ from the target of the survey.
    """
    increment = 10.0**-job.decimals
    for each in passes_of(job.sequence, job.setup):
        for stop in each.stops:
            for axis, value in zip(AXES, stop.position_mm, strict=True):
                if abs(value - round(value, job.decimals)) > 1e-9:
                    raise UsageError(
                        message(
                            "volume-setup-stop", setup=job.setup, stop=stop.stop, axis=axis
                        ),
                        expected=message("positions-in-whole-input", plain=plain(increment)),
                        found=f"{value!r} mm",
                        remedy=message("choose-size-mm-as"),
                    )


def _spoken(setup: str) -> str:
    return setup.replace("+", " beam ").replace("-", " ")


def _ascii(text: str) -> str:
    return "".join(
        letter if letter.isascii() and (letter.isalnum() or letter in " .-_") else "_"
        for letter in text
    )
