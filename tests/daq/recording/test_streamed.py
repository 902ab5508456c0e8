"""A series of positions that another program recorded: the stops of the plan, the readings of the
exact machine, the same bytes again."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.errors import DataError
from stepdiag.base.readings.readings import parse_readings
from stepdiag.daq.recording.series import Series, parse_csv_series, parse_rtx
from stepdiag.virtual.drive.sequence import Box
from testkit.cli import stepdiag
from testkit.exact.surveys import Bench
from testkit.ordinary.measured import simulate_pass

SIZE_MM, N, DWELL_S, RATE_HZ = (300.0, 200.0, 100.0), 3, 1.5, 200.0
SETUPS = ("ppp", "npp", "pnp", "ppn", "linear-x", "linear-y", "linear-z")
SURVEY = f"""
[survey]
name = "stream"
machine = "virtual"
[volume]
size_mm = {list(SIZE_MM)}
increments = {N}
[machine]
compensation = "off"
[plan]
setups = {list(SETUPS)}
return_pass = true
dwell_s = {DWELL_S}
[laser]
format = "line"
port = "none"
compensated = true
[laser.line]
pattern = '(?P<counter>[0-9]+) (?P<position>-?[0-9.]+)'
counter_modulus = 1000000000
rate_hz = {RATE_HZ}
[plc]
transport = "none"
[environment]
source = "fixed"
[stop]
settle_s = 0.2
min_window_s = 0.3
"""


def passes_of(setup, seed=3):
    """Return the exact readings of a setup, out and back on one count, by pass."""
    bench = Bench(seed=seed, size_mm=SIZE_MM, increments=N)
    box = Box(origin_mm=bench.origin_mm, size_mm=SIZE_MM, increments=N)
    both = [simulate_pass(bench.machine, box, setup, number) for number in (1, 2)]
    return [one.reading_mm + (one.first_mm - both[0].first_mm) for one in both]


def series_of(levels_mm, rate_hz, *, noise_um=0.1, seed=1):
    """Return positions: dwells of 1.5 s, moves of 0.8 s between them, before and after the passes
    the machine stands beyond their ends."""
    rng, parts, here = np.random.default_rng(seed), [], 0.0
    for level in levels_mm:
        move = 0.5 - 0.5 * np.cos(np.linspace(0, np.pi, int(0.8 * rate_hz)))
        parts += [here + (level - here) * move, np.full(int(DWELL_S * rate_hz), level)]
        here = level
    position = np.concatenate(
        [np.full(int(rate_hz), 0.0), *parts, np.full(int(rate_hz), here)]
    )
    return position + rng.normal(0, noise_um * 1e-3, len(position))


def rtx(position, rate_hz):
    """Return a file as the public reader of the format reads it."""
    header = "HEADER::\r\nFile Type: Dynamic\r\nOwner: CARTO-Dynamic\r\nVelocity: 0\r\n"
    header += f"Sample rate: {rate_hz}\r\nActual sample rate: {rate_hz}\r\n"
    header += "Flags: 0 1 2 0 2\r\nData:\r\n"
    return header.encode() + struct.pack(f"<{len(position)}d", *position) + b"EOF::\r\n"


def levels(setup):
    """Return the levels at which the machine stands: beyond the first stop, the stops out, beyond
    the last, the stops back, beyond."""
    out, back = passes_of(setup)
    return [-2.0, *out, out[-1] + 2.0, *back, back[-1] - 2.0]


@pytest.fixture(scope="module")
def streamed(tmp_path_factory):
    """A whole survey of seven series, the first two as .rtx in metres at 2 kHz, the others as
    CSV."""
    folder = tmp_path_factory.mktemp("streamed")
    survey = folder / "survey.toml"
    survey.write_text(SURVEY, encoding="utf-8")
    for index, setup in enumerate(SETUPS):
        if index < 2:
            position = series_of(levels(setup), 2000.0, seed=index)
            file = folder / f"{setup}.rtx"
            file.write_bytes(rtx(position * 1e-3, 2000.0))
            unit = "m"
        else:
            position = series_of(levels(setup), RATE_HZ, seed=index)
            file = folder / f"{setup}.csv"
            rows = "".join(
                f"{count / RATE_HZ:.6f},{value * 1e3:.4f}\n"
                for count, value in enumerate(position)
            )
            file.write_text("time_s,position\n" + rows, encoding="utf-8")
            unit = "um"
        code, out, refusal = stepdiag(
            "stream",
            survey,
            setup,
            file,
            "--unit",
            unit,
            "--began",
            f"2026-10-05T{8 + index:02d}:00:00",
        )
        assert code == 0, refusal or out
    return folder


def test_every_stop_of_the_survey_is_the_exact_machines(streamed, tmp_path):
    (logs,) = (
        (streamed / "surveys").rglob("0001")
        if (streamed / "surveys").exists()
        else [next(streamed.rglob("0001"))]
    )
    code, out, refusal = stepdiag("solve", logs, "--out", tmp_path / "result.json")
    assert code in (0, 3), refusal or out
    code, out, refusal = stepdiag("replay", logs, "--out", tmp_path / "again")
    assert code in (0, 3), refusal or out
    readings = parse_readings(
        (tmp_path / "again" / "readings.csv").read_text(encoding="utf-8"), "readings.csv"
    )
    assert len(readings) == 2 * (4 * (3 * N + 1) + 3 * (N + 1))
    for key, rows in readings.passes().items():
        exact = passes_of(key.setup)[key.number - 1]
        off = readings.reading_mm[rows] - exact
        assert np.abs(off - off[0]).max() < 1e-4, (
            key
        )  # 0.1 um of noise over 200 samples and more


def test_a_series_of_another_setup_is_refused_and_places_no_stop(tmp_path):
    survey = tmp_path / "survey.toml"
    survey.write_text(SURVEY, encoding="utf-8")
    (tmp_path / "a.rtx").write_bytes(
        rtx(series_of(levels("linear-x"), RATE_HZ) * 1e3, RATE_HZ)
    )
    code, _, refusal = stepdiag(
        "stream", survey, "linear-y", tmp_path / "a.rtx", "--unit", "um"
    )
    assert code == 3
    assert "linear-y" in refusal


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ('transport = "none"', 'transport = "tcp"', "plc.transport"),
        ("(?P<position>-?[0-9.]+)", "x(?P<position>.+)", "laser.line.pattern"),
    ],
)
def test_a_survey_of_another_laser_is_refused_with_what_to_write(
    tmp_path, before, after, words
):
    survey = tmp_path / "survey.toml"
    survey.write_text(SURVEY.replace(before, after), encoding="utf-8")
    (tmp_path / "a.rtx").write_bytes(rtx(np.zeros(10), RATE_HZ))
    code, _, refusal = stepdiag("stream", survey, "ppp", tmp_path / "a.rtx", "--unit", "mm")
    assert code == 2
    assert words in refusal
    assert "[laser.line]" in refusal


@given(
    st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=50),
    st.sampled_from([10.0, 1000.0, 50000.0]),
)
def test_an_rtx_file_gives_its_numbers_back(position, rate_hz):
    found = parse_rtx(rtx(position, rate_hz), "um", "a.rtx")
    assert found.rate_hz == rate_hz
    assert found.position_mm == pytest.approx(np.array(position) * 1e-3)


@pytest.mark.parametrize("cut", [0, 5, 60, 140, -9, -20])
def test_a_cut_rtx_file_is_refused(cut):
    with pytest.raises(DataError):
        parse_rtx(rtx(np.arange(40.0), 1000.0)[:cut], "mm", "a.rtx")


@pytest.mark.parametrize(
    "rows",
    ["0,1\n0.1,2\n0.3,3\n0.4,3\n", "0,1\n0,2\n", "0.2,1\n0.1,2\n", "0,1\n0.1,x\n", "0,1\n"],
)
def test_a_csv_series_with_a_gap_or_without_numbers_is_refused(rows):
    with pytest.raises(DataError):
        parse_csv_series("time_s,position\n" + rows, "mm", "a.csv")


def test_blocks_keep_the_mean():
    fine = Series(np.arange(1000.0), 50_000.0)
    coarse = fine.at_rate(1000.0)
    assert (coarse.rate_hz, len(coarse.position_mm)) == (1000.0, 20)
    assert coarse.position_mm[0] == pytest.approx(24.5)
