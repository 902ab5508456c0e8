"""What is tried again, and what is not: a test kit that forgave too much would prove nothing."""

import ctypes

import pytest

from testkit.running.steady import ATTEMPTS, SPARE_S, on_a_steady_computer


def stand_still():
    """Let no thread of this process run for 0.3 s: the call keeps the interpreter."""
    ctypes.PyDLL(None).usleep(300_000)


def test_a_failure_while_everything_stood_still_is_tried_again_in_another_folder(tmp_path):
    folders = []

    @on_a_steady_computer
    def passes_the_second_time(folder):
        folders.append(folder)
        stand_still()
        assert len(folders) == 2

    passes_the_second_time(tmp_path)
    assert len(set(folders)) == 2


@pytest.mark.parametrize(
    ("work", "spare_s", "attempts"),
    [(lambda: None, 60.0, 1), (stand_still, SPARE_S, ATTEMPTS)],
    ids=["it went on", "it stood still every time"],
)
def test_a_test_that_is_wrong_fails(tmp_path, monkeypatch, work, spare_s, attempts):
    monkeypatch.setattr("testkit.running.steady.SPARE_S", spare_s)  # a busy computer may stand still at this moment
    folders = []

    @on_a_steady_computer
    def wrong(folder):
        folders.append(folder)
        work()
        raise AssertionError("as it is")

    with pytest.raises(AssertionError, match="as it is"):
        wrong(tmp_path)
    assert len(folders) == attempts
