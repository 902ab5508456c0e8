"""Writers that are killed, overtaken, or meet a full disk: all files or none, and nothing that
piles up."""

import errno
import os
import signal
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.disk.part import part_of
from stepdiag.base.errors import UsageError
from stepdiag.base.files import (
    refuse_file_name,
    write_atomically,
    write_new,
    write_once,
    write_together,
)
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.sets import write_set
from stepdiag.fleet.store import Store
from testkit.examples import few

WRITERS: dict[str, Callable[[Path], object]] = {
    "write_atomically": lambda path: write_atomically(path, b"new"),
    "write_once": lambda path: write_once(path, "new"),
    "write_new": lambda path: write_new(path, "new"),
    "write_together": lambda path: write_together(
        {path: b"new", path.with_name("other"): b"new"}, over=False
    ),
    "write_set": lambda path: write_set(
        path, [ControlFile(name="a.ini", data=b"new"), ControlFile(name="b.ini", data=b"new")]
    ),
    "store": lambda path: Store(str(path.parent), create=True).write(path.name, b"new"),
}


def everything(folder: Path) -> dict[str, bytes | None]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


def killed(work: Callable[[], object], at: int) -> None:
    """Do something in a process of its own that dies when it syncs for the ``at``-th time."""
    child = os.fork()
    if child == 0:
        steps = iter(range(100))
        os.fsync = lambda _: (
            os.kill(os.getpid(), signal.SIGKILL) if next(steps) == at else None
        )
        work()
        os._exit(0)
    os.waitpid(child, 0)


@pytest.mark.parametrize("name", WRITERS)
def test_what_killed_writers_leave_is_gone_after_the_next(tmp_path: Path, name: str) -> None:
    write, target = WRITERS[name], tmp_path / "target.out"
    Store(str(tmp_path), create=True)
    for at in (0, 0, 1):
        killed(lambda: write(target), at)
    target.is_dir() or target.unlink(missing_ok=True)
    write(target)
    assert [found for found in everything(tmp_path) if ".part" in found] == []


@few(60)
@given(
    old=st.dictionaries(st.sampled_from(["a", "b", "in/c"]), st.binary(max_size=3)),
    new=st.dictionaries(
        st.sampled_from(["a", "b", "in/c", "deep/er/d"]), st.binary(max_size=3), min_size=1
    ),
    over=st.booleans(),
    step=st.sampled_from(
        ["os.fsync", "pathlib.Path.replace", "pathlib.Path.hardlink_to", "pathlib.Path.mkdir"]
    ),
    at=st.integers(0, 6),
)
def test_files_that_belong_together_are_all_there_or_none(
    tmp_path_factory: pytest.TempPathFactory,
    old: dict[str, bytes],
    new: dict[str, bytes],
    step: str,
    at: int,
    *,
    over: bool,
) -> None:
    """Whichever step the disk refuses: the folder is as it was, or all files are there."""
    folder = tmp_path_factory.mktemp("place")
    for name, data in old.items():
        write_atomically(folder / name, data)
    before = everything(folder)
    wanted = {folder / name: data for name, data in new.items()}
    with pytest.MonkeyPatch.context() as patch:
        module, _, attribute = step.rpartition(".")
        usual, steps = getattr(os if module == "os" else Path, attribute), iter(range(100))

        def refusing(*arguments: object, **options: object) -> object:
            if next(steps) == at:
                raise OSError(errno.ENOSPC, "No space left on device")
            return usual(*arguments, **options)

        patch.setattr(step, refusing)
        try:
            write_together(wanted, over=over)
        except OSError:
            assert everything(folder) == before
            return
        except UsageError:
            assert not over
            assert any(old.get(name, data) != data for name, data in new.items())
            assert everything(folder) == before
            return
    assert all(path.read_bytes() == data for path, data in wanted.items())
    assert {
        path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()
    } == {*old, *new}


def test_a_living_writer_keeps_its_place(tmp_path: Path) -> None:
    """Eight at a time on one file: each writes it whole, none removes what another writes into."""
    trouble: list[Exception] = []

    def write(value: int) -> None:
        try:
            for _ in range(25):
                write_atomically(tmp_path / "out", bytes([value]) * 1000)
        except Exception as error:  # noqa: BLE001  # asserted below
            trouble.append(error)

    threads = [threading.Thread(target=write, args=(value,)) for value in range(8)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    assert trouble == []
    assert len(set((tmp_path / "out").read_bytes())) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_the_hidden_place_of_another_file_stays(tmp_path: Path) -> None:
    (tmp_path / ".other.abcdefgh.part").mkdir()
    (tmp_path / ".out.mine.part").mkdir()
    with part_of(tmp_path / "out") as part:
        assert part.is_dir()
        write_atomically(tmp_path / "out", b"1")
        assert part.is_dir(), "its writer lives"
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        ".other.abcdefgh.part",
        ".out.mine.part",
        "out",
    ]


@pytest.mark.parametrize("name", ["x.pdf", "x.CSV", "deep/x.html"])
def test_a_name_of_a_file_makes_no_folder(tmp_path: Path, name: str) -> None:
    with pytest.raises(UsageError, match="the name of a"):
        refuse_file_name(tmp_path / name)
    with pytest.raises(UsageError, match="the name of a"):
        write_set(tmp_path / name, [ControlFile(name="a.ini", data=b"")])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["2026.11", "mill.v2", "out"])
def test_a_folder_may_have_a_point_in_its_name(tmp_path: Path, name: str) -> None:
    write_set(tmp_path / name, [ControlFile(name="a.ini", data=b"")])
    (tmp_path / "old.pdf").mkdir()
    refuse_file_name(tmp_path / "old.pdf")
