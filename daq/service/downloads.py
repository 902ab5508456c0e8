"""The finished files of a survey that a person may fetch from the page."""

from pathlib import Path

from stepdiag.daq.records.status import Download
from stepdiag.daq.records.survey_folder import EXPORTS, READINGS, RESULT, logs_in


def downloads_of(folder: Path) -> tuple[Download, ...]:
    """Return result, report, readings, controller files and logs of a survey's folder; empty before there are any."""
    if not folder.is_dir():
        return ()
    found = [(path, "result") for name in (RESULT, READINGS) if (path := folder / name).is_file()]
    found += [(path, "report") for path in sorted(folder.glob("report.*")) if path.is_file()]
    found += [(path, "export") for path in sorted((folder / EXPORTS).rglob("*")) if path.is_file()]
    found += [(path, "log") for path in logs_in(folder) if path.suffix == ".mcap"]
    return tuple(
        Download(
            name="-".join(path.relative_to(folder).parts),
            path=path,
            kind=kind,  # type: ignore[arg-type]
            size_bytes=path.stat().st_size,
        )
        for path, kind in found
    )
