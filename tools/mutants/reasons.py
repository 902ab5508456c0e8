"""The survivors that survivors.md has a reason for."""

from pathlib import Path

PAGE = Path(__file__).resolve().parent / "survivors.md"


def known() -> set[tuple[str, str, str]]:
    """Return file, operator and line of each."""
    rows = [
        line.replace(r"\|", "\0").split("|")
        for line in PAGE.read_text(encoding="utf-8").splitlines()
        if line.startswith("| `")
    ]
    told = [[cell.strip().strip("`").replace("\0", "|") for cell in row[1:4]] for row in rows]
    return {(cells[0], cells[1], cells[2]) for cells in told}
