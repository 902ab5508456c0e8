"""The recording process before it records: what is refused first."""

import asyncio
import socket

import pytest

from stepdiag.base.errors import UsageError
from stepdiag.daemon.service import serve
from stepdiag.daq.recording.rounds import FolderLock
from stepdiag.daq.survey.file import load_survey
from testkit.timeline import survey_text


def test_a_second_daemon_on_a_survey_is_refused_for_the_folder_and_not_for_the_port(tmp_path):
    """Both are taken by the first one: whoever chooses another port is refused once more."""
    survey = tmp_path / "survey.toml"
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        survey.write_text(
            survey_text() + f"[page]\nport = {listener.getsockname()[1]}\n", encoding="utf-8"
        )
        lock = FolderLock.take(load_survey(survey).folder(survey))
        try:
            with pytest.raises(UsageError, match="no other daemon in this folder"):
                asyncio.run(serve(survey, completion=("true",)))
        finally:
            lock.release()
