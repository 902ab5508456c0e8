"""The state of the daemon at a moment: an immutable snapshot, for the page, ``status`` and systemd.

`StatusSource` is the only interface between the daemon and its viewers.
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
"""State of a finding: it keeps its pass open, was accepted, or is past."""


class LinkStatus(msgspec.Struct, frozen=True, kw_only=True):
    """A link in words: ``age_s`` is the time since the last data of the link, None without data."""

    state: LinkState
    address: Words
    age_s: float | None
    detail: Words = ""


class AheadStatus(msgspec.Struct, frozen=True, kw_only=True):
    """The next pass and its gain, or the end of the survey, in words. ``setup`` is the next setup,
    empty at the end; ``further``: the setup is not in the plan yet, and the operator may add it.
    """

    words: Words = ""
    setup: str = ""
    further: bool = False

    def while_open(self, to_drive: Iterable["DriveStatus"]) -> "AheadStatus":
        """Return this advice; an empty one if its setup has been recorded meanwhile and the next
        advice is still being computed.
        """
        stands = (
            self.further or not self.setup or self.setup in {each.setup for each in to_drive}
        )
        return self if stands else AheadStatus()


class SetupStatus(msgspec.Struct, frozen=True, kw_only=True):
    """The progress of one setup."""

    name: str
    passes_wanted: int
    passes_done: int
    stops_wanted: int
    stops_done: int
    state: Literal["to-do", "running", "done", "again"]
    reason: Words = ""
    doubt: Words = ""
    """The doubtful stops of the setup that stay in use, with the reason."""


class DriveStatus(msgspec.Struct, frozen=True, kw_only=True):
    """A pass that must still be driven: its first stop (0: the whole pass), its number of stops,
    and its time in minutes with the setting up.

    ``again``: a driven pass with missing or doubted stops.
    """

    setup: str
    pass_number: int
    from_stop: int = 0
    stops: int
    again: bool = False
    minutes: float = 0.0


class StopStatus(msgspec.Struct, frozen=True, kw_only=True):
    """A captured stop. ``deviation_um`` is reading - nominal along the beam, corrected for air,
    dead path and the mirror's tilt.

    If one unbroken count joins the outward and the return pass of a setup, the deviations of both
    start at the first stop of the outward pass; otherwise the return pass is joined at the far end.
    The deviations of both passes have the same sign. ``place`` is the number of the stop on the
    outward pass.
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
    """A finding; ``place`` is its place (``ppp/1/5``: stop 5 of pass 1 of ppp; empty: none).

    ``state`` is ``open`` while the finding keeps its pass open, ``accepted`` where an operator
    accepted the finding (``word``: operator, time, reason), else ``past``.
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
        """Return the finding without its state."""
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
    """The newest second and a half of the laser at full rate: lowest and highest sample of every
    bin, None for a bin without samples.

    ``first`` is the number of the first bin since the daemon began, so that a reader can join
    strips and find missing bins.
    """

    first: int
    bin_s: float
    low_mm: tuple[float | None, ...]
    high_mm: tuple[float | None, ...]


Point = tuple[float, float, float]
"""X, Y, Z in mm."""


class WayStatus(msgspec.Struct, frozen=True, kw_only=True):
    """A body diagonal of the plan: its state and its two ends."""

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
    """The whole state of the daemon for the viewer. Ages are in seconds, so that they do not depend
    on a reader's clock.
    """

    sequence: int
    wall_time: str
    survey: str
    machine: str
    operator: str = ""
    workpiece: str = ""
    phase: Phase
    expects_setup: str
    """The setup that comes next or runs now; empty when all setups are complete."""
    expects_pass: int = 1
    """Number of the pass that comes next or runs now, from 1; even passes run back."""
    expects_stop: int
    stops_in_pass: int
    program: str = ""
    """The NC program of the expected setup, by its name at the control (``O8002``); empty where
    unknown.
    """
    moving_axis: str
    """The axis that moves to the stop awaited now: x, y, z, or empty."""
    reading_mm: float | None
    reading_age_s: float | None
    beam: float | None
    """Beam strength from 0 (none) to 1 (full); None if the instrument does not send it."""
    beam_lost: bool
    stopped: bool | None
    stop_count: int | None
    alarm: bool | None = None
    """The machine's alarm signal; None where it is not wired."""
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
    """Mirror tilt in mrad in the pass driven last, estimated from the first steps of this pass;
    None before three steps of each axis.
    """
    tilt_setup: str = ""
    tilt_live: bool = False
    """``tilt_setup`` is the setup of the mirror tilt. ``tilt_live``: whether a pass of this setup
    is being driven now; between setups the mirror is moved.
    """
    setups: tuple[SetupStatus, ...]
    stops: tuple[StopStatus, ...]
    """The stops of the running pass and of the pass before it in the same setup."""
    findings: tuple[FindingStatus, ...]
    seconds_left: float | None
    corrects: tuple[str, ...] = ()
    """The lines of the survey file changed since the daemon read the file: a person may request
    that the logs be read again with the changed file.
    """
    to_drive: tuple[DriveStatus, ...] = ()
    """The passes still to be driven, in order; ``seconds_left`` is the sum of their times."""
    origin_mm: tuple[float, float, float]
    size_mm: tuple[float, float, float]
    increments: int
    geometry: GeometryStatus | None = None
    counts_to: int | None = None
    """The last stop of the present pass with a valid count; None while the count is not lost."""
    driven_out: bool = False
    """Whether the machine has left the last stop of the pass, whose capture is about to end:
    interrupting the beam now does no harm.
    """
    strip: StripStatus | None = None
    result_ready: bool
    proof: Severity | None = None
    """The severity of the verdict of a proof run: ``info`` means that the tables stay, ``warning``
    that the proof run has not decided, ``error`` that the old tables must be restored. None for any
    other survey, and before the result.
    """
    recording: bool
    begins: bool = False
    """Whether the operator has to announce each setup: the machine has no signals."""
    ahead: AheadStatus = AheadStatus()
    """The advice on the next pass from the newest solution."""
    waits_in_vain: bool = False
    """Whether the machine waits too long for the handshake; ``message`` names the reason."""
    message: Words = ""


class Download(msgspec.Struct, frozen=True, kw_only=True):
    """A finished file that a person may download. ``name`` is unique, contains no ``/``, and stands
    on the page.

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
    """SHA-256 of the file; empty if only reading the file would give it."""
    group: str = ""


class StatusSource(Protocol):
    """The interface of the daemon for the page. Every method is called from the daemon's own event
    loop.
    """

    def snapshot(self) -> Snapshot:
        """Return the present state; cheap, called up to ten times a second for any number of
        viewers.
        """

    async def changed(self, sequence: int) -> None:
        """Return as soon as the snapshot's ``sequence`` differs from the given number; the call may
        be cancelled at any time.
        """

    def result_file(self) -> Path | None:
        """Return the path of result.json of the last completed survey; None without a completed
        survey.
        """

    def folder(self) -> Path:
        """Return the folder of the survey shown: the page offers only files of this folder."""

    def token_guessed(self, address: str, count: int) -> None:
        """Record the number of wrong tokens from an address."""

    async def command(self, name: CommandName, arguments: Mapping[str, str]) -> None:
        """Execute a request of a person with the token.

        ``choose-setup`` takes ``setup``; ``name`` takes ``operator`` and ``workpiece``; ``accept``
        takes ``place`` (of a doubt), ``reason`` and ``name``; ``take`` adds the further setup shown
        on the page to the survey; all other commands take no arguments. Raises UsageError, which
        names the required state, if the present state does not allow the command.
        """
