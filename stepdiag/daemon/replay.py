"""A replay beside what the live run wrote: the same bytes, or which files differ."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from stepdiag.daq.records.survey_folder import CONCLUSION, EXPORTS, READINGS, RESULT
from stepdiag.daq.replay import find_logs
from stepdiag.daq.service.completion import complete
from stepdiag.report.completed import write_completed_report


@dataclass(frozen=True, slots=True)
class Compared:
    """What a replay wrote into ``out``, against the live run's folder. ``missing`` are files that the live run does not have."""

    out: Path
    live: Path
    identical: tuple[str, ...]
    different: tuple[str, ...]
    missing: tuple[str, ...]

    def as_json(self) -> dict[str, object]:
        """Return the comparison for programs."""
        return {
            "out": str(self.out),
            "live": str(self.live),
            "identical": list(self.identical),
            "different": list(self.different),
            "missing": list(self.missing),
        }

    def in_words(self) -> str:
        """Return the comparison for a person."""
        lines = [f"replayed into {self.out}"]
        if self.identical:
            lines.append(f"identical to the live run, byte for byte: {', '.join(self.identical)}")
        if self.missing:
            lines.append(f"not there from a live run, nothing to compare with: {', '.join(self.missing)}")
        return "\n".join(lines)


def replay_and_compare(paths: Sequence[Path], out: Path | None, survey_file: Path | None = None) -> Compared:
    """Complete a survey from its logs into ``out`` and compare every file with the one beside the logs.

    ``survey_file`` stands for the one in the logs where that cannot be used.
    """
    logs = find_logs(paths)
    live = logs[0].parent
    target = live / "replay" if out is None else out
    done = complete(logs, target, survey_file)
    write_completed_report(done)
    written = [target / RESULT, target / READINGS, target / CONCLUSION, target / "report.html", *sorted((target / EXPORTS).rglob("*"))]
    names = [path.relative_to(target) for path in written if path.is_file()]
    verdicts: dict[str, list[str]] = {"identical": [], "different": [], "missing": []}
    for name in names:
        other = live / name
        same = "missing" if not other.is_file() else "identical" if other.read_bytes() == (target / name).read_bytes() else "different"
        verdicts[same].append(str(name))
    return Compared(target, live, tuple(verdicts["identical"]), tuple(verdicts["different"]), tuple(verdicts["missing"]))
