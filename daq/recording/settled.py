"""Decides whether a survey is settled: every pass is complete, and every doubt accepted."""

from typing import Literal

from stepdiag.daq.recording.session import Session
from stepdiag.daq.recording.verdicts import mark_of, verdicts_in

Settlement = Literal["", "complete", "doubted"]


class Settled:
    """Answers whether a survey is settled, and stores questions that come too early.

    While a log is open the answer is unknown, because the log may contain another measurement of a
    doubtful stop. The question is then stored, so that the daemon asks again after the end of the
    log, even if the log contains no pass.
    """

    def __init__(self) -> None:
        self._mark: tuple[object, ...] = ()
        self._asked_too_early = False

    def know(self, session: Session) -> None:
        """Record that the session has read the statements beside the survey's logs."""
        self._mark = (session.folder, *mark_of(session.folder))

    def heard(self, session: Session) -> bool:
        mark = (session.folder, *mark_of(session.folder))
        if mark == self._mark:
            return False
        self._mark = mark
        session.hear(verdicts_in(session.folder))
        return True

    def due(self, session: Session) -> bool:
        return self._asked_too_early and not session.recording

    def of(self, session: Session) -> Settlement:
        """Return whether a survey is complete, or open only because of a doubt; empty if a pass is
        missing or the answer is not known yet.
        """
        self._asked_too_early = session.recording
        if session.recording or (not session.round.logs and not session.book.passes):
            return ""
        if session.book.complete() and not session.unsolved:
            return "complete"
        return "doubted" if session.book.whole() else ""
