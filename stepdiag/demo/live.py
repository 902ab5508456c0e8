"""``stepdiag demo --live``: the page with a slow virtual survey, and faults that the viewer causes
by a key."""

import json
import os
import secrets
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from stepdiag.base.messages import Message, Words, message
from stepdiag.demo.demo import empty_folder
from stepdiag.demo.files import (
    WATCHED,
    Pace,
    write_angles,
    write_bench,
    write_profiles,
    write_survey,
)
from stepdiag.demo.operator import LOOK_S, Operator, bench, daemon, words
from stepdiag.demo.processes import Talker
from stepdiag.virtual.base.reserved import reserved_port

LOOK_AT_PAGE_S = 8.0
"""Time in s before each setup, in which the page shows the setting up."""
TOKEN_FILE = "page.token"  # noqa: S105  # its name
USUAL_PORT = 8420
GO, END = "\n", "q"


@dataclass(frozen=True, slots=True, kw_only=True)
class Key:
    """The action of a key: a text for the viewer, and the fault of the virtual machine
    (`stepdiag.virtual`). ``placed``: the fault occurs at the next stop."""

    does: Message
    kind: str
    duration_s: float = 1.0
    value: float = 0.0
    text: str = ""
    placed: bool = False

    def order(self, setup: str) -> str:
        place = {"setup": setup} if self.placed else {}
        return "fault " + json.dumps(
            {
                "kind": self.kind,
                "duration_s": self.duration_s,
                "value": self.value,
                "text": self.text,
            }
            | place
        )


KEYS = {
    "b": Key(does=message("key-beam"), kind="beam-lost"),
    "k": Key(does=message("key-knock"), kind="laser-jump", value=60.0),
    "u": Key(does=message("key-unplug"), kind="laser-unplug", duration_s=5.0),
    "p": Key(does=message("key-plc"), kind="plc-silent", duration_s=8.0),
    "a": Key(
        does=message("key-air"),
        kind="plc-sensor",
        text="air_temperature_c",
        value=85.0,
        duration_s=30.0,
    ),
    "s": Key(does=message("key-skip"), kind="stop-skipped", placed=True),
    "r": Key(
        does=message("key-abort"),
        kind="program-aborted",
        value=5.0,
        duration_s=6.0,
        placed=True,
    ),
}


class Person(Protocol):
    def opened(self, address: str, token: str) -> None:
        """Store the address of the page, and the token for its buttons."""

    def show(self, line: Words) -> None:
        """Process an event of the demo."""

    def pressed(self) -> str:
        """Return the key pressed since the last call, empty without a key; `END` ends the demo."""


def live(folder: Path, seed: int, person: Person, pace: Pace = WATCHED) -> None:
    """Run the survey until the viewer ends the demo; all files stay in ``folder``.

    Raises UsageError for a folder with files, DeviceError or DataError for a failed process.
    """
    empty_folder(folder)
    config = write_bench(folder, seed, pace)
    write_angles(folder, config, seed)
    write_profiles(folder)
    token = secrets.token_hex(8)
    os.close(
        os.open(folder / TOKEN_FILE, os.O_CREAT | os.O_EXCL, 0o600)
    )  # from the first moment on, no other account can read the folder
    (folder / TOKEN_FILE).write_text(token, encoding="ascii")
    with bench(config, folder) as hall, page_port() as port:
        page = f'port = {port}\ntoken_file = "{TOKEN_FILE}"'
        survey = write_survey(
            folder, hall.ready["plc_port"], hall.ready["laser_link"], pace=pace, page=page
        )
        with daemon(survey) as recording:
            person.opened(recording.ready["address"], token)
            if _watched(
                hall, recording, Operator(hall, survey, wait_s=LOOK_AT_PAGE_S), person
            ):
                while person.pressed() != END:
                    time.sleep(LOOK_S)


@contextmanager
def page_port() -> Iterator[int]:
    """Yield the usual port of the page; or a free port if another program or another demo uses the
    usual port."""
    with socket.socket(socket.AF_UNIX) as mine, socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            mine.bind(
                f"\0stepdiag demo, page {USUAL_PORT}"
            )  # an abstract socket (unix(7)): the lock ends with this process
            probe.bind(("127.0.0.1", USUAL_PORT))
            port = USUAL_PORT
        except OSError:
            port = reserved_port()
        yield port


def _watched(hall: Talker, recording: Talker, operator: Operator, person: Person) -> bool:
    """Let the survey run and execute the keys; return whether the survey is complete (otherwise the
    viewer has ended the demo).
    """
    ended = False

    def go_on() -> bool:
        nonlocal ended
        key = person.pressed().lower()
        ended = key == END
        if key == GO:
            operator.hurry()
        elif key in KEYS:
            _cause(KEYS[key], hall, operator.setup, person.show)
        return not ended

    for event in words(operator, recording, go_on=go_on, silence_s=float("inf")):
        line = _terminal_line(event)
        if line != "":
            person.show(line)
        if event["event"] == "survey-complete":
            return True
    return False


def _cause(key: Key, hall: Talker, setup: str, show: Callable[[Words], None]) -> None:
    if key.placed and not setup:
        show(message("key-while-driving", does=key.does))
        return
    hall.say(key.order(setup))
    show(key.does)


def _terminal_line(event: dict[str, str]) -> Words:
    match event["event"]:
        case "waiting":
            return message("demo-waits", what=event["what"])
        case "survey-open":
            return message("demo-open", why=event["reason"])
        case "survey-complete":
            return message("demo-complete", path=f"{event['folder']}/report.html")
        case _:
            return ""
