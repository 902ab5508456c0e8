"""Doubts about a used reading, and the operator's acceptance of a doubt."""

from collections.abc import Iterable

import msgspec

from stepdiag.base.messages import Message, Place, Way, Words, at

DRIVEN_AGAIN = frozenset(
    {
        "angles-far",
        "contradiction-ambiguous",
        "contradiction-ambiguous.length",
        "contradiction-ambiguous.length-far",
        "contradiction-ambiguous.open",
        "increments-coarse",
        "increments-coarse.hidden",
        "noise-high.machine",
        "noise-high.reading",
        "noise-high.stop",
        "pass-wanders",
        "pass-wanders.which",
        "step-mismatch.programs",
        "too-many-outliers",
    }
)
"""Messages that contain a pass or stop to drive again."""
STATED = frozenset({"step-mismatch.exchanged", "step-mismatch.order", "step-mismatch.scales"})
"""Messages that contain a line of the survey file, or a value to enter: driving again does not
remove such a doubt.
"""


class Doubt(msgspec.Struct, frozen=True, kw_only=True):
    """A possible error of a reading. The doubt keeps its pass open until its stop is measured again
    or the operator accepts the doubt.

    ``stop`` is None for the whole pass. ``taken_ns`` is the beginning of the doubted window: a
    repeated stop is another measurement, for which an earlier acceptance is not valid.
    """

    setup: str
    pass_number: int
    stop: int | None
    code: str
    why: Words = msgspec.field(name="text")
    taken_ns: int
    size_um: float | None = None
    way: Way = ""
    last: int | None = None

    @property
    def place(self) -> str:
        """Return the place of the doubt as text: ``ppp/1/5`` is stop 5 of pass 1 of ppp, ``ppp/1``
        is the whole pass.
        """
        return f"{self.setup}/{self.pass_number}" + (
            "" if self.stop is None else f"/{self.stop}"
        )

    @property
    def at(self) -> Place:
        """Return the place of the doubt. The place has no direction if the doubt is from an old
        file, whose message contains the direction.
        """
        return Place(
            setup=self.setup,
            way=self.way,
            pass_number=self.pass_number,
            stop=self.stop,
            last=self.last,
        )

    @property
    def names_the_cure(self) -> bool:
        """Return whether the message of the doubt contains a place to drive again, or a value to
        enter.
        """
        return self.is_stated or (
            isinstance(self.why, Message) and self.why.key in DRIVEN_AGAIN
        )

    @property
    def is_stated(self) -> bool:
        """Return whether only an entered value removes the doubt."""
        return self.code == "air-unknown" or (
            isinstance(self.why, Message) and self.why.key in STATED
        )

    @property
    def line(self) -> str:
        """Return the line of the survey file in the message of the doubt; empty without a line."""
        return (
            str(self.why.arguments.get("line", "")) if isinstance(self.why, Message) else ""
        )

    @property
    def words(self) -> Words:
        return at(self.at, self.why)


def places_of(doubts: Iterable[Doubt]) -> list[str]:
    """Return the different places of doubts, in order. Two findings at one stop have the same
    place.
    """
    return list(dict.fromkeys(doubt.place for doubt in doubts))


class Acceptance(msgspec.Struct, frozen=True, kw_only=True):
    """A person's acceptance of a doubt: the person, the time (seconds since 1970) and the
    reason.
    """

    setup: str
    pass_number: int
    stop: int | None
    code: str
    taken_ns: int
    reason: str
    name: str
    time_s: float

    def covers(self, doubt: Doubt) -> bool:
        """Return whether the acceptance has the same finding and measurement as the doubt."""
        mine = (self.setup, self.pass_number, self.stop, self.code, self.taken_ns)
        return mine == (
            doubt.setup,
            doubt.pass_number,
            doubt.stop,
            doubt.code,
            doubt.taken_ns,
        )


class TimeStated(msgspec.Struct, frozen=True, kw_only=True):
    """A statement by a person of the time of the first stop, in seconds since 1970, with the
    person, the time of the clock at the statement, and the reason.
    """

    begun_s: float
    name: str
    reason: str
    time_s: float


def acceptance_of(doubt: Doubt, *, reason: str, name: str, time_s: float) -> Acceptance:
    return Acceptance(
        setup=doubt.setup,
        pass_number=doubt.pass_number,
        stop=doubt.stop,
        code=doubt.code,
        taken_ns=doubt.taken_ns,
        reason=reason,
        name=name,
        time_s=time_s,
    )
