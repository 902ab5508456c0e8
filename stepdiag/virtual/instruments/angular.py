"""Instruments for angles and their bytes: an autocollimator in front of a mirror on the tool, and a
level on the tool."""

from collections.abc import Callable

import numpy as np

from stepdiag.virtual.base.clock import Clock
from stepdiag.virtual.drive.player import Drive, Player
from stepdiag.virtual.instruments.counting import Counting
from stepdiag.virtual.instruments.readout import track
from stepdiag.virtual.physics.error_functions import Array
from stepdiag.virtual.physics.kinematics import Stand
from stepdiag.virtual.physics.machine import Machine

ARCSEC_RAD = np.pi / 180.0 / 3600.0
Look = Callable[[Array], Array]
"""A function from wall times (N,) to rotations of the tool about X, Y, Z in arc-seconds and the
number of the moving axis, (N, 4); NaN outside the instrument's own runs."""
ACROSS = {0: (2, 1), 1: (2, 0), 2: (0, 1)}
"""By axis: the two rotations that an autocollimator along this axis measures. The rotation about
the vertical direction of the instrument comes first."""
LEVEL = {0: 0, 1: 1, 2: 0}
"""By axis: the rotation that a level across this axis measures."""


class AngleView:
    """The rotation of the tool with its mirror or level during the runs of the instrument."""

    def __init__(
        self,
        machine: Machine,
        player: Player,
        drive: Drive,
        *,
        clock: Clock,
        stand: Stand,
        seed: int,
    ) -> None:
        self._machine = machine
        self._player = player
        self._drive = drive
        self._clock = clock
        self._stand: Stand = stand
        self._rng = np.random.default_rng(seed)

    def look(self, wall_s: Array) -> Array:
        """Return rotations and number of the moving axis at ascending wall times, shape (N, 4)."""
        machine_s = wall_s * self._clock.scale
        followed = track(self._player, self._drive, machine_s)
        seen = np.full((len(wall_s), 4), np.nan)
        names = np.array(followed.setup)
        for setup in set(followed.setup):
            here = names == setup
            if setup.startswith("fourdof"):
                pose = self._machine.pose(
                    followed.position_mm[here],
                    direction=followed.approach[here],
                    time_s=machine_s[here],
                    stand=self._stand,
                )
                turned = pose.rotation
                vector = np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], axis=1)
                noise = self._rng.normal(scale=0.02, size=vector.shape)
                seen[here, :3] = vector / ARCSEC_RAD + noise + [11.0, -7.0, 3.0]
                seen[here, 3] = "xyz".index(setup[-1])
        return seen


class Autocollimator(Counting):
    """An Elcomat: silent until it receives `A`, then 25 lines per second
    (`stepdiag.virtual.instruments.talker.Talking`, `Responding`)."""

    def __init__(self, look: Look) -> None:
        super().__init__()
        self.rate_hz = 25.0
        self._look = look
        self._streams = False

    def respond(self, received: bytes) -> bytes:
        for letter in received:
            self._streams = {ord("A"): True, ord("s"): False}.get(letter, self._streams)
        return b""

    def speak(self, wall_s: Array) -> bytes:
        """Return a line per sample; without a mirror, the status of a line contains no valid
        axis."""
        return b"".join(map(self._line, self._look(wall_s))) if self._streams else b""

    def _line(self, seen: Array) -> bytes:
        if np.isnan(seen[3]):
            return b"3 000 0.000 0.000\r"
        first, second = ACROSS[int(seen[3])]
        return f"3 003 {seen[first]:.3f} {seen[second]:.3f}\r".encode("ascii")


class Level:
    """A level that answers `P` (`stepdiag.virtual.instruments.talker.Answering`)."""

    def __init__(self, look: Look) -> None:
        self._look = look

    def requests(self, received: bytes) -> list[bytes]:
        return [b"P"] * received.count(b"P")

    def answer(self, request: bytes, wall_s: float) -> bytes:  # noqa: ARG002 - it knows one
        """Return the answer to a request: name, angle, name, temperature."""
        seen = self._look(np.array([wall_s]))[0]
        angle = 0.0 if np.isnan(seen[3]) else seen[LEVEL[int(seen[3])]]
        return f"1 {angle:+.3f} 2 {20.5:+.2f}\r".encode("ascii")

    def watch(self, wall_s: float) -> None:
        """Do nothing: an unrequested measurement has no effect."""
