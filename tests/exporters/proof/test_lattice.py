"""A lattice in a proof run: its curves and products are what the laser sees of it."""

import numpy as np

from stepdiag.base.volume import grid_points_mm
from stepdiag.exporters.proof.change import Way, columns
from stepdiag.exporters.safety.verdicts.lattice import parts_of
from stepdiag.exporters.tables.lattice import lattice_of
from stepdiag.exporters.tables.tables import mean_correction_um
from testkit.exact.results import VOLUME, made_result

ERRORS = {
    "EXX": [0.0, 5.0, 12.0, 9.0, 3.0],
    "EYX": [0.0, 3.0, 5.0, 3.0, 0.0],
    "EZY": [0.0, -2.0, -4.0, 1.0, 0.0],
}
ANGLES = {"ECX": [0.0, 10.0, -5.0, 20.0, 8.0]}


def test_the_parts_of_a_lattice_are_seen_as_the_lattice_itself() -> None:
    """Along a diagonal, origin and the slopes that a leaning mirror hides apart."""
    held = lattice_of(made_result(ERRORS, squareness={"C0Y": 20.0}, angles=ANGLES), 50.0)
    low, size = np.array(VOLUME.origin_mm), np.array(VOLUME.size_mm)
    counts = np.array([[(step + 2 - axis) // 3 for axis in range(3)] for step in range(13)])
    stops = low + counts * size / 4.0
    way = Way(setup="ppp", stops_mm=stops, along=size / np.linalg.norm(size), outward=True)
    parts = columns(parts_of(held.correction_um, held.axes_mm, VOLUME), [way])
    assert {"EXX", "EYX", "EZY", "EYX*Y"} & set(parts) >= {"EXX", "EYX", "EZY"}
    free = np.column_stack([np.ones(len(stops)), stops])
    off = sum(parts.values()) - held.correction_um(stops) @ way.along
    left = off - free @ np.linalg.lstsq(free, off, rcond=None)[0]
    assert np.max(np.abs(left)) < 0.5


def test_a_bilinear_movement_is_a_product_only_once() -> None:
    """The movement grows along both axes; the parts together move the tool by it, not by twice as
    much."""

    def moved_um(points_mm):
        x, y, _ = points_mm.T
        return np.stack([0.0 * x, 0.0 * x, x * y / 1e3], axis=1)

    x, y, z = (VOLUME.nodes_mm(axis) for axis in range(3))
    points = grid_points_mm(VOLUME, 5)
    left_um = mean_correction_um(parts_of(moved_um, (x, y, z), VOLUME), points) - moved_um(
        points
    )
    np.testing.assert_allclose(left_um, left_um[:1].repeat(len(points), axis=0), atol=1e-6)
