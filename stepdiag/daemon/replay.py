"""Comparison of a replay with the files of the live run: same bytes, equal within 0.1 nm (another
processor), or different."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from stepdiag.base.messages import Message, message
from stepdiag.base.result.result import same_result
from stepdiag.completion.completion import complete
from stepdiag.daq.records.survey_folder import CONCLUSION, EXPORTS, READINGS, RESULT
from stepdiag.daq.replay import find_logs
from stepdiag.report.completed import write_completed_report

_FOLLOWS = re.compile(rb"\b[0-9a-f]{64}\b|base64,[A-Za-z0-9+/=]+")
"""Pattern of hashes, and of encoded tables in a report. Hashes and tables are computed from numbers
that are compared elsewhere."""
_NUMBER = re.compile(rb"-?\d+(?:\.(\d+))?")


@dataclass(frozen=True, slots=True)
class Compared:
    """The files that a replay wrote into ``out``, compared with the files of the live run.

    ``rounded`` are files with differences that another processor can cause: less than 0.1 nm in the
    result, last digits and hashes in the other files. ``missing`` are files that the live run does
    not have.
    """

    out: Path
    live: Path
    identical: tuple[str, ...]
    rounded: tuple[str, ...]
    different: tuple[str, ...]
    missing: tuple[str, ...]

    def as_json(self) -> dict[str, object]:
        return {
            "out": str(self.out),
            "live": str(self.live),
            "identical": list(self.identical),
            "rounded": list(self.rounded),
            "different": list(self.different),
            "missing": list(self.missing),
        }

    def in_words(self) -> Iterator[Message]:
        yield message("replayed-into", folder=str(self.out))
        if self.identical:
            yield message("replay-identical", names=self.identical)
        if self.rounded:
            yield message("replay-rounded", names=self.rounded)
        if self.missing:
            yield message("replay-missing", names=self.missing)


def replay_and_compare(
    paths: Sequence[Path], out: Path | None, survey_file: Path | None = None
) -> Compared:
    """Complete a survey from its logs into ``out``, and compare every file with the file beside the
    logs.

    ``survey_file`` replaces an unusable survey file in the logs.
    """
    logs = find_logs(paths)
    live = logs[0].parent
    target = live / "replay" if out is None else out
    done = complete(logs, target, survey_file)
    write_completed_report(done)
    written = [
        target / RESULT,
        target / READINGS,
        target / CONCLUSION,
        target / "report.html",
        *sorted((target / EXPORTS).rglob("*")),
    ]
    names = [path.relative_to(target) for path in written if path.is_file()]
    verdicts: dict[str, list[str]] = {
        "identical": [],
        "rounded": [],
        "different": [],
        "missing": [],
    }
    for name in names:  # the result comes first: the hashes of the other files follow from it
        verdict = _verdict(
            live / name, (target / name).read_bytes(), rounded=bool(verdicts["rounded"])
        )
        verdicts[verdict].append(str(name))
    return Compared(
        target, live, **{verdict: tuple(found) for verdict, found in verdicts.items()}
    )


def _verdict(other: Path, again: bytes, *, rounded: bool) -> str:
    """Return the state of a replayed file in comparison with the live run's file. With ``rounded``,
    an earlier file differed in a last digit, so that hashes may differ.
    """
    if not other.is_file():
        return "missing"
    before = other.read_bytes()
    if before == again:
        return "identical"
    if other.name == RESULT:
        return "rounded" if same_result(before, again) else "different"
    return (
        "rounded"
        if rounded and other.name != READINGS and _same_but_for_last_digits(before, again)
        else "different"
    )


def _same_but_for_last_digits(before: bytes, again: bytes) -> bool:
    one, other = _FOLLOWS.sub(b"", before), _FOLLOWS.sub(b"", again)
    if _NUMBER.sub(b"", one) != _NUMBER.sub(b"", other):
        return False
    return all(
        _same_but_for_last_digit(*pair)
        for pair in zip(_NUMBER.finditer(one), _NUMBER.finditer(other), strict=True)
    )


def _same_but_for_last_digit(one: re.Match[bytes], other: re.Match[bytes]) -> bool:
    decimals = max(len(found[1] or b"") for found in (one, other))
    return one[0] == other[0] or (
        decimals > 0 and abs(float(one[0]) - float(other[0])) < 1.5 * 10.0**-decimals
    )
