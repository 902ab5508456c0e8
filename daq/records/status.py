"""The state of the daemon at a moment, as immutable values, for the page, ``status`` and
systemd.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Literal, Protocol

import msgspec

from stepdiag.base.findings import NOWHERE, Finding, Severity
from stepdiag.base.messages import Message, Place, Words

Phase = Literal[
    "starting",
    "waiting-program",
    "waiting-stop",
    "dwelling",
    "paused",
    "solving",
    "complete",
    "failed",
]
LinkState = Literal["connecting", "connected", "silent", "lost"]
CommandName = Literal[
    "start",
    "pause",
    "abort-setup",
    "choose-setup",
    "zero",
    "name",
    "accept",
    "certificate",
    "take",
    "correct",
]


State = Literal["open", "accepted", "past"]
"""State of a finding: ``open`` keeps the pass of the finding open."""


class LinkStatus(msgspec.Struct, frozen=True, kw_only=True):
    """A link in words. ``age_s`` is the time in s since the last data of the link, None without
    data.
    """

    state: LinkState
    address: Words
    age_s: float | None
    detail: Words = ""


class AheadStatus(msgspec.Struct, frozen=True, kw_only=True):
    """The advice on the next pass and its gain, or on the end of the survey, in words. ``setup`` is
    the next setup, empty at the end of the survey. ``further`` means that the setup is not in the
    plan yet and that the operator may add the setup.
    """

    words: Words = ""
    setup: str = ""
    further: bool = False

    def while_open(self, to_drive: Iterable["DriveStatus"]) -> "AheadStatus":
        """Return the advice unchanged, or an empty advice if the advised setup is recorded already
        and the next advice is still being computed.
        """
        stands = (
            self.further or not self.setup or self.setup in {each.setup for each in to_drive}
        )
        return self if stands else AheadStatus()


class SetupStatus(msgspec.Struct, frozen=True, kw_only=True):
    name: str
    passes_wanted: int
    passes_done: int
    stops_wanted: int
    stops_done: int
    state: Literal["to-do", "running", "done", "again"]
    reason: Words = ""
    doubt: Words = ""
    """The doubtful stops of the setup whose readings are used, with the reason."""


class DriveStatus(msgspec.Struct, frozen=True, kw_only=True):
    """A pass to drive: its first stop (0: the whole pass), its number of stops, and its time in
    minutes. The time of the first pass of a future setup includes the setting up.

    ``again`` marks a driven pass with missing or doubted stops.
    """

    setup: str
    pass_number: int
    from_stop: int = 0
    stops: int
    again: bool = False
    minutes: float = 0.0


class StopStatus(msgspec.Struct, frozen=True, kw_only=True):
    """A captured stop. ``deviation_um`` is reading minus nominal along the beam, corrected for air,
    dead path and mirror tilt.

    If one unbroken count connects the outward and the return pass of a setup, the deviations of
    both passes start at the first stop of the outward pass; otherwise both passes have equal
    deviations at the far end. The deviations of both passes have the same sign. ``place`` is the
    number of the stop on the outward pass.
    """

    setup: str
    pass_number: int
    stop: int
    position_mm: tuple[float, float, float]
    reading_mm: float
    deviation_um: float
    u_um: float
    doubtful: Words = ""
    place: int = 0


class FindingStatus(msgspec.Struct, frozen=True, kw_only=True):
    """A finding; ``place`` is its place (``ppp/1/5``: stop 5 of pass 1 of ppp), or empty.

    ``state`` is ``open`` for a finding that keeps its pass open, ``accepted`` for a finding that an
    operator accepted (``word``: operator, time, reason), and ``past`` for any other.
    """

    code: str
    severity: Severity
    text: str
    message: Message | None = None
    at: Place = NOWHERE
    place: str = ""
    state: State = "past"
    word: str = ""

    @property
    def finding(self) -> Finding:
        at = self.at
        place = {
            "setup": at.setup,
            "way": at.way,
            "pass_number": at.pass_number,
            "stop": at.stop,
            "last": at.last,
        }
        return Finding(
            code=self.code,
            severity=self.severity,
            text=self.text,
            message=self.message,
            **place,  # type: ignore[arg-type]
        )


class StripStatus(msgspec.Struct, frozen=True, kw_only=True):
    """The newest 1.5 s of the laser at full rate: lowest and highest sample of every bin, None for
    a bin without samples.

    ``first`` is the number of the first bin since the start of the daemon, so that a reader can
    join strips and find missing bins.
    """

    first: int
    bin_s: float
    low_mm: tuple[float | None, ...]
    high_mm: tuple[float | None, ...]


Point = tuple[float, float, float]
"""X, Y, Z in mm."""


class WayStatus(msgspec.Struct, frozen=True, kw_only=True):
    setup: str
    state: str
    ends_mm: tuple[Point, Point]


class GeometryStatus(msgspec.Struct, frozen=True, kw_only=True):
    """The drawing of a survey: edges of the volume (first the edges at the origin), axis names and
    places, diagonals, route of the pass.
    """

    edges_mm: tuple[tuple[Point, Point], ...]
    axes: tuple[tuple[str, Point], ...]
    ways: tuple[WayStatus, ...]
    route_mm: tuple[Point, ...]


class Snapshot(msgspec.Struct, frozen=True, kw_only=True):
    """The whole state of the daemon. Ages are in seconds, so that an age does not depend on the
    clock of a reader.
    """

    sequence: int
    wall_time: str
    survey: str
    machine: str
    operator: str = ""
    workpiece: str = ""
    phase: Phase
    expects_setup: str
    """The setup of the next or running pass; empty when all setups are complete."""
    expects_pass: int = 1
    """Number of the next or running pass, from 1; even passes run back."""
    expects_stop: int
    stops_in_pass: int
    program: str = ""
    """The name of the NC program of the expected setup at the control (``O8002``); empty if
    unknown.
    """
    moving_axis: str
    """The axis that moves to the next stop: x, y, z, or empty."""
    reading_mm: float | None
    reading_age_s: float | None
    beam: float | None
    """Beam strength from 0 (none) to 1 (full); None if the instrument does not send the
    strength.
    """
    beam_lost: bool
    stopped: bool | None
    stop_count: int | None
    alarm: bool | None = None
    """The machine's alarm signal; None without this signal."""
    commanded_mm: tuple[float, float, float] | None = None
    laser: LinkStatus
    plc: LinkStatus
    head: LinkStatus | None
    """The link of the 4-DOF head; None without a configured head."""
    air: LinkStatus | None = None
    """The link of the sensor of air and material; None without a configured sensor."""
    air_temperature_c: float | None
    air_pressure_hpa: float | None
    relative_humidity_percent: float | None
    material_temperature_c: float | None
    tilt_mrad: tuple[float, float] | None
    """Mirror tilt in mrad in the last driven pass, estimated from its first steps; None before
    three steps of each axis.
    """
    tilt_setup: str = ""
    tilt_live: bool = False
    """``tilt_setup`` is the setup of the mirror tilt. ``tilt_live`` is True while a pass of this
    setup is driven; between setups the mirror is moved.
    """
    setups: tuple[SetupStatus, ...]
    stops: tuple[StopStatus, ...]
    """The stops of the running pass and of the previous pass of the same setup."""
    findings: tuple[FindingStatus, ...]
    seconds_left: float | None
    corrects: tuple[str, ...] = ()
    """The changed lines of the survey file since the daemon read the file. A person may request
    that the logs be read again with the changed file.
    """
    to_drive: tuple[DriveStatus, ...] = ()
    """The passes to drive, in order; ``seconds_left`` is the sum of their times."""
    origin_mm: tuple[float, float, float]
    size_mm: tuple[float, float, float]
    increments: int
    geometry: GeometryStatus | None = None
    counts_to: int | None = None
    """The last stop of the present pass with a valid count; None while the count is valid."""
    driven_out: bool = False
    """Whether the machine has left the last stop of the pass: interrupting the beam is then
    harmless.
    """
    strip: StripStatus | None = None
    result_ready: bool
    proof: Severity | None = None
    """The severity of the verdict of a proof run: ``info``: the tables remain loaded; ``warning``:
    the proof run is undecided; ``error``: the old tables must be restored. None for any other
    survey, and before the result.
    """
    recording: bool
    begins: bool = False
    """Whether the operator announces each setup, because the machine has no signals."""
    ahead: AheadStatus = AheadStatus()
    """The advice on the next pass from the newest solution."""
    waits_in_vain: bool = False
    """Whether the machine waits too long for the handshake; ``message`` contains the reason."""
    message: Words = ""


class Download(msgspec.Struct, frozen=True, kw_only=True):
    """A finished file for download. ``name`` is unique, contains no ``/``, and is shown on the
    page.

    ``bundle`` and ``restore`` are the folder of an export, packed on download; ``group`` is the
    control of the export.
    """

    name: str
    path: Path
    kind: Literal[
        "report", "certificate", "result", "export", "log", "figure", "bundle", "restore"
    ]
    size_bytes: int
    sha256: str = ""
    """SHA-256 of the file; empty if the program would have to read the file to compute the
    value.
    """
    group: str = ""


class StatusSource(Protocol):
    """The interface between the daemon and its viewers. Every method is called from the daemon's
    event loop.
    """

    def snapshot(self) -> Snapshot:
        """Return the present state. The call is cheap, and made up to ten times a second for any
        number of viewers.
        """

    async def changed(self, sequence: int) -> None:
        """Return as soon as the snapshot's ``sequence`` differs from the given number. The call may
        be cancelled.
        """

    def result_file(self) -> Path | None:
        """Return the path of result.json of the last completed survey; None without a completed
        survey.
        """

    def folder(self) -> Path:
        """Return the folder of the survey; the page offers only files of this folder."""

    def token_guessed(self, address: str, count: int) -> None:
        """Record the number of wrong tokens from an address."""

    async def command(self, name: CommandName, arguments: Mapping[str, str]) -> None:
        """Execute a command of a person with the token.

        ``choose-setup`` takes ``setup``; ``name`` takes ``operator`` and ``workpiece``; ``accept``
        takes ``place`` (of a doubt), ``reason`` and ``name``. ``take`` adds the further setup on
        the page to the survey. The other commands take no arguments. Raises UsageError with the
        required state if the present state does not allow the command.
        """
