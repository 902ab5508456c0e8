"""Machines that stand exactly at their tolerance: how often the verdict accepts them."""

from dataclasses import replace

import numpy as np

from stepdiag.base.conformity import verdict_of
from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.base.result.posterior import Posterior
from stepdiag.base.result.prediction import predicted
from stepdiag.base.result.result import DISPLACEMENTS
from stepdiag.base.volume import rms
from testkit.exact.results import VOLUME, made_result


def posterior_of(modes: dict[str, np.ndarray]) -> Posterior:
    """Return a posterior of these modes alone."""
    at = {axis: VOLUME.nodes_mm(index) for index, axis in enumerate("XYZ")}
    return Posterior(position_mm=at, offset={}, modes=modes, rest={}, between_um={})


def volumes_at_their_limit(machines: int) -> tuple[float, float]:
    """Return the shares that are accepted and rejected of machines with a volumetric error (rms) of
    exactly the tolerance, each measured once, with a posterior of eight modes."""
    rng, tolerance, nodes = (
        np.random.default_rng(11),
        10.0,
        np.linspace(0, np.pi, VOLUME.increments + 1),
    )
    shapes = {
        name: np.array([np.sin((k + 1) * nodes) for k in range(2)]) for name in DISPLACEMENTS
    }
    mixed = {name: rng.normal(0, 0.45, (8, 2)) @ shape for name, shape in shapes.items()}
    axes = [
        VOLUME.nodes_mm(index)[[0, 1, 3]] for index in range(3)
    ]  # at targets: between them the curve through the values is bent
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    accepted = refused = 0
    for _ in range(machines):
        drawn = {name: rng.normal(0, 3.0, 2) @ shape for name, shape in shapes.items()}
        field = without_rigid_motion(
            VOLUME, points, error_field_um(made_result(drawn), points)
        )
        times = tolerance / (rms(field) * np.sqrt(3.0))
        z = rng.standard_normal(8)
        result = made_result(
            {name: times * value + z @ mixed[name] for name, value in drawn.items()}
        )
        known = replace(
            result, posterior=posterior_of(mixed), tolerance={"volumetric_rms_um": tolerance}
        )
        found = (
            predicted(known, points, np.zeros_like(points))
            .without_rigid_motion["before"]
            .rms_um
        )
        verdict = verdict_of(found.low_um, found.high_um, tolerance)
        assert found.within is not None
        assert found.within > 0.975 or verdict != "conform"
        accepted += verdict == "conform"
        refused += verdict == "not_conform"
    return accepted / machines, refused / machines
