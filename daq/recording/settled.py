"""Whether a survey is settled: every pass is complete, and every doubt accepted."""

from typing import Literal

from stepdiag.daq.recording.session import Session
from stepdiag.daq.recording.verdicts import mark_of, verdicts_in

Settlement = Literal["", "complete", "doubted"]


class Settled:
    """Answers for one survey after another, and stores questions that come too early.

    While a log is open the answer is unknown: the log may bring another measurement of the doubtful
    stop. The log may also end without a pass, and no later event would then check again whether the
    survey is complete.
    """

    def __init__(self) -> None:
        self._mark: tuple[object, ...] = ()
        self._asked_too_early = False

    def know(self, session: Session) -> None:
        """Mark the statements beside a survey as known: its session began with them."""
        self._mark = (session.folder, *mark_of(session.folder))

    def heard(self, session: Session) -> bool:
        """Pass to a session the statements that persons added to its survey outside this process;
        return whether there were new ones.
        """
        mark = (session.folder, *mark_of(session.folder))
        if mark == self._mark:
            return False
        self._mark = mark
        session.hear(verdicts_in(session.folder))
        return True

    def due(self, session: Session) -> bool:
        """Return whether to examine the survey now because the question came while a log was
        open.
        """
        return self._asked_too_early and not session.recording

    def of(self, session: Session) -> Settlement:
        """Return whether a survey is complete, or open only for a doubt; empty for a missing pass,
        or before this is known.
        """
        self._asked_too_early = session.recording
        if session.recording or (not session.round.logs and not session.book.passes):
            return ""
        if session.book.complete() and not session.unsolved:
            return "complete"
        return "doubted" if session.book.whole() else ""
