"""What the daemon keeps of a child that solved a survey."""

import asyncio
import json
import sys
from pathlib import Path

import pytest

from stepdiag.daq.records.status import Severity
from stepdiag.daq.service.child_jobs import Commands, Finisher
from stepdiag.daq.service.metrics import Tally

WRITE = (
    "import sys, pathlib; pathlib.Path(sys.argv[2], 'result.json').write_text(sys.argv[1])"
)


@pytest.mark.parametrize("severity", ["info", "warning", "error", None])
def test_the_verdict_of_a_proof_run_is_kept_until_the_next_survey(
    tmp_path: Path, severity: Severity | None
) -> None:
    """Its severity, among findings of other codes; no verdict where the result holds none."""
    codes = [("noise-large", "warning"), *([("proof", severity)] if severity else [])]
    findings = [{"code": code, "severity": of, "text": "x"} for code, of in codes]
    command = (sys.executable, "-c", WRITE, json.dumps({"findings": findings}))

    async def driven() -> tuple[Severity | None, Severity | None]:
        done = asyncio.Event()
        finisher = Finisher(Commands(completion=command), Tally(), lambda *_: done.set())
        finisher.finish(tmp_path)
        await done.wait()
        kept = finisher.proof
        finisher.forget()
        await finisher.close()
        return kept, finisher.proof

    assert asyncio.run(driven()) == (severity, None)
