"""What an export wrote, and the writing of it with its list of SHA-256."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.writing import write_all
from stepdiag.exporters.safety.verify import Prediction
from stepdiag.exporters.tables.tables import Table
from stepdiag.solver.findings import Finding

REPORT = "EXPORT_REPORT.txt"
SUMS = "SHA256SUMS"


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportReport:
    """What an export wrote. ``files`` are the names within ``out_dir``; ``prediction`` is None for a lattice that knows no control."""

    controller: str
    out_dir: Path
    files: tuple[str, ...]
    findings: tuple[Finding, ...]
    tables: tuple[Table, ...]
    prediction: Prediction | None
    text: str


def write(out_dir: Path, files: Sequence[ControlFile]) -> tuple[str, ...]:
    """Write the files and the list of their SHA-256, which ``sha256sum --check`` understands; return all names."""
    sums = "".join(f"{hashlib.sha256(file.data).hexdigest()}  {file.name}\n" for file in files)
    everything = [*files, ControlFile(name=SUMS, data=sums.encode("ascii"), role="note")]
    write_all(out_dir, everything)
    return tuple(file.name for file in everything)
