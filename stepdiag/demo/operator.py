"""Virtual machine and daemon as processes, and an operator that starts the setups and repeats
passes on request of the daemon."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from stepdiag.base.errors import DataError, DeviceError
from stepdiag.base.messages import message
from stepdiag.daemon.survey_state import standing_of
from stepdiag.demo.files import SETUPS
from stepdiag.demo.processes import Talker, talking

READY_S = 120.0
SILENCE_S = 120.0
"""Longest time in s until the next message of the daemon."""
SOLVING_S = 900.0
"""Longest time in s for solving: the solver has the lowest priority and mostly waits on a busy
computer."""
HAND_S = 1.0
"""Time in s between the last preparation and the start: a person does not start the program within
the daemon's first milliseconds."""
SETTLED_S = 2.0
"""Time in s without a message of the daemon after the end of the machine's program. After this
time, the daemon has reported all missing passes."""
MOST_AGAIN = 20
"""Largest number of repetitions of a setup. On a quiet computer hardly any pass is repeated. With
fifteen busy processes per core, six repetitions were not enough."""
LOOK_S = 0.02


class Operator:
    """The operator of the virtual machine. ``setup`` is the setup that is being driven, empty while
    the machine waits."""

    def __init__(self, hall: Talker, survey: Path, *, wait_s: float = 0.0) -> None:
        """Begin without a setup; ``wait_s`` is the time for which the operator reads the page
        before each start.
        """
        self._hall = hall
        self._survey = survey
        self._wait_s = wait_s
        self._begun = 0
        self._again = 0
        self._idle_since = 0.0
        self._asked = False
        self.setup = ""

    @property
    def idle(self) -> bool:
        return self._idle_since > 0.0

    def look(self) -> None:
        while (event := self._hall.poll()) is not None:
            self.setup = event["setup"]
            self._idle_since = 0.0 if self.setup else time.monotonic()

    def hurry(self) -> None:
        self._idle_since = self._idle_since and time.monotonic() - self._wait_s

    def heard(self) -> None:
        """Process a message of the daemon: the missing passes may have changed, so `start` reads
        the missing passes again."""
        self._asked = False

    def start(self, silent_s: float) -> None:
        """Start the next setup if the machine waits for a start. After the last setup, start the
        setups of the missing passes when the daemon has been silent for ``silent_s``.

        Raises DataError if a setup is still incomplete after several repetitions.
        """
        if not self.idle or time.monotonic() - self._idle_since < self._wait_s:
            return
        if self._begun < len(SETUPS):
            self._begun += 1
            self._say("start")
        elif silent_s > SETTLED_S and not self._asked:
            self._asked = True
            standing = standing_of(self._survey)
            if standing.next_setup:
                self._drive_again(
                    standing.next_setup,
                    "; ".join(str(doubt.words) for doubt in standing.doubts),
                )

    def _drive_again(self, setup: str, why: str) -> None:
        self._again += 1
        if self._again > MOST_AGAIN:
            raise DataError(
                str(self._survey), expected=message("solvable-survey"), found=why or setup
            )
        self._say(f"start {setup}")

    def _say(self, order: str) -> None:
        self._idle_since = 0.0
        self._hall.say(order)


@contextmanager
def bench(config: Path, folder: Path) -> Iterator[Talker]:
    command = (
        sys.executable,
        "-P",
        "-m",
        "stepdiag.virtual",
        "--config",
        str(config),
        "--directory",
        str(folder / "devices"),
    )
    with talking(command, errors=False) as hall:
        hall.ready = hall.next(READY_S, "virtual machine")
        yield hall


@contextmanager
def daemon(survey: Path) -> Iterator[Talker]:
    """Run the daemon while the block runs; enter the block when laser and machine are connected.
    ``ready`` receives the address of the page."""
    with talking(
        (sys.executable, "-P", "-m", "stepdiag", "run", str(survey)), errors=True
    ) as recording:
        connected: set[str] = set()
        while not {"laser", "machine"} <= connected:
            event = recording.next(READY_S, "stepdiag run")
            if event.get("event") == "link-connected":
                connected.add(event["link"])
            elif event.get("event") == "page":
                recording.ready = event
            elif event.get("event") == "text":
                raise DeviceError(
                    "stepdiag run", expected=message("daemon-records"), found=event["text"]
                )
        time.sleep(HAND_S)
        yield recording


def words(
    operator: Operator,
    recording: Talker,
    *,
    go_on: Callable[[], bool] = lambda: True,
    silence_s: float = SILENCE_S,
) -> Iterator[dict[str, str]]:
    """Yield the daemon's events while the operator works, as long as ``go_on`` returns True.

    Raises DeviceError after a silence of ``silence_s``, or of `SOLVING_S` while the daemon solves.
    """
    waits_for, heard = "nothing", time.monotonic()
    while go_on():
        operator.look()
        operator.start(time.monotonic() - heard)
        if (event := recording.poll()) is not None:
            heard = time.monotonic()
            operator.heard()
            waits_for = event["what"] if event["event"] == "waiting" else waits_for
            yield event
        elif time.monotonic() - heard > (
            max(silence_s, SOLVING_S) if waits_for == "solving" else silence_s
        ):
            raise DeviceError(
                "stepdiag run",
                expected=message("complete-survey"),
                found=message("status-waits", what=waits_for),
            )
        else:
            time.sleep(LOOK_S)
