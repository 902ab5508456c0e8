"""What a 4-DOF head says of an exact machine's straightness."""

import numpy as np

from stepdiag.base.names import AXES
from stepdiag.solver.model.lateral import MeasuredStraightness

STRAIGHT = ("EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ")


def straightness(bench, seed, u_um=0.5, approaches=(1, -1)):
    """What a head on the machine's table sees at the tool, with a line of its own in every pass
    (theory 2.2: exact kinematics)."""
    rng = np.random.default_rng(seed)
    machine, measured = bench.machine, []
    nodes = bench.increments + 1
    for name in STRAIGHT:
        axis, component = AXES.index(name[2].lower()), AXES.index(name[1].lower())
        points = np.tile(np.array(bench.origin_mm), (nodes, 1))
        points[:, axis] += np.linspace(0.0, bench.size_mm[axis], nodes)
        true = machine.error_at(points)[:, component]
        for approach in approaches:
            line = rng.normal(0.0, 20.0) + rng.normal(0.0, 20.0) * np.linspace(
                0.0, 1.0, nodes
            )
            value = true + line + rng.normal(0.0, u_um, nodes)
            measured.append(
                MeasuredStraightness(
                    name=name,
                    position_mm=points[:, axis],
                    value_um=value,
                    u_um=np.full(nodes, u_um),
                    approach=approach,
                )
            )
    return measured
