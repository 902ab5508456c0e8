"""Logs as other programs read them: the Python reader, and @mcap/core, the reader inside Foxglove
and Lichtblick.

`make test` installs @mcap/core beside count.mjs from its lock file (npm ci).
"""

import json
import subprocess
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from stepdiag.daq.log.recorder import Recorder
from stepdiag.daq.log.recovery import recover
from stepdiag.daq.log.topics import CHANNELS
from stepdiag.daq.records.events import LinkEvent, Loss
from testkit.recording import HEADER, START_NS, recording, with_notes, write_log

pytestmark = pytest.mark.system

NODE = Path(__file__).parents[1] / "node"
ITEMS = [
    *with_notes(recording(3.0)),
    LinkEvent(START_NS + 4 * 10**9, "laser", "lost", "unplugged"),
    Loss(START_NS + 5 * 10**9, 3, 300, "the disk is full"),
]


def recorded(folder: Path) -> Path:
    """A log as the recorder leaves it."""
    recorder = Recorder(lambda _health: None)
    recorder.begin(folder / "recorded.mcap", HEADER)
    for event in recording(2.0, lines_per_chunk=7):
        recorder.admit(event)
    recorder.end("complete")
    assert recorder.stop()
    return folder / "recorded.mcap"


def recovered(folder: Path) -> Path:
    """A log that was cut off and mended."""
    lengths = write_log(folder / "whole.mcap", ITEMS)
    part = folder / "mended.mcap.part"
    part.write_bytes((folder / "whole.mcap").read_bytes()[: lengths[-1] - 100])
    return recover(part).target


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("logs")
    return [recorded(folder), recovered(folder), folder / "whole.mcap"]


@pytest.fixture(scope="module")
def by_node(logs: list[Path]) -> dict[str, Any]:
    """What @mcap/core finds in the logs, by path."""
    command = ["node", "count.mjs", *map(str, logs)]
    done = subprocess.run(
        command, cwd=NODE, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def by_python(path: Path) -> dict[str, int]:
    with path.open("rb") as file:
        return dict(
            Counter(
                channel.topic
                for _, channel, _ in make_reader(file, validate_crcs=True).iter_messages()
            )
        )


@pytest.mark.parametrize("index", range(3))
def test_all_readers_find_the_same_messages(
    logs: list[Path], by_node: dict[str, Any], index: int
) -> None:
    """acquisition.md B2, rule 12. The indexed reader once returned nothing from a file that the
    others read whole."""
    found, expected = by_node[str(logs[index])], by_python(logs[index])
    assert found["indexed"]["counts"] == expected
    assert found["streamed"]["counts"] == expected
    assert found["streamed"]["done"]
    assert expected["/laser/raw"] > 0


@pytest.mark.parametrize("index", range(3))
def test_every_channel_has_its_schema_and_the_run_its_metadata(
    logs: list[Path], by_node: dict[str, Any], index: int
) -> None:
    found = by_node[str(logs[index])]
    assert found["indexed"]["schemas"] == {
        channel.topic: channel.schema_name for channel in CHANNELS
    }
    assert sorted(found["streamed"]["metadata"]) == [
        "foxglove",
        "stepdiag.clock",
        "stepdiag.run",
        "stepdiag.run_stop",
    ]
