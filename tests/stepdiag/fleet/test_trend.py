"""What is said of a machine over time: no change where there is none, the step where it is, the date where the line leads."""

import csv
import io
import json
import re
from base64 import b64decode
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.fleet.history import Point, Series, series_in
from stepdiag.fleet.page import create_app
from stepdiag.fleet.report import fleet_html, worst_first
from stepdiag.fleet.rows import RMS
from stepdiag.fleet.store import Store
from stepdiag.fleet.tables import table_of, to_parquet
from stepdiag.fleet.terminal import as_csv, leaves
from stepdiag.fleet.trend import YEAR, already_perhaps, trend_of
from testkit.browsing import visit
from testkit.cli import stepdiag
from testkit.examples import few
from testkit.fleets import FIRST, About, whole_result_rows, write_history

QUARTER = timedelta(days=91)


def series(values: list[float], u: float = 0.5, events: dict[int, str] | None = None, active: dict[int, tuple[str, ...]] | None = None):
    points = tuple(
        Point(
            time=FIRST + number * QUARTER, survey=str(number), value=value, u=u, event=(events or {}).get(number, ""),
            active=(active or {}).get(number, ()), software="1",
        )
        for number, value in enumerate(values)
    )  # fmt: skip
    return Series(machine="M", quantity=RMS, unit="um", points=points)


class TestChanges:
    @few(60)
    @given(st.integers(0, 2**32))
    def test_noise_alone_is_seldom_a_change(self, seed: int) -> None:
        """All comparisons of a series together err as seldom as one at k = 2 would: here nothing is beyond 4 sigma, and never called so."""
        noise = np.clip(np.random.default_rng(seed).normal(0, 0.5, 40), -0.7, 0.7)
        assert trend_of(series([10 + each for each in noise.tolist()])).steps == ()

    def test_a_step_is_found_with_what_happened_before_it(self) -> None:
        found = trend_of(series([5.0, 5.2, 4.9, 9.0, 9.1], events={3: "crash"}))
        (step,) = found.steps
        assert (step.since, step.after) == (FIRST + 3 * QUARTER, "crash")
        assert step.change == pytest.approx(4.1)
        assert step.expanded == pytest.approx(2 * 0.5 * np.sqrt(2))

    def test_other_tables_are_a_cause(self) -> None:
        found = trend_of(series([9.0, 9.1, 3.0], active={2: ("abc",)}))
        assert found.steps[0].after == "other compensation files loaded"

    def test_without_uncertainty_nothing_is_claimed(self) -> None:
        bare = series([1.0, 50.0, 1.0], u=0.5)
        points = tuple(each._replace(u=None) for each in bare.points)
        found = trend_of(Series(machine="M", quantity=RMS, unit="um", points=points), 10.0)
        assert (found.steps, found.line, found.leaving) == ((), None, None)


class TestLine:
    def test_a_drift_leaves_the_tolerance_on_the_day_that_the_line_says(self) -> None:
        """1 um a year from 5 um: 10 um after five years, within its interval; the interval holds the truth."""
        values = [5.0 + 1.0 * (number * QUARTER / YEAR) for number in range(12)]
        found = trend_of(series(values, u=0.3), tolerance=10.0)
        assert found.line is not None
        assert found.line.slope == pytest.approx(1.0)
        assert found.leaving is not None
        assert found.leaving.earliest is not None
        assert found.leaving.likely is not None
        assert found.leaving.latest is not None
        assert abs(found.leaving.likely - (FIRST + 5 * YEAR)) < timedelta(days=2)
        assert found.leaving.earliest < found.leaving.likely < found.leaving.latest

    def test_a_fall_leaves_it_below(self) -> None:
        found = trend_of(series([-1.0 - number for number in range(6)], u=0.2), tolerance=20.0)
        assert found.leaving is not None
        assert found.leaving.tolerance == -20.0
        assert found.leaving.likely is not None

    def test_the_line_begins_behind_the_step(self) -> None:
        values = [20.0, 20.1, 20.2, *(5.0 + 0.5 * number for number in range(8))]
        found = trend_of(series(values, u=0.3))
        assert found.line is not None
        assert (found.line.surveys, found.line.begins) == (8, FIRST + 3 * QUARTER)

    def test_a_step_within_its_uncertainty_is_no_drift(self) -> None:
        """What is common to all surveys is in their U: a crash of 2.5 um at U 3 um is no step by the figures, and no line either."""
        values = [5.0 + 2.5 * (number >= 14) + 0.02 * (-1) ** number for number in range(40)]
        found = trend_of(series(values, u=1.5), tolerance=15.0)
        assert (found.steps, found.line, found.leaving) == ((), None, None)
        drift = trend_of(series([5.0 + 2.5 * number / 40 + 0.02 * (-1) ** number for number in range(40)], u=0.5), tolerance=15.0)
        assert drift.line is not None, "a drift as large is one"

    def test_a_day_that_has_passed_is_not_named_as_one_to_come(self) -> None:
        """The line is beyond the tolerance already, the last figure only perhaps, within its U."""
        found = trend_of(series([8.0 + 0.2 * number for number in range(12)], u=0.4), tolerance=9.9)
        assert found.outside == "perhaps"
        assert already_perhaps(found)
        assert leaves(found) == "perhaps outside already"
        assert "perhaps outside its tolerance" in fleet_html([found], "store", "en")

    @pytest.mark.parametrize("values", [[5.0, 5.1, 5.0, 4.9, 5.1], [5.0, 6.0, 7.0], [0.0, 4.0, 0.0, 4.0, 8.0, 0.0], [5.0]])
    def test_none_where_it_is_not_justified(self, values: list[float]) -> None:
        """A slope within its uncertainty, too few surveys, residuals that nothing explains."""
        assert trend_of(series(values, u=1.5), 100.0).line is None

    @few(30)
    @given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=12), st.floats(1e-6, 1e6))
    def test_whatever_the_figures_there_is_an_answer(self, values: list[float], tolerance: float) -> None:
        found = trend_of(series(values), tolerance)
        assert found.outside in ("yes", "perhaps", "no")


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """Three machines: one still, one that drifts away, one that crashed."""
    store = Store(str(tmp_path / "store"), create=True)
    write_history(store, "still", [5.0, 5.1, 4.9, 5.0, 5.1])
    write_history(store, "drifts", [5.0 + 1.0 * number for number in range(6)])
    write_history(store, "crashed <b>", [5.0, 5.1, 30.0, 30.2], events={2: "crash & bang"})
    return store


def test_the_commands_say_the_same_as_table_json_and_csv(store: Store, tmp_path: Path) -> None:
    options = ("trend", store.root, "--tolerance", f"{RMS}=12")
    found = {each["machine"]: each for each in json.loads(stepdiag(*options, "--json").out)}
    assert found["still"]["steps"] == []
    assert found["crashed <b>"]["steps"][0]["after"] == "crash & bang"
    assert found["crashed <b>"]["outside"] == "yes"
    assert found["drifts"]["leaving"]["likely"] is not None
    assert stepdiag(*options, "--csv", tmp_path / "t.csv", "--report", tmp_path / "t.html").code == 0
    rows = list(csv.DictReader(io.StringIO((tmp_path / "t.csv").read_text(encoding="utf-8"))))
    assert len(rows) == 15
    assert float(rows[0]["U"]) == 1.0
    sheet = (tmp_path / "t.html").read_text(encoding="utf-8")
    assert "crash &amp; bang" in sheet
    assert "<b>" not in sheet
    assert "http" not in sheet.replace("http://www.w3.org/2000/svg", "")


def test_each_machine_has_the_tolerance_that_the_works_states_for_it(store: Store) -> None:
    """In a file of the store; its own stands before that of all, and what is typed before both."""

    def tolerances(*options: str) -> dict[str, float | None]:
        return {each["machine"]: each["tolerance"] for each in json.loads(stepdiag("trend", store.root, "--json", *options).out)}

    assert set(tolerances().values()) == {None}
    file = Path(store.root) / "tolerances.toml"
    file.write_text(f'[all]\n"{RMS}" = 12\n[machine.drifts]\n"{RMS}" = 20\n[machine."still"]\n"{RMS}" = 8.5\n', encoding="utf-8")
    assert tolerances() == {"still": 8.5, "drifts": 20.0, "crashed <b>": 12.0}
    assert tolerances("--tolerance", f"{RMS}=30") == dict.fromkeys(("still", "drifts", "crashed <b>"), 30.0)
    days = {each["machine"]: each["leaving"] for each in json.loads(stepdiag("trend", store.root, "--json").out)}
    assert days["drifts"]["tolerance"] == 20.0
    assert days["drifts"]["likely"] is not None
    sheet = store.root + ".html"
    assert stepdiag("trend", store.root, "--report", sheet).code == 0
    assert "leaves" in Path(sheet).read_text(encoding="utf-8")
    for wrong, words in (("[all]\nEQQ = 1\n", "EQQ"), ("[all]\nEXX = -1\n", "EXX"), ("[al]\n", "all"), ("\0", "tolerances.toml")):
        file.write_text(wrong, encoding="utf-8")
        told = stepdiag("trend", store.root)
        assert (told.code, words in told.refusal) == (2, True), told


def test_one_machine_and_unknown_ones(store: Store) -> None:
    assert {each["machine"] for each in json.loads(stepdiag("trend", store.root, "--machine", "still", "--json").out)} == {"still"}
    assert "known are crashed <b>, drifts, still" in stepdiag("trend", store.root, "--machine", "nobody").refusal
    assert stepdiag("trend", store.root, "--tolerance", "EXX=5").code == 2
    assert stepdiag("trend", store.root, "--tolerance", f"{RMS}=-5").code == 2


def test_the_sheet_has_one_picture_a_machine_worst_first_in_both_languages(store: Store) -> None:
    trends = [trend_of(each, 12.0) for each in series_in(store)]
    assert [machine for machine, _ in worst_first(trends)] == ["crashed <b>", "drifts", "still"]
    for language, title in (("en", "Machines over time"), ("de", "Maschinen im Verlauf")):
        sheet = fleet_html(trends, "store", language)  # type: ignore[arg-type]
        assert title in sheet
        assert sheet.count("<article") == sheet.count("<svg") == 3
        points = [(each, point) for _, (each, *_) in worst_first(trends) for point in each.series.points]
        said = re.findall(r'class="titled"[^>]*><title>([^<]+)</title>', sheet)
        figures = [f"{point.value:.2f} ± {2 * (point.u or 0):.2f} {each.series.unit}" for each, point in points]
        assert [words.rpartition(" = ")[2].replace(",", ".") for words in said] == figures, "every survey says its figure with U"
        assert ("," in said[0].rpartition(" = ")[2]) == (language == "de")
        tables = [b64decode(each).decode() for each in re.findall(r'href="data:text/csv;charset=utf-8;base64,([^"]+)"', sheet)]
        assert tables == [as_csv([each]) for _, (each, *_) in worst_first(trends)]


def test_the_page_answers_here_and_to_nobody_elses_name(store: Store) -> None:
    app = create_app(lambda: [trend_of(each, 12.0) for each in series_in(store)], "store", "en")
    assert visit(app, "/", "localhost:8430")[0] == 200
    assert visit(app, "/", "evil.example")[0] == 421
    status, body = visit(app, "/trend.json", "127.0.0.1")
    assert (status, len(json.loads(body))) == (200, 3)


def test_a_function_takes_at_most_a_kilobyte() -> None:
    """Issue 17, item 5; all 18 functions at 11 nodes."""
    about = About(
        machine="M", survey="0" * 16, time=FIRST, event="", method="estimate", software="1.2.3.dev4+gabcdef", conditions="{}" * 100
    )
    assert len(to_parquet(table_of(about, whole_result_rows(np.random.default_rng(1), 0.0)))) < 18 * 1024
