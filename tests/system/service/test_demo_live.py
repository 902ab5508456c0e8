"""``stepdiag demo --live`` as a person uses it: the page, Enter, a hand in the beam, the end."""

import os
import subprocess
import sys
import urllib.request

import pytest

pytestmark = pytest.mark.system


def until_stage(stream, stage):
    """Read the page's stream until it shows a stage."""
    for line in stream:
        if f'"stage":"{stage}"'.encode() in line:
            return
    raise AssertionError(f"the stream ended before {stage}")


def test_a_hand_in_the_beam_is_seen_on_the_page(tmp_path):
    """Enter starts the first setup, a key cuts the beam, the page's own stream says so; afterwards nothing is left running."""
    command = (sys.executable, "-m", "stepdiag", "demo", "--live", "--no-browser", "--out", str(tmp_path / "demo"))
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment) as demo:
        address = next(line for line in demo.stdout if line.startswith("The page: ")).split()[-1]
        with urllib.request.urlopen(f"{address}/stream", timeout=200) as stream:
            demo.stdin.write("\n")
            demo.stdin.flush()
            until_stage(stream, "drive")
            demo.stdin.write("b")
            demo.stdin.flush()
            until_stage(stream, "trouble")
        said, _ = demo.communicate("q", timeout=200)
    assert "hold a hand into the beam" in said
    assert demo.returncode == 0
    assert list((tmp_path / "demo" / "demo" / "0001").glob("*.mcap*")), "what was recorded stays"
