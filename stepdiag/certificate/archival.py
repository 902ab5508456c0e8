"""The printed report as PDF/A-3 (ISO 19005-3, level B) with the certificate attached, made by
pikepdf (``stepdiag[certificate]``).

A PDF printed by Chromium contains all fonts and no script. Such a PDF lacks three parts of PDF/A:
the colour profile (sRGB), the metadata with part and level, and the entry that relates the
attachment to the document (AFRelationship). The date of printing is removed, so the same report and
certificate give the same bytes. The requirements come from public sources, not from the text of ISO
19005-3.
"""

import io
import re
from typing import Any

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.messages import message

_ENDED = re.compile(rb"<dcc:endPerformanceDate>(\d{4})-(\d\d)-(\d\d)<")
_NODE = re.compile(rb"\(node(\d{8})\)")
"""Pattern of the names of table cells in a PDF by Chromium: their numbers differ from print to
print."""
_PROFILE_DATE = slice(24, 36)
"""Bytes of an ICC colour profile that contain its date."""


def _library() -> Any:
    try:
        import pikepdf
    except ImportError as error:
        raise UsageError(
            "--pdf", expected="stepdiag[certificate]", found=str(error)
        ) from error
    return pikepdf


def archival(printed: bytes, name: str, certificate: bytes) -> bytes:
    """Return a printed PDF as PDF/A-3 with a certificate attached under its file name. Raises
    DataError for a printed PDF without one of its fonts."""
    pikepdf = _library()
    numbers = {
        number: b"(node%08d)" % rank
        for rank, number in enumerate(sorted(set(_NODE.findall(printed))))
    }
    with pikepdf.open(
        io.BytesIO(_NODE.sub(lambda found: numbers[found[1]], printed))
    ) as document:
        described = [
            one
            for one in document.objects
            if isinstance(one, pikepdf.Dictionary) and one.get("/Type") == "/FontDescriptor"
        ]
        missing = [
            str(one.FontName)
            for one in described
            if not any(f"/FontFile{kind}" in one for kind in ("", "2", "3"))
        ]
        if missing:
            raise DataError(
                "PDF", expected=message("fonts-embedded"), found=", ".join(missing)
            )
        for each in {"/CreationDate", "/ModDate"} & set(document.docinfo.keys()):
            del document.docinfo[each]
        document.Root.OutputIntents = [_intent(document)]
        ended = _ENDED.search(certificate)
        document.attachments[name] = pikepdf.AttachedFileSpec(
            document,
            certificate,
            filename=name,
            description=name,
            mime_type="text/xml",
            relationship=pikepdf.Name.Alternative,
            mod_date="" if ended is None else f"D:{b''.join(ended.groups()).decode()}000000Z",
        )
        document.Root.AF = [document.attachments[name].obj]
        with document.open_metadata(set_pikepdf_as_editor=False) as metadata:
            metadata.load_from_docinfo(document.docinfo)
            metadata["pdfaid:part"], metadata["pdfaid:conformance"] = "3", "B"
        written = io.BytesIO()
        document.save(written, force_version="1.7", deterministic_id=True)
    return written.getvalue()


def _intent(document: Any) -> Any:
    from pikepdf import Dictionary, Name
    from PIL.ImageCms import ImageCmsProfile, createProfile

    profile = bytearray(ImageCmsProfile(createProfile("sRGB")).tobytes())
    profile[_PROFILE_DATE] = bytes([7, 208, 0, 1, 0, 1]).ljust(
        12, b"\0"
    )  # the first day of 2000 in place of the present date: the same colour profile in every file
    return Dictionary(
        Type=Name.OutputIntent,
        S=Name.GTS_PDFA1,
        OutputConditionIdentifier="sRGB",
        Info="sRGB",
        DestOutputProfile=document.make_stream(bytes(profile), N=3),
    )


def attached_in(archived: bytes, name: str) -> tuple[str, bytes, str]:
    """Return the name and the bytes of the only certificate in a PDF, and the name of the program
    that printed the PDF. Raises DataError unless the PDF contains exactly one certificate."""
    pikepdf = _library()
    try:
        with pikepdf.open(io.BytesIO(archived)) as document:
            producer = str(document.docinfo.get("/Producer", ""))
            ((attached, spec),) = document.attachments.items()
            return attached, spec.get_file().read_bytes(), producer
    except (pikepdf.PdfError, ValueError, KeyError) as error:
        raise DataError(
            name, expected=message("pdf-with-certificate"), found=str(error)
        ) from error
