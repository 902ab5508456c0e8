"""Sets of files: there whole or not at all, whoever is killed, whoever else writes, and refused
when somebody has touched them."""

import hashlib
import os
import signal
import threading
from pathlib import Path

import pytest

from stepdiag.base.errors import DataError, SafetyError, UsageError
from stepdiag.exporters.files import sets
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.sets import SUMS, read_given, read_set, whole, write_set


def files(value: int, count: int = 5) -> tuple[ControlFile, ...]:
    """A set whose files all say which export they are of."""
    return tuple(
        ControlFile(
            name=f"T{n}{'_RESTORE' if n % 2 else ''}.INI", data=f"{value} {n}\n".encode() * 50
        )
        for n in range(count)
    )


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def exports_of(folder: Path) -> set[bytes]:
    """Which exports the files of a folder are of."""
    return {path.read_bytes().split()[0] for path in folder.iterdir() if path.name != SUMS}


class TestWriting:
    def test_the_folder_holds_the_files_and_their_hashes(self, tmp_path):
        written = write_set(tmp_path / "deep" / "out", files(1))
        assert sorted(written) == names(tmp_path / "deep" / "out")
        for line in (
            (tmp_path / "deep" / "out" / SUMS).read_text(encoding="utf-8").splitlines()
        ):
            digest, _, name = line.partition("  ")
            assert (
                hashlib.sha256((tmp_path / "deep" / "out" / name).read_bytes()).hexdigest()
                == digest
            )
        assert names(tmp_path / "deep") == ["out"]

    def test_the_same_set_may_be_written_again_and_no_other(self, tmp_path):
        write_set(tmp_path / "out", files(1))
        before = (tmp_path / "out").stat().st_mtime_ns
        write_set(tmp_path / "out", files(1))
        with pytest.raises(UsageError, match="nothing is overwritten"):
            write_set(tmp_path / "out", files(2))
        assert (tmp_path / "out").stat().st_mtime_ns == before
        assert exports_of(tmp_path / "out") == {b"1"}

    def test_a_folder_with_other_files_is_no_place_for_a_set(self, tmp_path):
        (tmp_path / "note.txt").write_text("mine")
        with pytest.raises(UsageError, match="new or empty folder"):
            write_set(tmp_path, files(1))
        assert names(tmp_path) == ["note.txt"]

    def test_an_empty_folder_is_one(self, tmp_path):
        (tmp_path / "out").mkdir()
        write_set(tmp_path / "out", files(1))
        assert whole(tmp_path / "out")

    def test_two_files_of_one_name_are_refused(self, tmp_path):
        with pytest.raises(UsageError, match="one file of each name"):
            write_set(tmp_path / "out", [*files(1), ControlFile(name="t0.ini", data=b"")])
        assert names(tmp_path) == []

    def test_what_brings_the_control_back_is_written_first(self, tmp_path, monkeypatch):
        order = []
        through = sets.write_through
        monkeypatch.setattr(
            sets,
            "write_through",
            lambda path, data: (order.append(path.name), through(path, data)),
        )
        write_set(tmp_path / "out", files(1))
        assert order == [
            "T1_RESTORE.INI",
            "T3_RESTORE.INI",
            "T0.INI",
            "T2.INI",
            "T4.INI",
            SUMS,
        ]

    @pytest.mark.parametrize("full_at", range(8))
    def test_a_full_disk_at_any_file_leaves_nothing(self, tmp_path, monkeypatch, full_at):
        """Six files, the hidden folder, the folder above: after the rename the set stands, before
        it nothing does."""
        synced = iter(range(100))
        sync = os.fsync

        def fsync(handle: int) -> None:
            if next(synced) == full_at:
                raise OSError(28, "No space left on device")
            sync(handle)

        monkeypatch.setattr("os.fsync", fsync)
        with pytest.raises(UsageError, match="No space left on device"):
            write_set(tmp_path / "out", files(1))
        assert names(tmp_path) == ([] if full_at < 7 else ["out"])
        assert full_at < 7 or whole(tmp_path / "out")

    @pytest.mark.parametrize("killed_at", range(8))
    def test_kill_9_at_any_file_leaves_all_or_nothing(self, tmp_path, killed_at):
        """A process of its own dies within the write: what a person can see is no folder, or the
        whole of it."""
        child = os.fork()
        if child == 0:
            steps = iter(range(100))
            os.fsync = lambda _: (
                os.kill(os.getpid(), signal.SIGKILL) if next(steps) == killed_at else None
            )
            write_set(tmp_path / "out", files(1))
            os._exit(0)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
        assert not (tmp_path / "out").exists() or whole(tmp_path / "out")
        assert all(name.startswith(".out.") for name in names(tmp_path) if name != "out")
        assert write_set(tmp_path / "out", files(1))
        assert whole(tmp_path / "out")
        assert names(tmp_path) == ["out"], "what the killed writer left is gone"

    def test_of_many_writers_one_wins_and_its_set_is_whole(self, tmp_path):
        """Twenty folders, four writers each with other bytes: never files of two exports in one
        folder."""
        for place in range(20):
            refused: list[UsageError] = []
            start = threading.Barrier(4)

            def write(
                value: int,
                folder: Path = tmp_path / str(place),
                start: threading.Barrier = start,
                lost: list = refused,
            ) -> None:
                start.wait()
                try:
                    write_set(folder, files(value, 4))
                except UsageError as error:
                    lost.append(error)

            writers = [threading.Thread(target=write, args=(value,)) for value in range(4)]
            for writer in writers:
                writer.start()
            for writer in writers:
                writer.join()
            assert len(refused) == 3
            assert len(exports_of(tmp_path / str(place))) == 1
            assert whole(tmp_path / str(place))
        assert names(tmp_path) == sorted(map(str, range(20)))

    def test_the_same_set_written_meanwhile_by_another_is_ours_and_nothing_is_left_beside_it(
        self, tmp_path, monkeypatch
    ):
        through = sets.write_through

        def overtaken(path, data):
            monkeypatch.setattr(sets, "write_through", through)
            write_set(tmp_path / "out", files(1))
            through(path, data)

        monkeypatch.setattr(sets, "write_through", overtaken)
        write_set(tmp_path / "out", files(1))
        assert whole(tmp_path / "out")
        assert names(tmp_path) == ["out"]


class TestReading:
    def test_gives_the_files_as_they_were_written(self, tmp_path):
        write_set(tmp_path / "out", files(1))
        assert read_set(tmp_path / "out")[:-1] == tuple(
            ControlFile(name=file.name, data=file.data) for file in files(1)
        )

    @pytest.mark.parametrize(
        ("harm", "code"),
        [
            (lambda out: (out / "T1_RESTORE.INI").unlink(), "set-altered.missing"),
            (lambda out: (out / "T0.INI").write_bytes(b"0"), "set-altered"),
            (lambda out: (out / "T9.INI").write_bytes(b"9"), "set-altered.foreign"),
            (lambda out: (out / SUMS).write_bytes(b""), "set-altered"),
            (
                lambda out: (out / SUMS).write_bytes((out / SUMS).read_bytes()[:-3]),
                "set-altered.missing",
            ),
        ],
    )
    def test_a_set_that_somebody_touched_is_refused(self, tmp_path, harm, code):
        write_set(tmp_path / "out", files(1))
        harm(tmp_path / "out")
        with pytest.raises(SafetyError) as refusal:
            read_given([tmp_path / "out"])
        assert refusal.value.code == code
        assert not whole(tmp_path / "out")

    def test_left_overs_of_a_broken_write_are_no_files(self, tmp_path):
        write_set(tmp_path / "out", files(1))
        (tmp_path / "out" / ".T0.INI.x1").write_bytes(b"half")
        assert len(read_set(tmp_path / "out")) == 6

    def test_a_folder_without_a_list_is_no_set(self, tmp_path):
        (tmp_path / "T0.INI").write_bytes(b"0")
        with pytest.raises(DataError, match="name the files of the control one by one"):
            read_set(tmp_path)

    def test_a_single_file_of_a_set_must_be_its_own(self, tmp_path):
        write_set(tmp_path / "out", files(1))
        assert [file.name for file in read_given([tmp_path / "out" / "T0.INI"])] == ["T0.INI"]
        (tmp_path / "out" / "T0.INI").write_bytes(b"0")
        with pytest.raises(SafetyError) as refusal:
            read_given([tmp_path / "out" / "T0.INI"])
        assert refusal.value.code == "set-altered"

    def test_who_names_the_list_means_the_set(self, tmp_path):
        write_set(tmp_path / "out", files(1))
        (tmp_path / "out" / "T4.INI").unlink()
        with pytest.raises(SafetyError) as refusal:
            read_given([tmp_path / "out" / "T0.INI", tmp_path / "out" / SUMS])
        assert refusal.value.code == "set-altered.missing"
