"""Files and sets of files: what is written where, with which rights, what is read, and every
refusal in its words."""

import hashlib
import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from stepdiag.base.errors import UsageError
from stepdiag.base.files import (
    LARGEST_BYTES,
    LARGEST_SETTINGS_BYTES,
    LARGEST_TABLE_BYTES,
    as_text,
    holds,
    read_bytes,
    read_text,
    write_atomically,
    write_new,
    write_once,
)
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.sets import SUMS, read_given, read_set, whole, write_set, zip_of
from testkit.recorded.plain import attempted, in_folder

FILES = (
    ControlFile(name="B.INI", data=b"b\n"),
    ControlFile(name="A.INI", data=b"a\n"),
    ControlFile(name="A_RESTORE.INI", data=b"old\n"),
    ControlFile(name="EXPORT.txt", data=b"what\n", role="note"),
)


def cases() -> dict[str, Callable[[], Any]]:
    """Return what is done with files by its name."""
    return {
        "single": _single,
        "written": _written,
        "read": _read,
        "packed": _packed,
        "limits": _limits,
    }


def _rights(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): f"{path.stat().st_mode & 0o777:o}"
        for path in sorted(folder.rglob("*"))
    }


def _single() -> Any:
    def act(folder: Path) -> Any:
        """Return every outcome, the folder's name out of it."""
        found: dict[str, Any] = {}

        def tried(name: str, act: Callable[[], Any]) -> None:
            try:
                made = attempted(act)
            except OSError as error:
                made = f"{type(error).__name__}: {error.strerror}"
            found[name] = _without(made, folder)

        path = folder / "a.txt"
        tried(
            "atomically", lambda: write_atomically(folder / "deep" / "er" / "b.txt", b"one")
        )
        tried(
            "atomically again",
            lambda: write_atomically(folder / "deep" / "er" / "b.txt", b"two"),
        )
        tried("atomically over a folder", lambda: write_atomically(folder / "deep", b"one"))
        tried("once", lambda: write_once(path, "\u00e4\n"))
        tried("once more", lambda: write_once(path, "\u00e4\n"))
        tried("once otherwise", lambda: write_once(path, "a\n"))
        tried("once over a folder", lambda: write_once(folder / "deep", "a\n"))
        tried("new", lambda: write_new(folder / "new.txt", "n\n"))
        tried("new again", lambda: write_new(folder / "new.txt", "m\n"))
        tried("new nowhere", lambda: write_new(folder / "none" / "new.txt", "m\n"))
        tried(
            "holds",
            lambda: [
                holds(path, b"\xc3\xa4\n"),
                holds(path, b"\xc3\xa5\n"),
                holds(path, b""),
                holds(folder, b""),
            ],
        )
        for largest in (2, 3, 4):
            tried(
                f"read {largest}",
                lambda largest=largest: read_bytes(path, largest=largest).hex(),
            )
            tried(
                f"read {largest} named",
                lambda largest=largest: read_bytes(
                    path, "a.field", largest=largest, blame=UsageError
                ).hex(),
            )
        tried("read a folder", lambda: read_bytes(folder))
        tried(
            "read a folder named",
            lambda: read_bytes(
                folder / "deep", "a.field", expected="a thing", remedy="do it"
            ),
        )
        tried("read nothing", lambda: read_bytes(folder / "none"))
        tried(
            "read nothing named",
            lambda: read_bytes(
                folder / "none", "a.field", expected="a thing", remedy="do it"
            ),
        )
        tried("read a NUL", lambda: read_bytes(Path("a\0b")))
        tried("text", lambda: read_text(path))
        (folder / "mark.txt").write_bytes(b"\xef\xbb\xbfa\xef\xbb\xbf")
        tried("text with a mark", lambda: read_text(folder / "mark.txt"))
        tried("no text", lambda: as_text(b"ab\xff", "here"))
        tried("no text, blamed", lambda: as_text(b"\xffab", "here", UsageError))
        return found | {"rights": _rights(folder)}

    return in_folder(act)


def _without(made: Any, folder: Path) -> Any:
    if isinstance(made, dict) and "refused" in made:
        return {"refused": made["refused"].replace(str(folder), "FOLDER")}
    return made


def _written() -> Any:
    def act(folder: Path) -> Any:
        found: dict[str, Any] = {
            "names": list(write_set(folder / "deep" / "out", FILES)),
            "rights": _rights(folder),
        }
        found["list"] = (
            (folder / "deep" / "out" / SUMS).read_text(encoding="utf-8").split("\n")
        )
        found["again"] = list(write_set(folder / "deep" / "out", FILES))
        (folder / "empty").mkdir()
        found["into an empty one"] = list(write_set(folder / "empty", FILES[:1]))
        (folder / "file").write_bytes(b"")
        for name, target, files in (
            ("other files", folder / "deep" / "out", FILES[1:]),
            ("more files", folder / "empty", FILES[:2]),
            ("other bytes", folder / "empty", [ControlFile(name="B.INI", data=b"c\n")]),
            ("a file", folder / "file", FILES),
            ("under a file", folder / "file" / "out", FILES),
            (
                "two of one name",
                folder / "two",
                [*FILES, ControlFile(name="a.ini", data=b"")],
            ),
            (
                "the list's name",
                folder / "two",
                [*FILES, ControlFile(name="sha256sums", data=b"")],
            ),
            ("nothing", folder / "nothing", []),
        ):
            found[name] = _without(
                attempted(lambda target=target, files=files: list(write_set(target, files))),
                folder,
            )
        return found | {"left": sorted(path.name for path in folder.rglob("*"))}

    return in_folder(act)


def _read() -> Any:
    """Sets that somebody touched."""

    def act(folder: Path) -> Any:
        found: dict[str, Any] = {}

        def harmed(name: str, harm: Callable[[Path], Any]) -> None:
            out = folder / str(len(found))
            write_set(out, FILES)
            harm(out)
            found[name] = [
                _without(
                    attempted(
                        lambda: [
                            f"{file.name} {file.data!r} {file.role}" for file in read_set(out)
                        ]
                    ),
                    out,
                ),
                whole(out),
                _without(
                    attempted(lambda: [file.name for file in read_given([out / "B.INI"])]),
                    out,
                ),
                _without(
                    attempted(
                        lambda: [
                            file.name for file in read_given([out / SUMS, out / "EXPORT.txt"])
                        ]
                    ),
                    out,
                ),
            ]

        def listed(change: Callable[[bytes], bytes]) -> Callable[[Path], Any]:
            return lambda out: (out / SUMS).write_bytes(change((out / SUMS).read_bytes()))

        harmed("untouched", lambda out: None)
        harmed("hidden", lambda out: (out / ".B.INI.x").write_bytes(b""))
        harmed("one lost", lambda out: (out / "A.INI").unlink())
        harmed(
            "two lost",
            lambda out: [(out / name).unlink() for name in ("A.INI", "EXPORT.txt")],
        )
        harmed("one altered", lambda out: (out / "A.INI").write_bytes(b"b\n"))
        harmed("B altered", lambda out: (out / "B.INI").write_bytes(b"a\n"))
        harmed(
            "two altered",
            lambda out: [(out / name).write_bytes(b"b") for name in ("A.INI", "EXPORT.txt")],
        )
        harmed(
            "two foreign",
            lambda out: [(out / name).write_bytes(b"b") for name in ("C.INI", "D.INI")],
        )
        harmed("no list", lambda out: (out / SUMS).unlink())
        harmed("empty list", listed(lambda data: b""))
        harmed("a short line", listed(lambda data: data + b"abc\n"))
        harmed("an empty line", listed(lambda data: data.replace(b"\n", b"\n\n", 1)))
        harmed("one blank", listed(lambda data: data.replace(b"  ", b" ", 1)))
        harmed("capitals", listed(lambda data: data.upper()))
        harmed("a path", listed(lambda data: data.replace(b"B.INI", b"x/B.INI")))
        harmed("a name of 200", listed(lambda data: data.replace(b"B.INI", b"B" * 200)))
        harmed("a name of 201", listed(lambda data: data.replace(b"B.INI", b"B" * 201)))
        harmed("a line less", listed(lambda data: data.partition(b"\n")[2]))
        harmed("no UTF-8", listed(lambda data: data + b"\xff"))
        found["a folder and a file"] = [
            file.name for file in read_given([folder / "0", folder / "0" / "B.INI"])
        ]
        (folder / "alone.ini").write_bytes(b"x")
        found["alone"] = [
            f"{file.name} {file.data!r} {file.role}"
            for file in read_given([folder / "alone.ini"])
        ]
        found["no folder"] = whole(folder / "none")
        return found

    return in_folder(act)


def _packed() -> Any:
    def act(folder: Path) -> Any:
        write_set(folder / "out", FILES)
        found: dict[str, Any] = {}
        for restore in (False, True):
            with zipfile.ZipFile(
                io.BytesIO(zip_of(folder / "out", restore=restore))
            ) as archive:
                found[f"restore {restore}"] = [
                    [
                        one.filename,
                        list(one.date_time),
                        one.compress_type,
                        hashlib.sha256(archive.read(one)).hexdigest(),
                    ]
                    for one in archive.infolist()
                ]
        return found

    return in_folder(act)


def _limits() -> Any:
    """The largest files: a byte more than each is refused where it counts."""
    return [LARGEST_BYTES, LARGEST_SETTINGS_BYTES, LARGEST_TABLE_BYTES]
