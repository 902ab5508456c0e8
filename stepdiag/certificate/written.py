"""Writing of a certificate with the SHA-256 of its sources; optionally with a signature and the PDF
for the archive."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from stepdiag.base.files import read_bytes, write_together
from stepdiag.base.result.result import Result, result_in
from stepdiag.certificate.archival import archival
from stepdiag.certificate.custody import LETTERHEAD, PROFILE, REPORT, accepted_in, links_of
from stepdiag.certificate.document import certificate_of
from stepdiag.certificate.elements import document
from stepdiag.certificate.signature import signed
from stepdiag.report.laboratory import read_laboratory
from stepdiag.report.output import printed


@dataclass(frozen=True, slots=True, kw_only=True)
class Beside:
    """Sources of a certificate besides its result: files of exports, the laboratory's file, the
    report with its settings, the result after loading; and the key of the signature with its X.509
    certificate."""

    laboratory: Path | None = None
    files: Sequence[Path] = ()
    report: Path | None = None
    letterhead: Path | None = None
    profile: Path | None = None
    left: Path | None = None
    key: Path | None = None
    key_certificate: Path | None = None


def write_certificate(
    result: Path, found: Result, out: Path, beside: Beside, pdf: Path | None = None
) -> int:
    """Write the certificate of the file ``result``; return the number of sources in the
    certificate. The argument ``found`` is the result that this file contains. With ``pdf``, also
    write the printed report with the certificate attached.

    Raises UsageError for an existing certificate, DataError for files that do not belong to the
    result.
    """
    named = (
        (REPORT, beside.report),
        (LETTERHEAD, beside.letterhead),
        (PROFILE, beside.profile),
    )
    given = [
        *(("file", path) for path in beside.files),
        *((role, path) for role, path in named if path is not None),
    ]
    links = links_of(result, beside.laboratory, left=beside.left, files=given)
    left = None if beside.left is None else result_in(beside.left)
    accepted = (
        accepted_in(result.parent) if any(role == "accepted" for role, _, _ in links) else ()
    )
    data = document(
        certificate_of(
            found, read_laboratory(beside.laboratory), links, left=left, accepted=accepted
        )
    )
    if beside.key is not None and beside.key_certificate is not None:
        data = signed(data, beside.key, beside.key_certificate)
    written = {out: data}
    if pdf is not None and beside.report is not None:
        written[pdf] = archival(printed(read_bytes(beside.report)), out.name, data)
    write_together(written, over=False)
    return len(links)
