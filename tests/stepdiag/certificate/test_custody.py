"""The chain of custody: what is true holds, and every forgery is named by the first link that does
not."""

import hashlib
import json
import re
import shutil
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import msgspec
import numpy as np
import pytest
from lxml import etree

from stepdiag.base.errors import DataError
from stepdiag.base.files import write_hashed
from stepdiag.base.readings.readings import render_readings
from stepdiag.base.result.members import Facts
from stepdiag.base.result.result import parse_result
from stepdiag.certificate import custody
from stepdiag.certificate.custody import custody_of, parsed, verify_certificate
from stepdiag.certificate.elements import document
from stepdiag.daq.passes.doubt import Acceptance
from stepdiag.daq.recording.verdicts import WORDS
from stepdiag.page.downloads import downloads_of
from testkit.cli import stepdiag
from testkit.exact.surveys import Bench
from testkit.examples import spread
from testkit.fleets import finished_survey
from testkit.forgeries import rehashed, signing_key, solve_once

LABORATORY = (
    '[certificate]\nbegun = 2026-05-30\nended = 2026-05-31\n[laboratory]\nname = "Lab"\n'
)
TOLERANCE = (
    "[tolerance]\nvolumetric_rms_um = 20.0\nsquareness_urad = "
    "30.0\n[tolerance.functions_um]\nEYX = 20.0\n"
)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with readings, result, files, laboratory's file and certificate."""
    folder = tmp_path_factory.mktemp("custody")
    readings = Bench(seed=3, increments=2).survey(passes=(1, 2), joined=True)
    (folder / "readings.csv").write_text(render_readings(readings), encoding="utf-8")
    (folder / "laboratory.toml").write_text(LABORATORY, encoding="utf-8")
    (folder / "tolerance.toml").write_text(TOLERANCE, encoding="utf-8")
    (folder / "table.ini").write_text("CHANDATA(1)\n", encoding="utf-8")
    assert (
        stepdiag(
            "solve",
            folder / "readings.csv",
            "--tolerance",
            folder / "tolerance.toml",
            "--out",
            folder / "result.json",
        ).code
        == 0
    )
    assert certify(folder).code == 0
    return folder


def certify(folder: Path):
    return stepdiag(
        "certificate",
        folder / "result.json",
        folder / "table.ini",
        "--laboratory",
        folder / "laboratory.toml",
        "--out",
        folder / "c.xml",
    )


@pytest.fixture(autouse=True)
def solved_once(monkeypatch: pytest.MonkeyPatch) -> None:
    solve_once(monkeypatch)


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    shutil.copytree(made, tmp_path / "case")
    return tmp_path / "case"


def verdict(folder: Path) -> str:
    found = verify_certificate(folder / "c.xml", folder)
    return "" if found.broken is None else found.broken.key


def test_what_is_true_holds(folder: Path) -> None:
    told = stepdiag("verify", folder / "c.xml")
    assert (told.code, "is correct: 5 links" in told.out) == (0, True)
    roles = [
        role for role, _, _ in custody_of(parsed((folder / "c.xml").read_bytes(), "c.xml"))
    ]
    assert roles == ["result", "readings", "tolerance", "laboratory", "file"]


def test_files_may_stand_elsewhere_under_other_names(folder: Path, tmp_path: Path) -> None:
    (folder / "below").mkdir()
    (folder / "readings.csv").rename(folder / "below" / "spring.csv")
    shutil.move(folder / "c.xml", tmp_path / "c.xml")
    assert stepdiag("verify", tmp_path / "c.xml", "--custody", folder).code == 0


def altered(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8", newline="")


def _result_prettier(folder: Path) -> None:
    """C0Y in the result, its hash in the certificate, and the figure in the certificate."""
    path = folder / "result.json"
    before, document = path.read_bytes(), json.loads(path.read_text(encoding="utf-8"))
    was = document["squareness"]["C0Y"]["value"]
    path.write_text(
        path.read_text(encoding="utf-8").replace(
            f'"value": {was}', f'"value": {was / 2:.6f}'
        ),
        encoding="utf-8",
        newline="",
    )
    rehashed(folder, before, "result.json")


def _readings_prettier(folder: Path) -> None:
    path = folder / "readings.csv"
    before = path.read_bytes()
    lines = path.read_text(encoding="utf-8").splitlines()
    cells = lines[9].split(",")
    cells[6] = str(float(cells[6]) + 0.01)
    lines[9] = ",".join(cells)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    result = (folder / "result.json").read_bytes()
    rehashed(folder, before, "readings.csv")
    rehashed(folder, result, "result.json")


def _tolerance_wider(folder: Path) -> None:
    before, result = (
        (folder / "tolerance.toml").read_bytes(),
        (folder / "result.json").read_bytes(),
    )
    altered(folder / "tolerance.toml", "30.0", "90.0")
    rehashed(folder, before, "tolerance.toml")
    rehashed(folder, result, "result.json")


def _another_program(folder: Path) -> None:
    before = (folder / "result.json").read_bytes()
    altered(folder / "result.json", '"name": "stepdiag"', '"name": "LaserCal"')
    rehashed(folder, before, "result.json")
    altered(folder / "c.xml", ">stepdiag<", ">LaserCal<")


def _another_machine(folder: Path) -> None:
    """A serial number in a result of readings, in which no machine stands."""
    path = folder / "result.json"
    before, found = path.read_bytes(), parse_result(path.read_text(encoding="utf-8"))
    path.write_text(
        replace(found, survey=Facts(machine_serial="4711")).to_json(),
        encoding="utf-8",
        newline="",
    )
    rehashed(folder, before, "result.json")
    altered(folder / "c.xml", "<dcc:value>not stated<", "<dcc:value>4711<")


def _source_left_out(folder: Path) -> None:
    root = etree.fromstring((folder / "c.xml").read_bytes())
    (note,) = root.findall(".//{https://ptb.de/dcc}quantity[@refType='stepdiag_readings']")
    note.getparent().remove(note)
    (folder / "c.xml").write_bytes(
        etree.tostring(root, encoding="utf-8", xml_declaration=True)
    )


def _figure_from_another_certificate(folder: Path) -> None:
    root = etree.fromstring((folder / "c.xml").read_bytes())
    first, second = root.findall(".//{https://ptb.de/dcc}result")[:2]
    one, other = (
        each.findall(".//{https://ptb.de/si}valueXMLList")[-1] for each in (first, second)
    )
    one.text, other.text = other.text, one.text
    (folder / "c.xml").write_bytes(
        etree.tostring(root, encoding="utf-8", xml_declaration=True)
    )


FORGERIES: dict[str, tuple[Callable[[Path], object], str]] = {
    "a figure in the certificate": (
        lambda f: altered(f / "c.xml", "<dcc:conformity>pass", "<dcc:conformity>fail"),
        "custody-differs",
    ),
    "a unit in the certificate": (
        lambda f: altered(f / "c.xml", r"\radian", r"\metre"),
        "custody-differs",
    ),
    "k in the certificate": (
        lambda f: altered(f / "c.xml", "coverageFactor>2<", "coverageFactor>3<"),
        "custody-differs",
    ),
    "two functions exchanged": (_figure_from_another_certificate, "custody-differs"),
    "another laboratory": (
        lambda f: altered(f / "c.xml", "<dcc:content>Lab<", "<dcc:content>Bal<"),
        "custody-differs",
    ),
    "the laboratory's file": (
        lambda f: altered(f / "laboratory.toml", "Lab", "Bal"),
        "custody-changed",
    ),
    "a file for the control": (
        lambda f: altered(f / "table.ini", "(1)", "(2)"),
        "custody-changed",
    ),
    "the result alone": (
        lambda f: altered(f / "result.json", '"value": ', '"value":  '),
        "custody-changed",
    ),
    "the result with its hash": (_result_prettier, "custody-result"),
    "the readings alone": (
        lambda f: altered(f / "readings.csv", "ppp,1,1,", "ppp,1, 1,"),
        "custody-changed",
    ),
    "the readings with all hashes": (_readings_prettier, "custody-result"),
    "the tolerance with all hashes": (_tolerance_wider, "custody-result"),
    "another program": (_another_program, "custody-result"),
    "another machine": (_another_machine, "custody-result"),
    "a source left out": (_source_left_out, "custody-sources"),
    "the readings gone": (lambda f: (f / "readings.csv").unlink(), "custody-missing"),
    "a value moved behind its element": (
        lambda f: altered(f / "c.xml", ">pass</dcc:conformity>", "></dcc:conformity>pass"),
        "custody-differs",
    ),
    "a name of the result": (
        lambda f: altered(
            f / "c.xml", "<dcc:content>result.json<", "<dcc:content>pesult.json<"
        ),
        "custody-renamed",
    ),
    "a name of a file": (
        lambda f: altered(f / "c.xml", "<dcc:content>table.ini<", "<dcc:content>other.ini<"),
        "custody-missing",
    ),
    "a remark for people": (
        lambda f: altered(f / "c.xml", "<dcc:items>", "<dcc:items><!-- -->"),
        "custody-bytes",
    ),
}


@pytest.mark.parametrize("name", FORGERIES)
def test_forgery_is_named_by_its_link(name: str, folder: Path) -> None:
    forge, link = FORGERIES[name]
    forge(folder)
    assert verdict(folder) == link
    told = stepdiag("verify", folder / "c.xml")
    assert (told.code, told.out.startswith("WRONG c.xml: ")) == (5, True)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Solve once for all changes of one certificate; each is read, its links hashed, and written
    again as always."""
    again, known = custody._again, {}

    def once(path, links, held, suffix):
        key = (hashlib.sha256(path.read_bytes()).hexdigest(), tuple(links))
        if key not in known:
            known[key] = again(path, links, held, suffix)
        return known[key]

    monkeypatch.setattr(custody, "_again", once)


def test_export_report_of_another_result_is_refused(folder: Path, tmp_path: Path) -> None:
    """A certificate names no report of an export, and no report, that was made from another result;
    one that was forged so is found."""
    exports = tmp_path / "exports"
    told = stepdiag(
        "export",
        folder / "result.json",
        "--controller",
        "linuxcnc",
        "--step-mm",
        "50",
        "--out",
        exports,
    )
    assert told.code == 0, told.refusal
    again = (
        "certificate",
        folder / "result.json",
        exports,
        "--laboratory",
        folder / "laboratory.toml",
        "--out",
        folder / "e.xml",
    )
    assert stepdiag(*again).code == 0
    shutil.copytree(exports, folder / "exports")
    assert verify_certificate(folder / "e.xml", folder).broken is None
    report = folder / "exports" / "EXPORT_REPORT.txt"
    before = report.read_bytes()
    table = exports / "READ_BACK.ngc"
    whole = table.read_bytes()
    table.write_bytes(whole + b"\n")
    told = stepdiag(*again[:-1], tmp_path / "f.xml")
    assert (told.code, "READ_BACK.ngc: the hash of this file" in str(told.refusal)) == (
        3,
        True,
    ), told.refusal
    table.write_bytes(whole)
    altered(
        report, hashlib.sha256((folder / "result.json").read_bytes()).hexdigest(), "0" * 64
    )
    (exports / "EXPORT_REPORT.txt").write_bytes(report.read_bytes())
    (folder / "e.xml").rename(folder / "c.xml")
    assert stepdiag(*again).code == 3
    rehashed(folder, before, "exports/EXPORT_REPORT.txt")
    assert verdict(folder) == "custody-other-result"
    report.write_bytes(before + b"loaded\n")
    rehashed(
        folder, (exports / "EXPORT_REPORT.txt").read_bytes(), "exports/EXPORT_REPORT.txt"
    )
    assert verdict(folder) == "custody-set"


def test_result_named_twice_is_refused(folder: Path) -> None:
    root = etree.fromstring((folder / "c.xml").read_bytes())
    (note,) = root.findall(".//{https://ptb.de/dcc}quantity[@refType='stepdiag_result']")
    note.addnext(etree.fromstring(etree.tostring(note)))
    (folder / "c.xml").write_bytes(
        etree.tostring(root, encoding="utf-8", xml_declaration=True)
    )
    assert verdict(folder) == "custody-unnamed"


@pytest.mark.usefixtures("quick")
def test_every_single_change_is_refused(folder: Path) -> None:
    """Every text and every attribute of the certificate, one by one: figure, unit, k, name, hash,
    date, statement. Of places of one kind the first three: the nodes of a function, say."""
    root = etree.fromstring((folder / "c.xml").read_bytes())
    tree, kinds, count = root.getroottree(), Counter(), 0
    for node in root.iter():
        for where in [None, *node.keys()]:
            was = node.text if where is None else node.get(where)
            kind = re.sub(r"\[\d+\]", "", tree.getpath(node)), where
            if not (was or "").strip() or kinds[kind] == 3:
                continue
            kinds[kind] += 1
            last = was[-1]
            new = was[:-1] + ("8" if last != "8" else "9") if last.isdigit() else was + "x"
            _put(node, where, new)
            (folder / "c.xml").write_bytes(
                etree.tostring(root, encoding="utf-8", xml_declaration=True)
            )
            assert verdict(folder), f"{node.tag} {where}: {was} -> {new}"
            _put(node, where, was)
            count += 1
    assert count > 200


def _put(node, where, value) -> None:
    if where is None:
        node.text = value
    else:
        node.set(where, value)


@pytest.mark.usefixtures("quick")
def test_every_flipped_bit_is_found(folder: Path) -> None:
    """Any bit of certificate, result, readings, tolerance, laboratory's file and table."""
    rng, names = (
        np.random.default_rng(46),
        (
            "c.xml",
            "result.json",
            "readings.csv",
            "tolerance.toml",
            "laboratory.toml",
            "table.ini",
        ),
    )
    for turn in spread(range(300), 10):
        path = folder / names[turn % len(names)]
        whole = path.read_bytes()
        flipped = bytearray(whole)
        flipped[int(rng.integers(len(flipped)))] ^= 1 << int(rng.integers(8))
        path.write_bytes(flipped)
        try:
            assert verdict(folder), f"{path.name}, turn {turn}"
        except DataError:
            assert path.name == "c.xml"
        path.write_bytes(whole)
    assert verdict(folder) == ""


@pytest.mark.parametrize(
    "data", [b"", b"<html/>", b'<!DOCTYPE x [<!ENTITY a "b">]><x>&a;</x>', b"\xff\xfe<"]
)
def test_other_files_are_no_certificate(data: bytes, tmp_path: Path) -> None:
    (tmp_path / "c.xml").write_bytes(data)
    with pytest.raises(DataError):
        verify_certificate(tmp_path / "c.xml", tmp_path)


def test_result_of_unknown_origin_has_no_chain(folder: Path) -> None:
    """A result of an older version names no sources: its certificate is written, and `verify` names
    what is missing."""
    path = folder / "result.json"
    document = json.loads(path.read_text(encoding="utf-8"))
    del document["sources"]
    path.write_text(json.dumps(document), encoding="utf-8")
    (folder / "result.json.sha256").unlink()  # of a result that another program wrote
    (folder / "c.xml").unlink()
    assert certify(folder).code == 0
    assert verdict(folder) == "custody-sources"


def test_survey_after_loading_is_in_the_chain(folder: Path) -> None:
    readings = Bench(seed=3, increments=2, errors_times=0.2).survey(
        passes=(1, 2), joined=True
    )
    (folder / "after.csv").write_text(render_readings(readings), encoding="utf-8")
    assert stepdiag("solve", folder / "after.csv", "--out", folder / "after.json").code == 0
    (folder / "c.xml").unlink()
    told = stepdiag(
        "certificate",
        folder / "result.json",
        "--as-left",
        folder / "after.json",
        "--laboratory",
        folder / "laboratory.toml",
        "--out",
        folder / "c.xml",
    )
    assert told.code == 0
    assert verdict(folder) == ""
    (folder / "after.csv").write_text("changed", encoding="utf-8")
    assert verdict(folder) == "custody-changed"


@pytest.mark.parametrize(
    ("changed", "code"),
    [({}, 0), ({"machine": "Mill 8"}, 3), ({"ended": "2020-01-01 10:00 UTC"}, 3)],
    ids=["alike", "machine", "day"],
)
def test_survey_after_loading_is_of_this_machine_and_later(
    folder: Path, changed: dict[str, str], code: int
) -> None:
    found = parse_result((folder / "result.json").read_text(encoding="utf-8"))
    for name, facts in (
        ("result.json", {"ended": "2026-05-31 10:00 UTC"}),
        ("after.json", {"ended": "2026-06-01 10:00 UTC", **changed}),
    ):
        of_machine = replace(found, survey=Facts(**{"machine": "Mill 7", **facts}))
        for each in (name, f"{name}.sha256"):
            (folder / each).unlink(missing_ok=True)
        write_hashed(folder / name, of_machine.to_json())
    told = stepdiag(
        "certificate",
        folder / "result.json",
        "--as-left",
        folder / "after.json",
        "--laboratory",
        folder / "laboratory.toml",
        "--out",
        folder / "d.xml",
    )
    assert (told.code, (folder / "d.xml").exists()) == (code, code == 0), told.refusal


def test_signature_is_checked_and_figures_behind_it_too(folder: Path) -> None:
    key, certificate = signing_key(folder)
    (folder / "c.xml").unlink()
    told = stepdiag(
        "certificate",
        folder / "result.json",
        "--laboratory",
        folder / "laboratory.toml",
        "--key",
        key,
        "--key-certificate",
        certificate,
        "--out",
        folder / "c.xml",
    )
    assert told.code == 0
    schema = etree.XMLSchema(
        etree.parse(Path(__file__).parents[2] / "data" / "dcc" / "v3.3.0" / "dcc.xsd")
    )
    assert schema.validate(etree.parse(folder / "c.xml")), schema.error_log
    assert stepdiag("verify", folder / "c.xml", "--key-certificate", certificate).code == 0
    altered(folder / "c.xml", "coverageFactor>2<", "coverageFactor>3<")
    assert stepdiag("verify", folder / "c.xml", "--key-certificate", certificate).code == 3
    assert stepdiag("verify", folder / "c.xml").code == 5


def test_signature_hides_nothing(folder: Path) -> None:
    """A remark, a style sheet, an element in a second signature, a signature below another element,
    the signature of another key."""
    key, certificate = signing_key(folder)
    (folder / "c.xml").unlink()
    command = (
        "certificate",
        folder / "result.json",
        "--laboratory",
        folder / "laboratory.toml",
        "--out",
        folder / "c.xml",
    )
    assert stepdiag(*command, "--key", key, "--key-certificate", certificate).code == 0
    told = stepdiag("verify", folder / "c.xml")
    assert (told.code, "the signature of the certificate was not checked" in told.out) == (
        0,
        True,
    )
    whole = (folder / "c.xml").read_bytes()
    altered(folder / "c.xml", "<dcc:items>", "<dcc:items><!-- passed -->")
    assert verdict(folder) == "custody-bytes"
    (folder / "c.xml").write_bytes(
        whole.replace(b"<dcc:digital", b'<?xml-stylesheet href="other.xsl"?><dcc:digital', 1)
    )
    assert verdict(folder) == "custody-bytes"
    (folder / "c.xml").write_bytes(
        whole.decode().replace("UTF-8", "UTF-16", 1).encode("utf-16")
    )
    assert verdict(folder) == "", "the same in another encoding"
    root = etree.fromstring(whole)
    root.find(".//{https://ptb.de/dcc}items").append(root[-1])
    (folder / "c.xml").write_bytes(
        etree.tostring(root, encoding="utf-8", xml_declaration=True)
    )
    assert verdict(folder) == "custody-differs"
    (folder / "forger").mkdir()
    other, of_other = signing_key(folder / "forger")
    (folder / "c.xml").unlink()
    assert stepdiag(*command, "--key", other, "--key-certificate", of_other).code == 0
    assert stepdiag("verify", folder / "c.xml", "--key-certificate", certificate).code == 3
    assert stepdiag("verify", folder / "c.xml", "--key-certificate", of_other).code == 0


def test_logs_are_solved_again(tmp_path: Path) -> None:
    """A recorded survey: its result rests on its logs, packed or not."""
    folder = finished_survey(tmp_path)
    told = stepdiag("certificate", folder, "--out", tmp_path / "c.xml")
    assert told.code == 0, told.refusal
    found = verify_certificate(tmp_path / "c.xml", tmp_path)
    assert (found.broken, found.links) == (None, 2)
    log = next(folder.glob("*.mcap"))
    whole = log.read_bytes()
    log.rename(folder / "renamed.mcap")
    assert verdict(tmp_path) == "", "a log is known by what it says"
    (folder / "renamed.mcap").rename(log)
    data_end = whole.rindex(b"\x0f\x04\0\0\0\0\0\0\0")
    for data in (
        whole[:-200],
        _flip(whole, len(whole) - 40),
        _flip(whole, data_end, 16),
        _flip(whole, data_end + 1, 4),
    ):
        log.write_bytes(data)
        assert verdict(tmp_path) == "custody-changed"


def test_certificate_of_a_finished_survey_is_written_beside_it(tmp_path: Path) -> None:
    """What a person at the page asks for: report, exports and the laboratory's file are in it; a
    second one stands beside the first."""
    folder = finished_survey(tmp_path)
    (tmp_path / "laboratory.toml").write_text(
        '[laboratory]\nname = "Lab"\n', encoding="utf-8"
    )
    for name in ("certificate.xml", "certificate-2.xml"):
        told = stepdiag("complete", "--certificate", folder)
        assert told.code == 0, told.refusal
        found = verify_certificate(folder / name, tmp_path)
        assert (found.broken, found.links) == (None, 4)
    assert [
        one.kind for one in downloads_of(folder) if one.name.startswith("certificate")
    ] == ["certificate"] * 4
    altered(folder / "certificate.html", "</main>", "<p>It conforms.</p></main>")
    assert (
        verify_certificate(folder / "certificate.xml", tmp_path).broken.key
        == "custody-changed"
    )


def _flip(data: bytes, at: int, bits: int = 1) -> bytes:
    return data[:at] + bytes([data[at] ^ bits]) + data[at + 1 :]


def test_words_of_persons_are_links(tmp_path: Path) -> None:
    """A finding that a person accepted beside the logs, with name and reason: in the chain to the
    bit, and not to be left out."""
    folder = finished_survey(tmp_path)
    word = Acceptance(
        setup="ppp",
        pass_number=1,
        stop=3,
        code="stop-recovered",
        taken_ns=1,
        reason="seen",
        name="Mo",
        time_s=1.0,
    )
    (folder / "accepted.jsonl").write_bytes(msgspec.json.encode(word) + b"\n")
    assert stepdiag("certificate", folder, "--out", tmp_path / "c.xml").code == 0
    assert verdict(tmp_path) == ""
    root = ET.fromstring((tmp_path / "c.xml").read_bytes())
    assert "ppp/1/3: stop-recovered; Mo: seen" in "".join(root.itertext())
    for parent, left_out in [
        (node, each)
        for node in root.iter()
        for each in node
        if each.get("refType") == "stepdiag_accepted"
    ]:
        parent.remove(left_out)
    whole = (tmp_path / "c.xml").read_bytes()
    (tmp_path / "c.xml").write_bytes(document(root))
    assert verdict(tmp_path) == "custody-unnamed"
    (tmp_path / "c.xml").write_bytes(whole)
    (folder / "accepted.jsonl").write_bytes(b"\n")
    assert verdict(tmp_path) == "custody-changed"


@pytest.mark.parametrize("name", WORDS)
def test_words_that_the_certificate_does_not_name_are_found(
    name: str, tmp_path: Path
) -> None:
    """Beside the logs they count, whenever they were written."""
    folder = finished_survey(tmp_path)
    assert stepdiag("certificate", folder, "--out", tmp_path / "c.xml").code == 0
    (folder / "replay").mkdir()
    shutil.copy(folder / "result.json", folder / "replay" / "result.json")
    (folder / name).write_text("\n", encoding="utf-8")
    assert verdict(tmp_path) == "custody-unnamed"
