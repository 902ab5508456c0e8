"""Surveys, exports and loadings one after the other on every control: no export that is written leaves the machine worse."""

from pathlib import Path

import pytest

from testkit.exact.loadings import Sequence

SEEDS = {"siemens": 133, "fanuc": 106, "heidenhain": 2, "beckhoff": 3, "linuxcnc": 116, "mitsubishi": 110, "fagor": 132}
"""Sequences that once went wrong: old tables taken as gone, products and sets of other functions, turns between two functions."""


@pytest.mark.parametrize("maker", SEEDS)
def test_no_sequence_makes_the_machine_worse(maker: str, tmp_path: Path) -> None:
    """The true machine before and after each loading, by a plant that shares no code with the exporter; hundreds of other seeds were run.

    What an export that ends with 0 says of the machine afterwards is what the machine does, `verify` agrees, and restore brings back
    what acted before. A refusal comes with its cause.
    """
    steps = list(Sequence(SEEDS[maker], maker, tmp_path).steps(2))
    assert any(step.code == 0 for step in steps)
    for step in steps:
        assert step.code in (0, 2, 3, 5)
        assert bool(step.refusal) == (step.code != 0)
        assert not step.worse, step
        assert not step.mispredicted, step
        assert step.judged == 0, step
        assert step.restored_um < 1.1, step
