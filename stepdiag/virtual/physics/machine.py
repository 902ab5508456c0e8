"""The virtual machine without clocks and serial lines: from commanded positions to true poses and
lengths of laser paths."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from stepdiag.virtual.physics.environment import Environment
from stepdiag.virtual.physics.error_functions import Array, ErrorSet
from stepdiag.virtual.physics.growth import Growth
from stepdiag.virtual.physics.kinematics import Pose, Stand, split_chain, tool_pose
from stepdiag.virtual.physics.optics import Beam, Target
from stepdiag.virtual.physics.truth import Truth, truth


class Compensation(Protocol):
    """A compensation table that is active in the control."""

    def correction_mm(self, commanded_mm: Array, direction: Array) -> Array:
        """Return the control's corrections of the axis positions at commanded positions (N, 3),
        shape (N, 3)."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """Laser and target of a setup.

    ``zero_mm`` is the commanded position of the first stop. ``wavelength_nm`` is the vacuum
    wavelength by which the instrument counts. ``assumed_index`` is the refractive index by which
    the instrument divides its count: 1 without compensation, None if the instrument follows the air
    without error. The beam begins at the interferometer: the distance from there to the target at
    ``zero_mm`` is the dead path.
    """

    name: str
    beam: Beam
    target: Target
    zero_mm: Array
    stand: Stand = "table"
    wavelength_nm: float = 632.991
    assumed_index: float | None = None


@dataclass(slots=True, kw_only=True)
class Machine:
    """A machine tool: its chain, its errors, its thermal behaviour, and the tables loaded into its
    control.

    Errors refer to the point ``reference_mm`` (None: the low corner of the error set), at which the
    Abbe arms of all functions are zero. ``drift_um_h`` moves the tool relative to the work, like a
    growing spindle. ``expansion_um_m_c`` lengthens each axis by its material temperature above 20
    C. ``growth`` is the growth of the axes while the machine warms up.
    """

    errors: ErrorSet
    chain: str = "FXYZ"
    reference_mm: tuple[float, float, float] | None = None
    tool_offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    expansion_um_m_c: tuple[float, float, float] = (0.0, 0.0, 0.0)
    drift_um_h: tuple[float, float, float] = (0.0, 0.0, 0.0)
    growth: Growth | None = None
    environment: Environment = field(default_factory=Environment)
    compensations: Sequence[Compensation] = ()

    def __post_init__(self) -> None:
        split_chain(self.chain)

    @property
    def origin_mm(self) -> Array:
        return np.array(
            self.errors.low_mm if self.reference_mm is None else self.reference_mm,
            dtype=np.float64,
        )

    def pose(
        self,
        commanded_mm: Array,
        *,
        direction: Array | None = None,
        time_s: Array | float = 0.0,
        stand: Stand = "table",
    ) -> Pose:
        """Return the true tool frame at commanded positions (N, 3), in machine coordinates.

        ``direction`` is the sign of each axis' last movement, (3,) or (N, 3), zero (the default)
        for the mean of both directions; ``time_s`` is machine time, a number or shape (N,).
        """
        commanded = np.atleast_2d(np.asarray(commanded_mm, dtype=np.float64))
        signs = np.broadcast_to(
            np.zeros(3) if direction is None else direction, commanded.shape
        )
        times = np.broadcast_to(np.asarray(time_s, dtype=np.float64), len(commanded))
        driven = commanded + sum(
            (table.correction_mm(commanded, signs) for table in self.compensations),
            np.zeros(3),
        )
        displacement = [
            self._displacement_um(axis, driven[:, axis], signs[:, axis], times)
            for axis in range(3)
        ]
        rotation = [
            self.errors.rotation_urad(axis, driven[:, axis], signs[:, axis])
            for axis in range(3)
        ]
        frame = tool_pose(self.chain, driven - self.origin_mm, displacement, rotation, stand)
        tool = frame.moved(np.array(self.tool_offset_mm, dtype=np.float64))
        drift_mm = times[:, None] / 3600.0 * np.array(self.drift_um_h) * 1e-3
        return Pose(tool.origin_mm + self.origin_mm + drift_mm, tool.rotation)

    def _displacement_um(
        self, axis: int, position_mm: Array, direction: Array, time_s: Array
    ) -> Array:
        displacement = self.errors.displacement_um(axis, position_mm, direction)
        warmth_c = self.environment.material_c.at(time_s) - 20.0
        travelled_m = (position_mm - self.origin_mm[axis]) * 1e-3
        displacement[:, axis] += self.expansion_um_m_c[axis] * warmth_c * travelled_m
        if self.growth is not None:
            displacement[:, axis] += self.growth.displacement_um(
                axis, position_mm, self.growth.share(time_s)
            )
        return displacement

    def error_at(
        self,
        commanded_mm: Array,
        *,
        direction: Array | None = None,
        time_s: Array | float = 0.0,
    ) -> Array:
        """Return the true error of the tool relative to the work in um, actual minus commanded,
        shape (N, 3)."""
        commanded = np.atleast_2d(np.asarray(commanded_mm, dtype=np.float64))
        actual = self.pose(commanded, direction=direction, time_s=time_s).origin_mm
        error: Array = (actual - commanded - np.array(self.tool_offset_mm)) * 1e3
        return error

    def distance_mm(
        self,
        setup: Setup,
        commanded_mm: Array,
        *,
        direction: Array | None = None,
        time_s: Array | float = 0.0,
    ) -> Array:
        """Return the geometric distance from the beam's source to the target, shape (N,)."""
        return setup.target.distance_mm(
            self.pose(commanded_mm, direction=direction, time_s=time_s, stand=setup.stand),
            setup.beam,
        )

    def indicated_mm(
        self,
        setup: Setup,
        commanded_mm: Array,
        *,
        direction: Array | None = None,
        time_s: Array | float = 0.0,
    ) -> Array:
        """Return the length that the instrument obtains from the optical path, dead path included,
        before the count is set to zero, shape (N,)."""
        distance = self.distance_mm(setup, commanded_mm, direction=direction, time_s=time_s)
        if setup.assumed_index is None:
            return distance
        times = np.broadcast_to(np.asarray(time_s, dtype=np.float64), len(distance))
        indicated: Array = (
            distance
            * self.environment.index(times, setup.wavelength_nm)
            / setup.assumed_index
        )
        return indicated

    def truth(self, increments: int) -> Truth:
        """Return the machine's errors without compensation, at 20 C, at the nodes of every axis."""
        return truth(self.errors, increments)
