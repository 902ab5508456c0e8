"""The chain of custody from a certificate back to the logs: every link is checked, and every value
is computed again.

    certificate -> laboratory's file, result,      by SHA-256
                   files, report, certificates
                   of the equipment
    files       -> result                          by the hash that the files contain
    report      -> result, files, settings         rendered again, compared byte by byte
    PDF         -> report, certificate             printed again, compared byte by byte
    result      -> logs, or readings and the       by SHA-256
                   files beside them
    logs        -> result                          solved again
    result      -> certificate                     written again, compared element by element
"""

import hashlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from itertools import zip_longest
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple
from xml.etree import ElementTree as ET

from stepdiag.base.compensation import stated_in
from stepdiag.base.errors import DataError, StepdiagError
from stepdiag.base.files import as_text, read_bytes, read_text
from stepdiag.base.messages import Message, message
from stepdiag.base.result.members import Source
from stepdiag.base.result.result import Result, parse_result, result_in, same_result
from stepdiag.certificate.archival import archival, attached_in
from stepdiag.certificate.document import Link, certificate_of
from stepdiag.certificate.elements import DCC, SI, document
from stepdiag.certificate.reports import follows, is_rendered
from stepdiag.completion.completion import replay_judged, solve_logs
from stepdiag.completion.readings_file import Beside, solve_readings_file
from stepdiag.daq.recording.archive import digest, index_holds
from stepdiag.daq.recording.verdicts import WORDS, verdicts_in
from stepdiag.daq.survey.environment import parse_environment
from stepdiag.exporters.files.sets import SUMS, listed
from stepdiag.report.laboratory import read_laboratory, sha256_of
from stepdiag.report.output import printed

LOG, RESULT, LEFT, LABORATORY, FILE, REPORT = (
    "log",
    "result",
    "result_as_left",
    "laboratory",
    "file",
    "report",
)
READINGS, LETTERHEAD, PROFILE = "readings", "letterhead", "profile"
ONCE = (RESULT, LEFT, LABORATORY, LETTERHEAD, PROFILE)
"""Roles that occur at most once among the sources of a certificate."""
PERSONS = {name.partition(".")[0]: name for name in WORDS}
"""By role: the name of a file beside the logs that contains statements of persons or of the
solver."""
AS_LEFT = "_as_left"
NAMES_ITS_RESULT = "EXPORT_REPORT.txt"
"""The file of an export that contains the SHA-256 of the exported result."""
_SIGNATURE = "{http://www.w3.org/2000/09/xmldsig#}Signature"
MOST_FILES = 20_000
"""Largest number of files that are searched for the sources of a certificate."""


@dataclass(frozen=True, slots=True)
class BrokenLinkError(Exception):
    """A broken link in the chain of custody; the message describes the link."""

    link: Message


class Verified(NamedTuple):
    """Outcome of a verification: number of valid links and of valid values, and the first broken
    link, None if all links are valid.

    ``signed``: the certificate contains a signature, which this verification does not test.
    """

    links: int
    figures: int
    broken: Message | None
    signed: bool


def links_of(
    result: Path,
    stated: Path | None,
    *,
    left: Path | None = None,
    files: Sequence[tuple[str, Path]] = (),
) -> list[Link]:
    """Return the sources of a certificate: the result, its sources, the laboratory's file, and
    ``files``.

    Raises DataError for an export of another result, an export with a changed file, and a report
    that does not follow from these sources.
    """
    found = [
        (RESULT, result.name, sha256_of(result)),
        *_sources(result_in(result)),
        *_persons(result.parent, ""),
    ]
    if left is not None:
        of_left = [*_sources(result_in(left)), *_persons(left.parent, "")]
        found += [
            (LEFT, left.name, sha256_of(left)),
            *((role + AS_LEFT, name, sha) for role, name, sha in of_left),
        ]
    if stated is not None:
        found.append((LABORATORY, stated.name, sha256_of(stated)))
    held = {(role, path.name, sha256_of(path)): path for role, path in files}
    held |= {
        link: result.parent / link[1]
        for link in found
        if link[0] == READINGS and (result.parent / link[1]).is_file()
    }
    known = {RESULT: result, LEFT: left, LABORATORY: stated}
    held |= {link: path for link in found if (path := known.get(link[0])) is not None}
    links = found + [link for link in held if link not in found]
    try:
        _require_files(links, held)
    except BrokenLinkError as broken:
        raise DataError(
            result.name, expected=message("files-of-the-result"), found=broken.link
        ) from broken
    return links


def _follows(report: Path, held: Mapping[Link, Path]) -> bool:
    once = {role: path for (role, _, _), path in held.items() if role in ONCE}
    readings = next((path for (role, _, _), path in held.items() if role == READINGS), None)
    return follows(
        report, once, [path for (role, _, _), path in held.items() if role == FILE], readings
    )


def _persons(folder: Path, suffix: str) -> list[Link]:
    return [
        (role + suffix, name, sha256_of(folder / name))
        for role, name in PERSONS.items()
        if (folder / name).is_file()
    ]


def _sources(result: Result) -> list[Link]:
    return [(one.role, one.name, one.sha256) for one in result.sources or ()]


def accepted_in(folder: Path) -> list[str]:
    """Return the accepted findings of a survey's folder, each with the accepting person and the
    reason."""
    places = (
        (one, f"{one.setup}/{one.pass_number}" + ("" if one.stop is None else f"/{one.stop}"))
        for one in verdicts_in(folder).accepted
    )
    return [f"{place}: {one.code}; {one.name}: {one.reason}" for one, place in places]


def verify_certificate(certificate: Path, *folders: Path) -> Verified:
    """Verify a certificate against the files in folders; return the outcome with the first broken
    link.

    Raises DataError for a file that is not a certificate.
    """
    data = read_bytes(certificate)
    root = parsed(data, certificate.name)
    signed = root.find(_SIGNATURE) is not None
    links, figures = (
        custody_of(root),
        sum(
            1 for one in root.iter() if one.tag in (f"{{{SI}}}value", f"{{{SI}}}valueXMLList")
        ),
    )
    try:
        held = _held(links, folders)
        _walk(root, data, links, held, signed=signed)
    except BrokenLinkError as broken:
        return Verified(len(links), figures, broken.link, signed)
    return Verified(len(links), figures, None, signed)


def verify_archived(archived: Path, *folders: Path) -> Verified:
    """Return the outcome of `verify_certificate` for the certificate in a PDF. A PDF that differs
    from the printed report is a broken link.

    The report is printed again for the comparison. Another browser writes other bytes, so the
    message of this broken link contains both browsers. Raises DataError for a PDF without a
    certificate, DeviceError without a browser.
    """
    data = read_bytes(archived)
    name, certificate, printer = attached_in(data, archived.name)
    with TemporaryDirectory(prefix="stepdiag-verify-") as scratch:
        path = Path(scratch) / Path(name).name
        path.write_bytes(certificate)
        found = verify_certificate(path, *folders)
    if found.broken is not None:
        return found
    held = _held(custody_of(parsed(certificate, name)), folders)
    report = next(
        (
            path
            for (role, each, _), path in held.items()
            if role == REPORT and is_rendered(each)
        ),
        None,
    )
    if report is None:
        return found._replace(broken=message("custody-unnamed", role=REPORT))
    again = archival(printed(read_bytes(report)), name, certificate)
    here = attached_in(again, archived.name)[2]
    if again == data:
        return found
    other = message("custody-print", name=archived.name)
    return found._replace(
        broken=other
        if here == printer
        else message("custody-printer", name=archived.name, found=printer, here=here)
    )


def parsed(data: bytes, name: str) -> ET.Element:
    """Return the tree of a certificate. Raises DataError for a file that is not a certificate, and
    for a document type declaration, because this declaration can contain entities."""
    try:
        if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
            raise ET.ParseError("a document type")
        root = ET.fromstring(data)  # noqa: S314 - without a document type there are no entities
    except (ET.ParseError, ValueError, LookupError) as error:
        raise DataError(
            name, expected=message("certificate-xml"), found=str(error)
        ) from error
    if root.tag != f"{{{DCC}}}digitalCalibrationCertificate":
        raise DataError(name, expected=message("certificate-xml"), found=root.tag)
    return root


def custody_of(root: ET.Element) -> list[Link]:
    """Return role, name and SHA-256 of each source in a certificate."""
    notes = root.findall(
        f".//{{{DCC}}}metaData[@refType='stepdiag_custody']/{{{DCC}}}data/{{{DCC}}}quantity"
    )
    content = f"{{{DCC}}}content"
    return [
        (
            one.get("refType", "").removeprefix("stepdiag_"),
            one.findtext(f"{{{DCC}}}name/{content}") or "",
            one.findtext(f"{{{DCC}}}noQuantity/{content}") or "",
        )
        for one in notes
    ]


def _held(links: Sequence[Link], folders: Sequence[Path]) -> dict[Link, Path]:
    """Return, for each source of a certificate, its file in the folders. Raises BrokenLinkError for
    the first source without a file.
    """
    # Files in shallow folders come first, so an original comes before its copy in a replay.
    found = sorted(
        (path for folder in folders for path in folder.rglob("*")),
        key=lambda path: (len(path.parts), path),
    )
    files = [path for path in found if path.is_file()][:MOST_FILES]
    named = {name for _, name, _ in links}
    hashes = {
        path: _hash(path)
        for path in files
        if path.name in named or path.suffix in {".mcap", ".json", ".toml", ".csv"}
    }
    exported = {(name, sha) for role, name, sha in links if role == FILE}
    together = Counter(
        path.parent for path, sha in hashes.items() if (path.name, sha) in exported
    )
    held = {}
    for link in links:
        role, name, sha = link
        holding = [path for path, found in hashes.items() if found == sha and sha]
        if role == FILE:
            # Two exports can contain equal files.
            # The folder that contains the most files of the certificate is chosen.
            holding.sort(key=lambda path: -together[path.parent])
        path = next(
            (path for path in holding if path.name == name),
            None if _named_here_alone(role) else next(iter(holding), None),
        )
        if path is None and holding:
            raise BrokenLinkError(
                message("custody-renamed", role=role, name=name, found=holding[0].name)
            )
        if path is None:
            there = any(each.name == name for each in files)
            raise BrokenLinkError(
                message(
                    "custody-changed" if there else "custody-missing",
                    role=role,
                    name=name,
                    sha256=sha or "–",
                )
            )
        held[link] = path
    return held


def _named_here_alone(role: str) -> bool:
    return role in ONCE or role.removesuffix(AS_LEFT) in {*PERSONS, FILE, REPORT}


def _hash(path: Path) -> str:
    try:
        if ".mcap" in path.suffixes:
            return digest(path) if index_holds(path) else ""
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except (
        StepdiagError,
        OSError,
        ValueError,
    ):  # a file that cannot be read is no source
        return ""


def _walk(
    root: ET.Element,
    data: bytes,
    links: Sequence[Link],
    held: Mapping[Link, Path],
    *,
    signed: bool,
) -> None:
    by_role = {role: held[role, name, sha] for role, name, sha in links if role in ONCE}
    if RESULT not in by_role or len(by_role) != sum(role in ONCE for role, _, _ in links):
        raise BrokenLinkError(message("custody-unnamed", role=RESULT))
    for role, suffix in ((RESULT, ""), (LEFT, AS_LEFT)):
        for link in _persons(by_role[role].parent, suffix) if role in by_role else ():
            if link not in links:
                raise BrokenLinkError(message("custody-unnamed", role=link[1]))
    result = _again(by_role[RESULT], links, held, "")
    left = _again(by_role[LEFT], links, held, AS_LEFT) if LEFT in by_role else None
    accepted = next((held[link].parent for link in links if link[0] == "accepted"), None)
    try:
        stated = read_laboratory(by_role.get(LABORATORY))
        words = [] if accepted is None else accepted_in(accepted)
        again = certificate_of(result, stated, links, left=left, accepted=words)
    except StepdiagError as error:
        raise BrokenLinkError(message("custody-refused", what=str(error))) from error
    for signature in root.findall(_SIGNATURE):
        root.remove(signature)
    for one, other in zip_longest(_leaves(root), _leaves(again), fillvalue=NO_LEAF):
        if one != other:
            raise BrokenLinkError(
                message(
                    "custody-differs",
                    place=one.place or other.place,
                    found=one.text,
                    expected=other.text,
                )
            )
    _require_files(links, held)
    written = document(again)
    if written != data and (not signed or _canonical(written) != _canonical(data)):
        raise BrokenLinkError(message("custody-bytes"))


def _require_files(links: Sequence[Link], held: Mapping[Link, Path]) -> None:
    results = [sha for role, _, sha in links if role in (RESULT, LEFT)]
    files = {(name, sha) for role, name, sha in links if role == FILE}
    for link in links:
        role, name, _ = link
        if name == NAMES_ITS_RESULT and not any(
            sha.encode() in read_bytes(held[link]) for sha in results
        ):
            raise BrokenLinkError(message("custody-other-result", role=role, name=name))
        for each, sha in _listed(held[link]).items() if name == SUMS else ():
            if (each, sha) not in files and each in dict(files):
                raise BrokenLinkError(message("custody-set", name=each))
        if role == REPORT and is_rendered(name) and not _follows(held[link], held):
            raise BrokenLinkError(message("custody-report", name=name))


def _listed(sums: Path) -> dict[str, str]:
    try:
        return listed(sums.parent)
    except StepdiagError as error:
        raise BrokenLinkError(message("custody-refused", what=error.message)) from error


def _canonical(data: bytes) -> str:
    """Return a certificate in canonical XML without signatures: a signature changes its bytes but
    not its contents."""
    return ET.canonicalize(
        from_file=BytesIO(data), with_comments=True, exclude_tags=[_SIGNATURE]
    )


def _again(
    path: Path, links: Sequence[Link], held: Mapping[Link, Path], suffix: str
) -> Result:
    data = read_bytes(path)
    result = parse_result(
        as_text(data, path.name), path.name
    )  # the hash of the environment file is compared with the hash in the certificate
    sources = [
        Source(role=role.removesuffix(suffix), name=name, sha256=sha)
        for role, name, sha in _named(links, suffix)
    ]
    if tuple(sources) != (result.sources or ()) or not sources:
        raise BrokenLinkError(message("custody-sources", name=path.name))
    files = {
        (one.role, one.name): held[one.role + suffix, one.name, one.sha256] for one in sources
    }
    try:
        solved = _solved(result, sources, files)
    except StepdiagError as error:
        raise BrokenLinkError(message("custody-refused", what=str(error))) from error
    text = replace(
        solved, software=replace(solved.software, version=result.software.version)
    ).to_json()
    if not same_result(data, text.encode()):
        raise BrokenLinkError(message("custody-result", name=path.name))
    return result


def _named(links: Sequence[Link], suffix: str) -> Iterator[Link]:
    for link in links:
        role = link[0].removesuffix(AS_LEFT)
        if role not in {*ONCE, *PERSONS, FILE, REPORT} and link[0].endswith(AS_LEFT) == bool(
            suffix
        ):
            yield link


def _solved(
    result: Result, sources: Sequence[Source], files: Mapping[tuple[str, str], Path]
) -> Result:
    of = {one.role: files[one.role, one.name] for one in sources}
    if LOG in of:
        stated = (
            parse_environment(read_text(of["environment"]), of["environment"].name)
            if "environment" in of
            else None
        )
        logs = [files[one.role, one.name] for one in sources if one.role == LOG]
        return replace(
            solve_logs(replay_judged(logs), result.method, stated)[0], sources=result.sources
        )
    if "readings" not in of or "run" in of:
        raise DataError(
            result.source, expected=message("custody-solvable"), found=", ".join(of)
        )
    beside = Beside(
        angles=of.get("angles"),
        straightness=of.get("straightness"),
        uncertainty=of.get("uncertainty"),
        tolerance=of.get("tolerance"),
    )
    trials = 0 if result.monte_carlo is None else result.monte_carlo.trials
    solved = solve_readings_file(
        of["readings"], beside, method=result.method, chain=result.chain, monte_carlo=trials
    )
    # The readings do not contain a person's statement about the compensation.
    # The files named in this statement can have other names in their present folder.
    return replace(
        solved,
        survey=None if result.survey is None else stated_in(result).facts(),
        sources=result.sources,
    )


class Leaf(NamedTuple):
    """An element of an XML document: its place (with the attributes of its parents), its text, and
    its qualified name."""

    place: str
    text: str
    tag: str


NO_LEAF = Leaf("", "", "")


def _leaves(root: ET.Element) -> Iterator[Leaf]:
    waiting = [(root, "")]
    while waiting:
        node, at = waiting.pop()
        here = f"{at}/{node.tag.rpartition('}')[2]}"
        attributes = " ".join(f"{name}={value}" for name, value in sorted(node.items()))
        place = f"{here}[{attributes}]" if attributes else here
        tail = (node.tail or "").strip()
        yield Leaf(
            place, (node.text or "").strip() + (f" | {tail}" if tail else ""), node.tag
        )
        waiting += [(child, place) for child in reversed(node)]
