"""The person at the control of the demo: one setup after the other, then what the survey still
lacks, and not for ever."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest

from stepdiag.base.errors import DataError
from stepdiag.demo import operator as module
from stepdiag.demo.files import SETUPS
from stepdiag.demo.live import KEYS
from stepdiag.demo.operator import MOST_AGAIN, SETTLED_S, Operator
from stepdiag.virtual.base.faults import PROGRAM, Fault


@dataclass
class Hall:
    """A virtual machine that does at once what it is told."""

    told: list[str] = field(default_factory=list)
    says: list[dict[str, str]] = field(
        default_factory=lambda: [{"event": "waiting", "setup": ""}]
    )

    def poll(self) -> dict[str, str] | None:
        return self.says.pop(0) if self.says else None

    def say(self, order: str) -> None:
        self.told.append(order)
        self.says += [{"event": "setup", "setup": "x"}, {"event": "waiting", "setup": ""}]


def lacking(monkeypatch: pytest.MonkeyPatch, *setups: str) -> None:
    """Have the survey lack these setups, one after the other, the last one for ever."""
    answers = list(setups)
    standing = SimpleNamespace(doubts=(SimpleNamespace(words="stop 3 is doubted"),))
    monkeypatch.setattr(
        module,
        "standing_of",
        lambda _: SimpleNamespace(
            next_setup=answers.pop(0) if len(answers) > 1 else answers[0],
            doubts=standing.doubts,
        ),
    )


def turns(operator: Operator, count: int, silent_s: float = SETTLED_S + 1.0) -> None:
    for _ in range(count):
        operator.look()
        operator.heard()
        operator.start(silent_s)


def test_what_the_survey_lacks_is_driven_again_until_it_lacks_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    hall = Hall()
    lacking(monkeypatch, "npp", "linear-x", "")
    turns(Operator(hall, Path("survey.toml")), 30)  # type: ignore[arg-type]
    assert hall.told == ["start"] * len(SETUPS) + ["start npp", "start linear-x"]


def test_the_daemon_has_time_to_say_what_it_lacks(monkeypatch: pytest.MonkeyPatch) -> None:
    hall = Hall()
    lacking(monkeypatch, "npp")
    turns(Operator(hall, Path("survey.toml")), 30, silent_s=SETTLED_S / 2)  # type: ignore[arg-type]
    assert hall.told == ["start"] * len(SETUPS)


def test_a_survey_that_stays_open_is_refused_with_the_reason(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    hall = Hall()
    lacking(monkeypatch, "npp")
    with pytest.raises(DataError, match="stop 3 is doubted"):
        turns(Operator(hall, Path("survey.toml")), 30)  # type: ignore[arg-type]
    assert hall.told[len(SETUPS) :] == ["start npp"] * MOST_AGAIN


def test_every_key_is_a_fault_that_the_virtual_machine_knows() -> None:
    """Those of the program itself strike at a place of it."""
    for key in KEYS.values():
        order, _, fault = key.order("npp").partition(" ")
        assert order == "fault"
        read = msgspec.json.decode(fault, type=Fault)
        assert json.loads(fault)["kind"] == key.kind
        assert read.placed == (read.kind in PROGRAM)
