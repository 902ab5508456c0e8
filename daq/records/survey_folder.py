"""Names of the files in the folder of a survey. The module imports no other module of the
program.
"""

from pathlib import Path
from urllib.parse import quote

RESULT = "result.json"
READINGS = "readings.csv"
CONCLUSION = "conclusion.json"
EXPORTS = "exports"
AHEAD = "ahead.json"
"""File with the next passes to drive."""
REFUSED = "REFUSED.txt"
"""File in the folder of the control files that contains the reason for a refused export."""


def machine_folder(machine: str) -> str:
    """Return the folder of a machine in a store of finished surveys."""
    return f"machine={quote(machine, safe=' ')}"


def logs_in(folder: Path) -> list[Path]:
    """Return the logs of a folder in the order of their numbers.

    A mended copy (``0001.recovered.mcap``) replaces its damaged log. A log that was cut off
    (``.part``) is returned until its mended copy exists.
    """
    found = {
        path.name: path
        for path in folder.iterdir()
        if path.name.endswith((".mcap", ".mcap.part"))
    }
    replaced = {
        name.replace(".recovered.mcap", ".mcap")
        for name in found
        if name.endswith(".recovered.mcap")
    }
    replaced |= {f"{name}.part" for name in found if name.endswith(".mcap")}
    return [found[name] for name in sorted(found) if name not in replaced]
