"""A file beside its hash: any flipped bit is named, and a copy under another name is still read."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from stepdiag.base.errors import DataError, StepdiagError, UsageError
from stepdiag.base.files import HASH_SUFFIX, read_text, write_hashed
from testkit.exact.results import made_result
from testkit.forgeries import flipped

TEXT = made_result({"EXX": [4.0, 1.0, 0.0, -2.0, -5.0]}).to_json()


@pytest.fixture
def result(tmp_path: Path) -> Path:
    write_hashed(tmp_path / "result.json", TEXT)
    return tmp_path / "result.json"


def test_the_hash_is_one_that_sha256sum_checks(result: Path) -> None:
    subprocess.run(
        ["sha256sum", "--check", "--strict", f"{result.name}{HASH_SUFFIX}"],
        cwd=result.parent,
        check=True,
        capture_output=True,
    )
    assert read_text(result) == TEXT


@pytest.mark.parametrize("suffix", ["", HASH_SUFFIX])
def test_every_flipped_bit_is_named_or_changes_no_figure(result: Path, suffix: str) -> None:
    rng, named, draws = np.random.default_rng(5), 0, 400
    for _ in range(draws):
        with flipped(Path(f"{result}{suffix}"), rng):
            try:
                assert read_text(result) == TEXT
            except StepdiagError:
                named += 1
    assert named == draws if not suffix else named > draws * 0.7, (
        "the name behind the hash is no part of it"
    )


def test_a_copy_without_the_hash_is_read_as_it_stands(result: Path) -> None:
    other = result.with_name("other.json")
    other.write_text(TEXT, encoding="utf-8")
    assert read_text(other) == TEXT


def test_another_result_is_not_written_over_it(result: Path) -> None:
    write_hashed(result, TEXT)
    with pytest.raises(UsageError):
        write_hashed(result, TEXT.replace("EXX", "EYY"))
    assert read_text(result) == TEXT


def test_the_refusal_names_both_hashes(result: Path) -> None:
    result.write_text(TEXT.replace("4.0", "4.5"), encoding="utf-8")
    with pytest.raises(DataError, match=r"SHA-256 [0-9a-f]{64}, found [0-9a-f]{64}"):
        read_text(result)
