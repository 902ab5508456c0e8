"""Whether a survey is settled: every pass is in, and every doubt accepted."""

from typing import Literal

from stepdiag.daq.recording.session import Session
from stepdiag.daq.recording.verdicts import mark_of, verdicts_in

Settlement = Literal["", "complete", "doubted"]


class Settled:
    """Answers for survey after survey, and stores early questions.

    While a log is open the answer is unknown: the log may bring another measurement of the doubtful
    stop. The log may also end without a pass, and then no other event would ask again.
    """

    def __init__(self) -> None:
        self._mark: tuple[object, ...] = ()
        self._asked_too_early = False

    def know(self, session: Session) -> None:
        """Take what stands beside a survey for known: its session was begun with it."""
        self._mark = (session.folder, *mark_of(session.folder))

    def heard(self, session: Session) -> bool:
        """Give a session what persons have added to its survey beside this process; return whether
        that was anything new."""
        mark = (session.folder, *mark_of(session.folder))
        if mark == self._mark:
            return False
        self._mark = mark
        session.hear(verdicts_in(session.folder))
        return True

    def due(self, session: Session) -> bool:
        """Return whether to ask for the survey now because the question came while a log was
        open.
        """
        return self._asked_too_early and not session.recording

    def of(self, session: Session) -> Settlement:
        """Return whether a survey is complete, or open for a doubt alone; empty for a missing pass,
        or before this is known.
        """
        self._asked_too_early = session.recording
        if session.recording or (not session.round.logs and not session.book.passes):
            return ""
        if session.book.complete() and not session.unsolved:
            return "complete"
        return "doubted" if session.book.whole() else ""
