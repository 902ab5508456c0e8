"""What is said of the volume between the targets."""

import numpy as np
import pytest

from stepdiag.solver.methods.volumetric import coarse_findings
from stepdiag.solver.result.result import DISPLACEMENTS, Function

NODES = np.linspace(0.0, 500.0, 11)


@pytest.mark.parametrize(("waves", "named"), [(1, False), (2, False), (3, False), (4, True), (5, True), (6, True)])
def test_waves_that_ten_increments_cannot_carry_are_named(waves, named):
    """More than three and a half waves on ten increments: a table that is straight between the targets can make the machine worse."""
    value = 8.0 * np.sin(2.0 * np.pi * waves * NODES / 500.0 + 0.7)
    straight = Function(position_mm=NODES, value=np.zeros(11), u=np.full(11, 0.3), unit="um", u_readings=np.full(11, 0.3))
    errors = dict.fromkeys(DISPLACEMENTS, straight)
    errors["EXX"] = Function(position_mm=NODES, value=value - value[0], u=np.full(11, 0.3), unit="um", u_readings=np.full(11, 0.3))
    findings = coarse_findings(errors)
    assert bool(findings) is named
    assert all(finding.code == "increments-coarse" and finding.text.startswith("EXX:") for finding in findings)
