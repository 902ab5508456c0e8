"""One reconnecting object: states, growing waits, one warning, clean cancelling."""

import asyncio

import pytest
from structlog.testing import capture_logs

from stepdiag.base.errors import DeviceError
from stepdiag.base.messages import message
from stepdiag.daq.links.reconnect import LONGEST_WAIT_S, Reconnector


def refusal():
    return DeviceError("laser", expected="a port", found="none")


def keep(session, seconds, monkeypatch):
    """Run a reconnector for ``seconds`` of a clock that only sleeping moves; return the changes of
    state and the sleeps."""
    states, sleeps = [], []

    async def run():
        loop = asyncio.get_running_loop()
        started, moved = loop.time(), [0.0]
        really_sleep = asyncio.sleep

        async def sleep(wait_s):
            sleeps.append(wait_s)
            moved[0] += wait_s
            if moved[0] >= seconds:
                raise asyncio.CancelledError
            await really_sleep(0)

        monkeypatch.setattr(loop, "time", lambda: started + moved[0])
        monkeypatch.setattr(asyncio, "sleep", sleep)
        await Reconnector("laser", session, lambda state, *_: states.append(state)).run()

    with pytest.raises(asyncio.CancelledError):
        asyncio.run(run())
    return states, sleeps


def test_a_device_that_is_absent_is_tried_again_and_again_but_warned_of_once(monkeypatch):
    async def absent(report):
        raise refusal()

    with capture_logs() as logs:
        states, sleeps = keep(absent, 20, monkeypatch)
    assert states == ["connecting", "lost"]
    assert sleeps[:5] == [0.05, 0.1, 0.2, 0.4, 0.8]
    assert max(sleeps) == LONGEST_WAIT_S
    assert [entry["log_level"] for entry in logs[:3]] == ["warning", "debug", "debug"]
    assert "warning" not in [entry["log_level"] for entry in logs[1:]]


def test_after_a_steady_session_the_first_wait_is_short_again_and_a_new_loss_is_warned_of(
    monkeypatch,
):
    lives = iter([0, 0, 0, 60, 0, 0])

    async def session(report):
        life_s = next(lives)
        if life_s:
            report("connected", "there")
            await asyncio.sleep(life_s)
        raise refusal()

    with capture_logs() as logs:
        states, sleeps = keep(session, 60.45, monkeypatch)
    assert states == ["connecting", "lost", "connected", "lost"]
    assert sleeps[:5] == [0.05, 0.1, 0.2, 60, 0.05]
    assert [entry["log_level"] for entry in logs if entry["log_level"] != "debug"] == [
        "warning",
        "info",
        "warning",
    ]


def test_a_session_that_fails_at_once_each_time_does_not_spin(monkeypatch):
    async def flapping(report):
        report("connected", "")
        raise refusal()

    _, sleeps = keep(flapping, 20, monkeypatch)
    assert sleeps[-1] == LONGEST_WAIT_S


def test_silence_is_a_state_between(monkeypatch):
    async def session(report):
        for state in ("connected", "connected", "silent", "silent", "connected"):
            report(state, "")
        await asyncio.sleep(100)

    states, _ = keep(session, 50, monkeypatch)
    assert states == ["connecting", "connected", "silent", "connected"]


def test_lost_bytes_stand_beside_the_state_and_hide_no_silence(monkeypatch):
    async def session(report):
        for state, detail, lost in (
            ("connected", "there", ()),
            ("connected", "there", (message("lost-framing", count=3),)),
            ("connected", "there", ()),
            ("silent", "no byte", ()),
            ("connected", "there", (message("lost-parity", count=2),)),
            ("silent", "no byte", ()),
        ):
            report(state, detail, lost)
        raise refusal()

    with capture_logs() as logs:
        states, _ = keep(session, 0.05, monkeypatch)
    assert states == [
        "connecting",
        "connected",
        "connected",
        "silent",
        "connected",
        "silent",
        "lost",
    ]
    told = [(entry["event"], entry["log_level"]) for entry in logs]
    assert told[:6] == [
        ("link-connected", "info"),
        ("link-lost-bytes", "warning"),
        ("link-silent", "warning"),
        ("link-connected", "info"),
        ("link-lost-bytes", "warning"),
        ("link-silent", "warning"),
    ]


def test_a_fault_of_the_program_is_not_taken_for_a_lost_device():
    async def broken(report):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        asyncio.run(Reconnector("laser", broken, lambda *_: None).run())


def test_cancelling_closes_the_session():
    closed = []

    async def session(report):
        try:
            await asyncio.sleep(100)
        finally:
            closed.append(True)

    async def run():
        task = asyncio.create_task(Reconnector("laser", session, lambda *_: None).run())
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        assert asyncio.all_tasks() == {asyncio.current_task()}

    asyncio.run(run())
    assert closed == [True]
