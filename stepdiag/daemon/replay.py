"""A replay beside what the live run wrote: the same bytes, the same but for a last digit (another processor), or which files differ."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from stepdiag.daq.records.survey_folder import CONCLUSION, EXPORTS, READINGS, RESULT
from stepdiag.daq.replay import find_logs
from stepdiag.daq.service.completion import complete
from stepdiag.report.completed import write_completed_report
from stepdiag.solver.result.result import same_result

_HASH = re.compile(rb"\b[0-9a-f]{64}\b")


@dataclass(frozen=True, slots=True)
class Compared:
    """What a replay wrote into ``out``, against the live run's folder.

    ``rounded`` are files that differ in the last digit of a number of the result, as another processor's products make it, or in nothing
    but the hash of such a file. ``missing`` are files that the live run does not have.
    """

    out: Path
    live: Path
    identical: tuple[str, ...]
    rounded: tuple[str, ...]
    different: tuple[str, ...]
    missing: tuple[str, ...]

    def as_json(self) -> dict[str, object]:
        """Return the comparison for programs."""
        return {
            "out": str(self.out),
            "live": str(self.live),
            "identical": list(self.identical),
            "rounded": list(self.rounded),
            "different": list(self.different),
            "missing": list(self.missing),
        }

    def in_words(self) -> str:
        """Return the comparison for a person."""
        lines = [f"replayed into {self.out}"]
        if self.identical:
            lines.append(f"identical to the live run, byte for byte: {', '.join(self.identical)}")
        if self.rounded:
            lines.append(f"the same but for the last digit of a number, as another processor writes it: {', '.join(self.rounded)}")
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
    verdicts: dict[str, list[str]] = {"identical": [], "rounded": [], "different": [], "missing": []}
    for name in names:  # the result comes first: the hashes of others follow from it
        verdict = _verdict(live / name, (target / name).read_bytes(), rounded=bool(verdicts["rounded"]))
        verdicts[verdict].append(str(name))
    return Compared(target, live, **{verdict: tuple(found) for verdict, found in verdicts.items()})


def _verdict(other: Path, again: bytes, *, rounded: bool) -> str:
    """Return what a file is beside the live run's; ``rounded``: an earlier one was the same but for a last digit."""
    if not other.is_file():
        return "missing"
    before = other.read_bytes()
    if before == again:
        return "identical"
    if other.name == RESULT:
        return "rounded" if same_result(before, again) else "different"
    return "rounded" if rounded and _HASH.sub(b"", before) == _HASH.sub(b"", again) else "different"
