"""What a replay says of the files of a live run."""

import hashlib

from stepdiag.daemon.replay import _verdict
from stepdiag.solver.methods.solve import solve
from testkit.exact.surveys import DIAGONALS, Bench


def written(folder, data, name="result.json"):
    (folder / name).write_bytes(data)
    return folder / name


def test_another_processors_last_digit_is_told_from_another_result(tmp_path):
    """`0.28991` beside `0.289911` came of the kernels of an old processor; 0.01 um is another
    result."""
    result = solve(Bench(seed=4, increments=3).survey(DIAGONALS)).to_json()
    first = result.split('"value": [', 1)[1].split(",", 1)[0]
    live = written(tmp_path, result.encode())

    def moved(by):
        return result.replace(
            f'"value": [{first},', f'"value": [{float(first) + by:.6f},', 1
        ).encode()

    assert _verdict(live, result.encode(), rounded=False) == "identical"
    assert _verdict(live, moved(1e-6), rounded=False) == "rounded"
    assert _verdict(live, moved(0.01), rounded=False) == "different"
    assert (
        _verdict(written(tmp_path, b"no JSON"), result.encode(), rounded=False) == "different"
    )
    assert _verdict(tmp_path / "none", b"", rounded=False) == "missing"


def test_hashes_tables_and_last_digits_may_follow_a_rounded_result_and_nothing_else_may(
    tmp_path,
):
    hashes = [hashlib.sha256(data).hexdigest().encode() for data in (b"one", b"other")]
    live = written(
        tmp_path,
        b"result: sha256 " + hashes[0] + b", 0.19 um, base64,MC4xOQ==, 3 axes\n",
        "REPORT.txt",
    )
    again = b"result: sha256 " + hashes[1] + b", 0.2 um, base64,MC4yMA==, 3 axes\n"
    assert _verdict(live, again, rounded=True) == "rounded"
    assert _verdict(live, again, rounded=False) == "different"
    for other in (b", 0.21 um", b", -0.2 um", b", 0.2 mm"):
        assert _verdict(live, again.replace(b", 0.2 um", other), rounded=True) == "different"
    assert _verdict(live, again.replace(b"3 axes", b"4 axes"), rounded=True) == "different"


def test_readings_are_the_same_on_every_processor(tmp_path):
    live = written(tmp_path, b"0.1234567\n", "readings.csv")
    assert _verdict(live, b"0.1234568\n", rounded=True) == "different"
