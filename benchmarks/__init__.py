"""Measurements beside the tests; their exact machines stand in tests/lib."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests/lib"))
