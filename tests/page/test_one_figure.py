"""One survey, read wherever a person may read it: the same interval, to the last digit."""

import json
import re
from datetime import date
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from stepdiag.base.readings.readings import render_readings
from stepdiag.completion.completion import Completed
from stepdiag.exporters.export.export import export
from stepdiag.report.completed import write_completed_report
from stepdiag.solver.methods.solve import solve
from testkit.browser import Watched
from testkit.cli import stepdiag
from testkit.exact.surveys import Bench
from testkit.hostile.foreign_logs import with_survey
from testkit.played import served
from testkit.timeline import survey_text

pytestmark = pytest.mark.page
AFTER = {
    "en": re.compile(
        r"predicted:\s*(?P<low>[\d.]+) to (?P<high>[\d.]+) µm\s+\(rms, k = 2\), largest "
        r"vector up to (?P<largest>[\d.]+) µm"
    ),
    "de": re.compile(
        r"vorhergesagt:\s*(?P<low>[\d,]+) bis (?P<high>[\d,]+) µm\s+\(Effektivwert, k = 2\), "
        r"größter Vektor bis (?P<largest>[\d,]+) µm"
    ),
}
EXPORTED = re.compile(
    r"without rigid motion, after +(?P<low>[\d.]+) to (?P<high>[\d.]+) +up to (?P<largest>[\d.]+)"
)
REPORTED = re.compile(
    r"rms \(k = 2\) / µm [\d.]+ … [\d.]+ (?P<low>[\d.]+) … (?P<high>[\d.]+) .*?largest vector / "
    r"µm ≤ [\d.]+ ≤ (?P<largest>[\d.]+)"
)
"""The row of the table of figures: as found, predicted, as left."""
VERIFIED = re.compile(
    r"rms, without rigid motion\D+[\d.]+ to [\d.]+\D+(?P<low>[\d.]+) to (?P<high>[\d.]+)"
)
VERIFIED_LARGEST = re.compile(
    r"largest, without rigid motion\D+up to [\d.]+\D+up to (?P<largest>[\d.]+)"
)


def finished(folder: Path, *, angles: bool) -> Path:
    """Return the folder of a survey that was solved, exported and reported as the daemon does
    it."""
    place = folder / "bench" / "0001"
    place.mkdir(parents=True)
    text = survey_text(setups=("ppp",), n=1, dwell=0.5)
    (folder / "survey.toml").write_text(text, encoding="utf-8")
    (place / "0001.mcap").write_bytes(with_survey(text))
    bench = Bench(increments=4, angle_urad=3.0)
    readings = bench.survey()
    (place / "readings.csv").write_text(render_readings(readings), encoding="utf-8")
    result = solve(readings, angles=bench.angles(1.0) if angles else None)
    (place / "result.json").write_text(result.to_json(), encoding="utf-8")
    out = place / "exports" / "siemens"
    written = export(
        result, "siemens", None, step_mm=25.0, out_dir=out, today=date(2026, 1, 1)
    )
    write_completed_report(
        Completed(
            folder=place, recorded=place, result=result, exports=(written,), refusals={}
        )
    )
    return place


def read(pattern: re.Pattern[str], text: str) -> tuple[str, ...]:
    """Return the figures of a text as English writes them."""
    found = pattern.search(" ".join(text.split()))
    assert found, text
    return tuple(figure.replace(",", ".") for figure in found.groupdict().values())


@pytest.mark.parametrize(
    "angles", [True, False], ids=["angles as in the demo", "angles unmeasured"]
)
def test_every_place_says_the_same_figure(
    tmp_path: Path, browser: Browser, *, angles: bool
) -> None:
    """Terminal, status, verify, export report, report, conclusion.json and page, in both languages:
    both ends and the largest vector."""
    place = finished(tmp_path, angles=angles)
    told = json.loads((place / "conclusion.json").read_text(encoding="utf-8"))["reached"][1]
    promised = read(AFTER["en"], told["en"])
    assert float(promised[0]) < float(promised[1]) < float(promised[2])
    assert read(AFTER["de"], told["de"]) == promised
    assert read(AFTER["en"], stepdiag("status", tmp_path / "survey.toml").out) == promised
    report = re.sub(r"<[^>]+>", " ", (place / "report.html").read_text(encoding="utf-8"))
    assert read(AFTER["en"], report) == read(REPORTED, report) == promised
    files = place / "exports" / "siemens"
    assert (
        read(EXPORTED, (files / "EXPORT_REPORT.txt").read_text(encoding="utf-8")) == promised
    )
    verified = stepdiag("verify", place / "result.json", files).out
    assert read(VERIFIED, verified) + read(VERIFIED_LARGEST, verified) == promised
    watching = Watched(browser)
    with served(place) as daemon:
        daemon.do(
            lambda: daemon.survey.publish(
                phase="complete", expects_setup="", result_ready=True
            )
        )
        page = watching.open(daemon.address)
        reached = page.locator("#conclusion .reached li").nth(1)
        expect(reached).to_contain_text("µm")
        assert read(AFTER["en"], reached.inner_text()) == promised
        page.locator("#language").click()
        expect(reached).to_contain_text("größter")
        assert read(AFTER["de"], reached.inner_text()) == promised
        page.context.close()
    watching.close()
