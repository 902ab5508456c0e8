"""The reader that runs beside READ_BACK.ngc in LinuxCNC takes stops for what they are; the running
control is in `tests/system/control`."""

import importlib.util
from importlib.resources import files as resources

import pytest

from stepdiag.exporters.linuxcnc.read_back import NAMES, read_back_files
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.tables.fit import fitted
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME, made_result


def loaded():
    path = resources("stepdiag.exporters.linuxcnc").joinpath(NAMES[1])
    spec = importlib.util.spec_from_file_location("stepdiag_back", str(path))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def driven(reader, stops, *, stay_s: float = 0.5) -> None:
    """Show the reader an axis that passes from stop to stop, with what is added at each: by
    position and way."""
    now, at = 0.0, 0.0
    for to in stops:
        way = 1 if to > at else -1
        for share in (0.3, 0.7):
            reader.see(now := now + 0.05, {0: at + share * (to - at)}, {0: 99.0})
        begun = now
        while now - begun <= stay_s:
            reader.see(now := now + 0.05, {0: to}, {0: 1e-3 * to + 1e-4 * way})
        at = to


def test_a_row_is_read_from_both_sides() -> None:
    reader = loaded().Reader({0: [-10.0, 0.0, 10.0]})
    driven(reader, [-11.0, -10.0, 0.0, 10.0, 11.0, 10.0, 0.0, -10.0])
    assert reader.missing == []
    assert list(reader.lines(0)) == [
        "-10.000000 -9.990100 -9.989900",
        "0.000000 -0.000100 0.000100",
        "10.000000 9.989900 9.990100",
    ]


def test_what_was_not_driven_is_missing() -> None:
    reader = loaded().Reader({0: [-10.0, 0.0, 10.0]})
    driven(reader, [-11.0, -10.0, 0.0, 10.0])
    assert reader.missing == [(0, -10.0, -1), (0, 0.0, -1), (0, 10.0, -1)]


def test_a_stop_too_short_or_beside_a_row_is_no_stop() -> None:
    reader = loaded().Reader({0: [0.0]})
    driven(reader, [-1.0, 0.0, 1.0, 0.0], stay_s=0.1)
    driven(reader, [-1.0, 0.01, 1.0, 0.01])
    assert len(reader.missing) == 2


@pytest.mark.parametrize(
    ("unit_mm", "word", "first"),
    [(1.0, "G21", "G1 X-201.000000"), (25.4, "G20", "G1 X-8.874016")],
)
def test_the_program_stops_beyond_both_ends_in_the_unit_of_the_machine(
    unit_mm: float, word: str, first: str
) -> None:
    profile = profile_of("linuxcnc", VOLUME)
    tables = (
        controller_named("linuxcnc")
        .plan(fitted(made_result({"EXX": [0.0, 1.0, 5.0, 3.0, 2.0]})).curves, profile)
        .tables
    )
    program, *_ = read_back_files([table for table in tables if table.name == "EXX"], unit_mm)
    lines = program.data.decode("ascii").splitlines()
    assert lines[1] == word
    assert next(line for line in lines if line.startswith("G1 ")) == first
    assert sum(line.startswith("G1 ") for line in lines) == 2 * 5 + 2
    assert read_back_files([], 1.0) == ()
