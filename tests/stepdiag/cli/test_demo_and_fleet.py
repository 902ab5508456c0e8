"""Options of the demo and of the fleet's page: each changes what the command starts, or is
refused."""

import json
import re
from contextlib import contextmanager
from pathlib import Path

import pytest

from stepdiag.base.messages import message
from stepdiag.base.result.interval import Interval
from stepdiag.demo.demo import Demonstrated, Figures, Promise
from stepdiag.demo.reach import FORMS
from stepdiag.fleet.store import Store
from testkit.browsing import visit
from testkit.cli import stepdiag
from testkit.fleets import write_history

FIGURES = Figures(rms_um=10.0, largest_um=20.0, face_diagonal_um=5.0)


@pytest.fixture
def demonstrations(monkeypatch):
    """Collect the seeds of the demos that the command starts."""
    seeds = []

    def demonstrate(folder, seed, progress):
        seeds.append(seed)
        after = {"siemens": Figures(rms_um=2.0, largest_um=4.0, face_diagonal_um=1.0)}
        return Demonstrated(
            folder=folder,
            round=folder / "0001",
            before=FIGURES,
            after=after,
            reach={},
            promises=(),
            seconds=1.0,
        )

    monkeypatch.setattr("stepdiag.demo.demo.demonstrate", demonstrate)
    return seeds


def test_the_seed_of_the_demo_names_its_machine(demonstrations):
    stepdiag("demo")
    stepdiag("demo", "--seed", 7)
    assert demonstrations == [1, 7]


def test_the_demo_prints_its_figures_for_programs(demonstrations, monkeypatch):
    monkeypatch.setattr(
        "stepdiag.cli.status.concluded_in", lambda folder: iter(["the conclusion"])
    )
    brief, whole = stepdiag("demo").out, stepdiag("demo", "--verbose").out
    assert "True errors of the tool" in brief
    assert ("the conclusion" in brief, "the conclusion" in whole) == (False, True)
    printed = json.loads(stepdiag("demo", "--json").out)
    assert printed["figures"]["siemens"]["rms_um"] == 2.0
    assert printed["factors"] == {"siemens": 5.0}
    assert len(demonstrations) == 3


def test_the_demo_prints_every_form_on_a_screen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Of 30 lines of 80 columns."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr("testkit.cli.joined", lambda text: text)
    kept = Promise(
        of=message("as-it-is"),
        stated=Interval(value_um=2.0, low_um=1.0, high_um=3.0),
        true_um=2.0,
    )
    found = Demonstrated(
        folder=tmp_path / ("long" * 8),
        round=tmp_path / "0001",
        before=FIGURES,
        after=dict.fromkeys(("siemens", "fanuc"), FIGURES),
        reach={str(form.name): FIGURES for form in FORMS},
        promises=(kept, kept),
        seconds=1.0,
    )
    monkeypatch.setattr(
        "stepdiag.demo.demo.demonstrate", lambda folder, seed, progress: found
    )
    lines = stepdiag("demo").out.splitlines()
    assert len(FORMS) + 8 < len(lines) <= 30


@pytest.mark.parametrize(
    ("given", "opened"), [((), True), (("--browser",), True), (("--no-browser",), False)]
)
def test_the_live_demo_opens_a_browser_unless_asked_not_to(given, opened, monkeypatch):
    pages = []

    @contextmanager
    def keyboard():
        yield None

    monkeypatch.setattr("stepdiag.demo.keys.keyboard", keyboard)
    monkeypatch.setattr(
        "stepdiag.demo.live.live",
        lambda out, seed, person: person.opened("http://127.0.0.1:1/", "token"),
    )
    monkeypatch.setattr("webbrowser.open", pages.append)
    assert stepdiag("demo", "--live", *given).code == 0
    assert pages == ["http://127.0.0.1:1/"] * opened


@pytest.mark.parametrize("given", [("--live", "--json"), ("--browser",), ("--no-browser",)])
def test_an_option_of_the_other_kind_of_demo_is_refused(given, demonstrations):
    assert stepdiag("demo", *given).code == 2
    assert not demonstrations


@pytest.fixture
def visited(tmp_path: Path, monkeypatch):
    """Return what a browser receives from the page that ``fleet`` with these options serves, and
    where it serves."""
    store = Store(str(tmp_path / "store"), create=True)
    write_history(store, "Lathe", [5.0, 5.1, 5.2, 5.4])
    served = []
    monkeypatch.setattr(
        "stepdiag.fleet.page.serve", lambda app, host, port: served.append((app, host, port))
    )

    def shown(*options):
        told = stepdiag("fleet", store.address, *options)
        assert told.code == 0
        app, host, port = served[-1]
        token = re.findall(r"/\?token=(\S{24}) ", told.out)[0]
        status, sheet = visit(app, "/", f"{host}:{port}", token=token)
        assert status == 200
        return sheet, (host, port)

    return shown


def test_the_page_of_a_fleet_is_served_where_it_is_asked_for(visited):
    sheet, place = visited()
    assert place == ("127.0.0.1", 8430)
    assert visited("--host", "shop.example", "--port", 9000) == (
        sheet,
        ("shop.example", 9000),
    )


@pytest.mark.parametrize("given", [("--language", "de"), ("--tolerance", "volumetric-rms=4")])
def test_an_option_changes_the_sheet_of_a_fleet(given, visited):
    assert visited(*given)[0] != visited()[0]


def test_a_fleet_of_a_version_that_solved_nothing_is_refused(tmp_path):
    store = Store(str(tmp_path / "store"), create=True)
    write_history(store, "Lathe", [5.0, 5.1])
    refused = stepdiag("fleet", store.address, "--software", "9")
    assert refused.code == 3
    assert "solved by 9" in refused.refusal
