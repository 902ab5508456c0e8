"""What others wrote and the page carries: the bytes of the package that was taken, with its
licence."""

import hashlib
from pathlib import Path

import stepdiag.page

VENDOR = Path(stepdiag.page.__file__).parent / "static" / "vendor"
UPLOT = {
    "uPlot.iife.min.js": "19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f",
    "uPlot.min.css": "df630c6a8d6f8eeaff264b50f73ce5b114f646ffd9a0bb74f049b0a00135fa04",
    "uPlot.LICENSE": "8f989229699b4fe2f1a0432d0e9edc338a8a911e250e2d1b01ecd770a5f5b1bd",
}
"""Of uplot 1.6.32 on npm (``npm pack uplot@1.6.32``), folder dist."""


def test_what_is_vendored_is_what_was_taken() -> None:
    """Nobody has edited it, and nothing stands beside it unnamed."""
    assert {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in VENDOR.iterdir()
    } == UPLOT
    assert "MIT License" in (VENDOR / "uPlot.LICENSE").read_text(encoding="utf-8")
