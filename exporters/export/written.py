from dataclasses import dataclass
from pathlib import Path

from stepdiag.base.findings import Finding
from stepdiag.exporters.safety.verify import Prediction
from stepdiag.exporters.tables.tables import Table

REPORT = "EXPORT_REPORT.txt"


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportReport:
    """Result of an export. ``files`` contains the names of the written files in ``out_dir``.
    ``prediction`` is None for a lattice that belongs to no control.
    """

    controller: str
    out_dir: Path
    files: tuple[str, ...]
    findings: tuple[Finding, ...]
    tables: tuple[Table, ...]
    prediction: Prediction | None
    text: str
