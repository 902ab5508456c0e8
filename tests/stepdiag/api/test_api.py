"""The public Python door: its names, its example, and the way from readings to files and from a log
to numbers."""

import doctest
import shutil
from dataclasses import replace

import numpy as np
import pytest

from stepdiag import api
from stepdiag.base.errors import DataError
from stepdiag.daq.records.events import Chunk
from testkit.cli import stepdiag
from testkit.exact.surveys import DATA
from testkit.recording import HEADER, START_NS, write_log
from testkit.timeline import survey_text

READINGS = DATA / "golden_stepdiag_rigidbody_FXYZ.csv"


def test_the_public_names_are_these():
    """A name that goes breaks somebody's program."""
    assert set(api.__all__) == {
        "Comparison",
        "Readings",
        "RecordedLog",
        "Result",
        "Verified",
        "certificate",
        "compare",
        "export",
        "frame",
        "load_angles",
        "load_readings",
        "load_result",
        "load_straightness",
        "make_readings",
        "plan",
        "plot_closure",
        "plot_field",
        "plot_functions",
        "read_log",
        "render_readings",
        "report",
        "save_result",
        "solve",
        "table",
        "verify",
        "verify_certificate",
    }


def test_the_example_of_the_documentation_is_true():
    tried = doctest.testmod(api, extraglobs={"READINGS": READINGS})
    assert (tried.failed, tried.attempted) == (0, 3)


def test_from_readings_to_files_and_their_effect(tmp_path):
    result = api.solve(api.load_readings(READINGS))
    api.save_result(result, tmp_path / "result.json")
    assert api.load_result(tmp_path / "result.json").to_json() == result.to_json()
    step_mm = float(result.volume.step_mm[0])
    report = api.export(result, "neutral", tmp_path / "files", step_mm=step_mm)
    assert report.files
    found = api.verify(
        result, [tmp_path / "files" / name for name in report.files if name.endswith(".csv")]
    )
    assert found.controller == "neutral"


def test_readings_in_metres_are_refused(tmp_path):
    """A file of other software with positions in metres: said by name, from Python and from the
    command line."""
    rows = [
        "setup,pass,stop,x_mm,y_mm,z_mm,reading_mm",
        *(f"ppp,1,{n},{n / 10},{n / 10},{n / 10},{n / 10}" for n in range(4)),
    ]
    (tmp_path / "metres.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    with pytest.raises(
        DataError,
        match=r"metres\.csv: x_mm, y_mm, z_mm: expected positions in mm, found a volume of 0\.3 "
        r"x 0\.3 x 0\.3",
    ):
        api.load_readings(tmp_path / "metres.csv")
    assert stepdiag("solve", tmp_path / "metres.csv").code == 3


def test_a_log_is_every_sample_of_its_raw_bytes(tmp_path):
    lines = [
        Chunk("laser", START_NS + n * 10_000_000, b"%d %.5f 0.9\r\n" % (n, n / 1000))
        for n in range(20)
    ]
    write_log(
        tmp_path / "a.mcap",
        lines,
        header=replace(HEADER, survey_text=survey_text(), run={"start": '{"hints": {}}'}),
    )
    log = api.read_log(tmp_path / "a.mcap")
    np.testing.assert_allclose(log.laser.position_mm, np.arange(20) / 1000)
    assert log.laser.arrival_ns.tolist() == [chunk.arrival_ns for chunk in lines]
    assert log.stops == ()


def test_certificate_of_a_result_is_computed_again(tmp_path):
    """Written from Python, it is that of the command to the byte, and holds until something below
    it changes."""
    shutil.copy(READINGS, tmp_path / "readings.csv")
    (tmp_path / "laboratory.toml").write_text(
        "[certificate]\nbegun = 2026-05-30\nended = 2026-05-31\n", encoding="utf-8"
    )
    assert (
        stepdiag("solve", tmp_path / "readings.csv", "--out", tmp_path / "result.json").code
        == 0
    )
    stated = {"laboratory": tmp_path / "laboratory.toml"}
    assert api.certificate(tmp_path / "result.json", tmp_path / "c.xml", **stated) == 3
    told = stepdiag(
        "certificate",
        tmp_path / "result.json",
        "--laboratory",
        stated["laboratory"],
        "--out",
        tmp_path / "d.xml",
    )
    assert (told.code, (tmp_path / "c.xml").read_bytes()) == (
        0,
        (tmp_path / "d.xml").read_bytes(),
    )
    assert api.verify_certificate(tmp_path / "c.xml", tmp_path).broken is None
    (tmp_path / "laboratory.toml").write_text(
        "[certificate]\nbegun = 2026-05-29\nended = 2026-05-31\n", encoding="utf-8"
    )
    assert (
        api.verify_certificate(tmp_path / "c.xml", tmp_path).broken.key == "custody-changed"
    )
