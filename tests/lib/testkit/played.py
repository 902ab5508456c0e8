"""A source for the page that plays a survey: what the daemon would say, without machine, laser or
log."""

import asyncio
import shutil
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from datetime import date
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from structlog.contextvars import get_contextvars

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import Place, message
from stepdiag.base.names import AXES
from stepdiag.base.readings.runs import Plan, Run
from stepdiag.base.result.interval import Interval
from stepdiag.conclusion import Export, Reach, conclude, conclusion_json
from stepdiag.daq.records.status import (
    CommandName,
    FindingStatus,
    LinkStatus,
    SetupStatus,
    Snapshot,
    StopStatus,
    StripStatus,
)
from stepdiag.daq.service.geometry import geometry
from stepdiag.exporters.export.export import export
from stepdiag.page.keeper import Listeners, address_of, open_listener, page_kept
from stepdiag.page.messages import PageSettings
from stepdiag.report.document import build_report
from stepdiag.report.drawings.figures import field_of
from stepdiag.report.exported import exported_of
from stepdiag.texts.texts import Language
from testkit.exact.madeup import VOLUME, made_up_result
from testkit.stops import diagonal_stops_mm

Answer = TypeVar("Answer")
REACH = Reach(
    rms_before=Interval(value_um=11.7, low_um=10.9, high_um=12.6),
    largest_before=Interval(value_um=27.0, low_um=25.1, high_um=29.4),
    rms_after=Interval(value_um=1.9, low_um=1.3, high_um=2.6),
    largest_after=Interval(value_um=4.4, low_um=3.0, high_um=6.2),
)
SETUPS = ("ppp", "npp", "pnp", "ppn", "linear-x")
STRIP_BIN_S, STRIP_BINS = 0.02, 75
COUNTS_LOST = tuple(
    FindingStatus(
        code="beam-lost",
        severity="error",
        text=f"npp out, stop {stop} of 30: the count was lost",
        message=message("count-was-lost"),
        at=Place(setup="npp", way="out", pass_number=1, stop=stop, last=30),
    )
    for stop in range(5, 13)
)
"""One cause at eight stops."""


class PlayedSurvey:
    """Implements `daq.records.status.StatusSource`. Fed like the daemon is: `laser_speaks` and
    `plc_speaks` keep the links young."""

    def __init__(self, folder: Path) -> None:
        self.place = folder
        self.addresses: list[str] = []
        self.guessed: list[tuple[str, int]] = []
        self.fields: dict[str, Any] = _beginning()
        self.ordered: list[tuple[str, dict[str, str]]] = []
        self.refusal: UsageError | None = None
        self.snapshots_taken = 0
        self._sequence = 0
        self._news = asyncio.Event()
        self._heard = {"laser": time.monotonic(), "plc": time.monotonic()}
        self.silent: set[str] = set()

    def begin_anew(self) -> None:
        """Be as at the beginning: what was captured, ordered and computed is gone."""
        for name in ("result.json", "conclusion.json", "report.html"):
            (self.place / name).unlink(missing_ok=True)
        shutil.rmtree(self.place / "exports", ignore_errors=True)
        self.addresses.clear()
        self.guessed.clear()
        self.ordered.clear()
        self.silent.clear()
        self.refusal = None
        self.fields = {}
        self.publish(**_beginning())

    def publish(self, **fields: Any) -> None:
        """Change some fields, as the daemon does."""
        self.fields |= fields
        self._sequence += 1
        self._news.set()
        self._news = asyncio.Event()

    def hear(self) -> None:
        """Let every link that is not silenced speak now."""
        for name in self._heard.keys() - self.silent:
            self._heard[name] = time.monotonic()

    def snapshot(self) -> Snapshot:
        self.hear()
        self.snapshots_taken += 1
        now = time.monotonic()
        links = {name: self._link(name, now - heard) for name, heard in self._heard.items()}
        setups, expects = self.fields["setups"], self.fields["expects_setup"]
        runs = tuple(
            Run(setup=name)
            for name in dict.fromkeys((*(one.name for one in setups), expects))
            if name
        )
        drawn = geometry(
            Plan(volume=VOLUME, runs=runs),
            setups,
            expects,
            self.fields.get("expects_pass", 1),
        )
        fields = {"strip": self._strip(now), **self.fields}
        return Snapshot(
            sequence=self._sequence,
            wall_time="2026-01-01T00:00:00Z",
            geometry=drawn,
            **links,
            **fields,
        )

    def _strip(self, now: float) -> StripStatus | None:
        """Return the newest second and a half: noise of a tenth of a micrometre about the reading;
        nothing while the laser is silent."""
        if "laser" in self.silent:
            return None
        first = int(now / STRIP_BIN_S) - STRIP_BINS + 1
        noise = 1e-4 * np.sin(0.7 * np.arange(first, first + STRIP_BINS) ** 2)
        low, high = (
            tuple((self.fields["reading_mm"] + noise + side).tolist())
            for side in (-5e-5, 5e-5)
        )
        return StripStatus(first=first, bin_s=STRIP_BIN_S, low_mm=low, high_mm=high)

    def _link(self, name: str, age_s: float) -> LinkStatus:
        address = {"laser": "/dev/ttyUSB0", "plc": "127.0.0.1:502"}[name]
        return LinkStatus(
            state="silent" if name in self.silent and age_s > 2 else "connected",
            address=address,
            age_s=age_s,
        )

    async def changed(self, sequence: int) -> None:
        while sequence == self._sequence:
            await self._news.wait()

    def result_file(self) -> Path | None:
        return self.place / "result.json" if self.fields["result_ready"] else None

    def folder(self) -> Path:
        return self.place

    def token_guessed(self, address: str, count: int) -> None:
        self.guessed.append((address, count))

    async def command(self, name: CommandName, arguments: Mapping[str, str]) -> None:
        if self.refusal is not None:
            raise self.refusal
        self.ordered.append((name, dict(arguments)))
        self.addresses.append(str(get_contextvars()["address"]))
        if name == "name":
            self.publish(**arguments)

    def stop(self, setup: str, pass_number: int, stop: int) -> None:
        """Capture one stop and wait for the next."""
        stops = diagonal_stops_mm(VOLUME, setup)
        stops = stops if pass_number % 2 else stops[::-1]
        deviation = 4 * np.sin(stop / 5) + 0.1 * stop * (1 if pass_number % 2 else -1)
        x, y, z = stops[stop].tolist()
        captured = StopStatus(
            setup=setup,
            pass_number=pass_number,
            stop=stop,
            position_mm=(x, y, z),
            u_um=0.3,
            reading_mm=float(np.linalg.norm(stops[stop] - stops[0])),
            deviation_um=float(deviation),
            place=stop if pass_number % 2 else len(stops) - 1 - stop,
        )
        kept = [one for one in self.fields["stops"] if one.setup == setup]
        after = min(stop + 1, len(stops) - 1)
        axis = AXES[int(np.argmax(np.abs(stops[after] - stops[stop])))]
        self.publish(
            phase="waiting-stop",
            expects_setup=setup,
            expects_pass=pass_number,
            expects_stop=after,
            moving_axis=axis,
            stops=(*kept, captured),
            reading_mm=captured.reading_mm,
            commanded_mm=(x, y, z),
            setups=self._progress(setup, pass_number, stop + 1),
            seconds_left=600.0 - 4 * stop,
            tilt_mrad=(0.31, -0.12) if stop > 8 else None,
            tilt_setup=setup,
            tilt_live=True,
        )

    def _progress(
        self, running: str, pass_number: int, stops_done: int
    ) -> tuple[SetupStatus, ...]:
        at = SETUPS.index(running)
        return tuple(
            _setup(name, "done", 62)
            if index < at
            else _setup(name, "running", 31 * (pass_number - 1) + stops_done)
            if index == at
            else _setup(name)
            for index, name in enumerate(SETUPS)
        )

    def complete(self) -> None:
        """Have the result and the report ready."""
        result = made_up_result()
        (self.place / "result.json").write_text(result.to_json(), encoding="utf-8")
        out = self.place / "exports" / "siemens"
        written = export(
            result, "siemens", None, step_mm=25.0, out_dir=out, today=date(2026, 1, 1)
        )
        correction = exported_of(written).correction
        told = conclusion_json(
            conclude(result, [Export(controller="siemens", untested=("EEC",), reach=REACH)]),
            field_of(result, correction),
        )
        (self.place / "conclusion.json").write_text(told, encoding="utf-8")
        (self.place / "report.html").write_text(
            build_report(result, source="result.json").html, encoding="utf-8"
        )
        findings = tuple(
            FindingStatus(code=one.code, severity=one.severity, text=one.text)
            for one in result.findings
        )
        setups = tuple(_setup(name, "done", 62) for name in SETUPS)
        self.publish(
            phase="complete",
            expects_setup="",
            setups=setups,
            result_ready=True,
            findings=findings,
        )


def _setup(name: str, state: Any = "to-do", stops_done: int = 0) -> SetupStatus:
    return SetupStatus(
        name=name,
        passes_wanted=2,
        passes_done=stops_done // 31,
        stops_wanted=62,
        stops_done=stops_done,
        state=state,
    )


def _beginning() -> dict[str, Any]:
    return {
        "survey": "spring 2026",
        "machine": "VM 500",
        "phase": "waiting-program",
        "expects_setup": "npp",
        "expects_stop": 0,
        "stops_in_pass": 31,
        "program": "O8002",
        "moving_axis": "",
        "reading_mm": 0.0,
        "reading_age_s": 0.01,
        "beam": 0.92,
        "beam_lost": False,
        "stopped": True,
        "stop_count": 4,
        "head": None,
        "air_temperature_c": 20.41,
        "air_pressure_hpa": 1002.3,
        "relative_humidity_percent": 44.0,
        "material_temperature_c": 20.87,
        "tilt_mrad": None,
        "setups": tuple(_setup(name) for name in SETUPS),
        "stops": (),
        "findings": (),
        "seconds_left": None,
        "origin_mm": VOLUME.origin_mm,
        "size_mm": VOLUME.size_mm,
        "increments": VOLUME.increments,
        "result_ready": False,
        "recording": True,
    }


class Served:
    """A page in its own process, kept by a loop in a thread of the test as the daemon keeps it."""

    def __init__(
        self, survey: PlayedSurvey, address: str, loop: asyncio.AbstractEventLoop
    ) -> None:
        self.survey = survey
        self.address = address
        self._loop = loop

    def do(self, act: Callable[[], Answer]) -> Answer:
        """Run something in the page's loop and return its answer."""

        async def run() -> Answer:
            return act()

        return asyncio.run_coroutine_threadsafe(run(), self._loop).result(60)

    def start(self, act: Callable[[], object]) -> None:
        """Have the page's loop run something without waiting for it."""
        self._loop.call_soon_threadsafe(act)

    def lateness(self, duration_s: float) -> list[float]:
        """Return by how many seconds the page's loop wakes too late, asked every 5 ms."""

        async def measure() -> list[float]:
            late, end = [], time.monotonic() + duration_s
            while (begun := time.monotonic()) < end:
                await asyncio.sleep(0.005)
                late.append(time.monotonic() - begun - 0.005)
            return late

        return asyncio.run_coroutine_threadsafe(measure(), self._loop).result(duration_s + 10)


@contextmanager
def served(
    folder: Path,
    *,
    port: int = 0,
    token: str = "",
    language: Language = "en",
    **settings: Any,
) -> Iterator[Served]:
    """Serve a played survey while the block runs."""
    ready: list[Served] = []
    started, failed = threading.Event(), []

    async def main(stop: asyncio.Event) -> None:
        survey = PlayedSurvey(folder)
        listeners = Listeners(page=open_listener("127.0.0.1", port, "page"))
        how = PageSettings(folder=str(folder), token=token, language=language, **settings)
        assert listeners.page is not None
        address = address_of(listeners.page)
        async with page_kept(survey, how, listeners):
            ready.append(Served(survey, address, asyncio.get_running_loop()))
            started.set()
            await stop.wait()

    def run() -> None:
        try:
            asyncio.run(_with_stop(main, stops))
        except BaseException as why:  # noqa: BLE001  # the test's own thread raises it again
            failed.append(why)
        finally:
            started.set()

    stops: list[tuple[asyncio.AbstractEventLoop, asyncio.Event]] = []
    thread = threading.Thread(target=run, name="served page")
    thread.start()
    started.wait(60)
    try:
        if failed:
            raise failed[0]
        yield ready[0]
    finally:
        if thread.is_alive():
            loop, stop = stops[0]
            loop.call_soon_threadsafe(stop.set)
        thread.join(60)
        assert not thread.is_alive()
        if failed:
            raise failed[0]


async def _with_stop(
    main: Any, stops: list[tuple[asyncio.AbstractEventLoop, asyncio.Event]]
) -> None:
    stop = asyncio.Event()
    stops.append((asyncio.get_running_loop(), stop))
    await main(stop)
