"""The finished files of a survey for download from the page."""

from collections.abc import Iterator
from pathlib import Path

from stepdiag.daq.records.status import Download
from stepdiag.daq.records.survey_folder import (
    CONCLUSION,
    EXPORTS,
    READINGS,
    REFUSED,
    RESULT,
    logs_in,
)
from stepdiag.exporters.files.sets import whole


def downloads_of(folder: Path) -> tuple[Download, ...]:
    """Return result, report, readings, controller files and logs of a survey's folder; empty
    without files.

    A link to a file outside the folder is not returned.
    """
    if not folder.is_dir():
        return ()
    found = [
        (path, "result")
        for name in (RESULT, READINGS, CONCLUSION)
        if (path := folder / name).is_file()
    ]
    found += [(path, "report") for path in sorted(folder.glob("report.*")) if path.is_file()]
    found += [
        (path, "certificate")
        for path in sorted(folder.glob("certificate*.*"))
        if path.is_file()
    ]
    found += [(path, "export") for path in _exported(folder / EXPORTS)]
    found += [(path, "log") for path in logs_in(folder) if path.suffix == ".mcap"]
    files = tuple(
        Download(
            name="-".join(path.relative_to(folder).parts),
            path=path,
            kind=kind,  # type: ignore[arg-type]
            size_bytes=path.stat().st_size,
        )
        for path, kind in found
        if _stands_in(folder, path)
    )
    return (*files, *_bundles(folder / EXPORTS))


def _stands_in(folder: Path, path: Path) -> bool:
    return path.resolve().is_relative_to(folder.resolve())


def _bundles(exports: Path) -> Iterator[Download]:
    for folder in sorted(exports.iterdir()) if exports.is_dir() else ():
        if (
            folder.is_dir()
            and not folder.name.startswith(".")
            and _stands_in(exports, folder)
            and whole(folder)
        ):
            size = sum(path.stat().st_size for path in folder.iterdir() if path.is_file())
            for kind, name in (
                ("bundle", f"{folder.name}.zip"),
                ("restore", f"{folder.name}-restore.zip"),
            ):
                yield Download(
                    name=name,
                    path=folder,
                    kind=kind,  # type: ignore[arg-type]
                    size_bytes=size,
                    group=folder.name,
                )


def _exported(folder: Path) -> list[Path]:
    """Return the files of every complete export. From an incomplete or refused export, return only
    REFUSED.txt: any other .txt can be a compensation file of a control."""
    if not folder.is_dir():
        return []
    found: list[Path] = []
    for each in sorted(
        inner
        for inner in folder.iterdir()
        if inner.is_dir() and not inner.name.startswith(".")
    ):
        files = sorted(
            path
            for path in each.iterdir()
            if path.is_file() and not path.name.startswith(".")
        )
        found += files if whole(each) else [path for path in files if path.name == REFUSED]
    return found
