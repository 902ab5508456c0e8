"""A server of `stepdiag publish --opcua` that runs, over a finished survey."""

import subprocess
import sys
import time
import typing
from contextlib import contextmanager

from asyncua import ua
from asyncua.ua import ua_binary

from stepdiag.virtual.base.reserved import reserved_port
from testkit.fleets import finished_survey
from testkit.hostile.foreign_logs import SURVEY
from testkit.running.brokers import PATIENCE_S

MODEL = "http://opcfoundation.org/UA/Machinery/Result/"
NOW = ua.Variant(0, ua.VariantType.Int32)
MACHINE = "Mill 7/ä"


def prepared(folder):
    """Return the survey file of a finished survey in a folder."""
    finished_survey(folder / "bench")
    file = folder / "mill.toml"
    file.write_text(
        SURVEY[: SURVEY.index("[[export]]")].replace(
            'machine = "virtual"', f'machine = "{MACHINE}"'
        )
    )
    return file


@contextmanager
def subtyped_values():
    """Let asyncua's client read fields that let subtypes in: asyncua 2.1.0 marks them in an
    annotation, and drops it when it decodes."""
    stripped = ua_binary.get_safe_type_hints

    def marked(cls, extra=None):
        names = {
            name: value
            for name, value in cls.__dict__.items()
            if not isinstance(value, property)
        } | (extra or {})
        return typing.get_type_hints(cls, localns=names, include_extras=True)

    ua_binary.get_safe_type_hints = marked
    try:
        yield
    finally:
        ua_binary.get_safe_type_hints = stripped


class Serving:
    """A server that runs."""

    def __init__(self, survey, *options, program=("-m", "stepdiag")):
        self.url = f"opc.tcp://127.0.0.1:{reserved_port()}/stepdiag"
        self.folder = survey.parent
        self._log = survey.parent / f"opcua-{time.monotonic_ns()}.log"
        address = self.url.removeprefix("opc.tcp://").removesuffix("/stepdiag")
        command = [
            sys.executable,
            *program,
            "publish",
            survey,
            "--opcua",
            address,
            "--every",
            "0.2",
            *options,
        ]
        with self._log.open("wb") as out:
            self.process = subprocess.Popen([*map(str, command)], stdout=out, stderr=out)

    def __enter__(self):
        end = time.monotonic() + PATIENCE_S
        try:
            while "opcua-serves" not in self.said:
                assert self.process.poll() is None, self.said
                assert time.monotonic() < end, self.said
                time.sleep(0.1)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.terminate()
        self.process.wait(PATIENCE_S)

    @property
    def said(self):
        return self._log.read_text()
