"""Recorded inputs of daq/capture give what they gave (tests/data/reference/README.md)."""

import pytest

from testkit.references import check, files
from testkit.references.daq_capture import CALLS


@pytest.mark.parametrize("path", files("daq_capture"), ids=lambda path: path.stem)
def test_a_recorded_input_gives_what_it_gave(path):
    check(path, CALLS)
