"""What is said of a machine over time: no change where there is none, the step where it is, the
date where the line leads."""

import csv
import io
import json
import math
import re
from base64 import b64decode
from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.comparing.alike import Standing
from stepdiag.fleet.page import Sheets, create_app
from stepdiag.fleet.report import fleet_html, worst_first
from stepdiag.fleet.rows import RMS
from stepdiag.fleet.series import Survey
from stepdiag.fleet.store import Store
from stepdiag.fleet.tables import table_of, to_parquet
from stepdiag.fleet.terminal import as_csv, as_json, leaves
from stepdiag.fleet.trend import YEAR, already_perhaps, statements, trends_of
from stepdiag.texts.texts import UNITS
from testkit.browsing import visit
from testkit.cli import stepdiag
from testkit.examples import few
from testkit.fleets import (
    FIRST,
    About,
    made_series,
    series_of,
    trend_of,
    whole_result_rows,
    write_history,
)

QUARTER = timedelta(days=91)
SQUARENESS = "C0Y"


def quarterly(
    count: int,
    events: dict[int, str] | None = None,
    active: dict[int, tuple[str, ...]] | None = None,
) -> tuple[Survey, ...]:
    """Return a survey a quarter; ``active`` are the tables that are loaded from a survey on."""
    loaded: tuple[str, ...] = ()
    found = []
    for number in range(count):
        loaded = (active or {}).get(number, loaded)
        found.append(
            Survey(
                time=FIRST + number * QUARTER,
                name=str(number),
                event=(events or {}).get(number, ""),
                active=loaded,
            )
        )
    return tuple(found)


class TestChanges:
    def test_noise_alone_is_seldom_a_change(self) -> None:
        """All questions of a machine together err as seldom as one at k = 2 would: in at most 5 of
        100 (1.6 % of 1500)."""
        verdicts = []
        for seed in range(300):
            noise = np.clip(np.random.default_rng(seed).normal(0, 0.5, 40), -0.7, 0.7)
            found = trend_of(made_series([10 + each for each in noise.tolist()]))
            verdicts.append((found.verdict, found.explained.courses))
        assert len(verdicts) - verdicts.count(("unchanged", ())) <= 15

    def test_a_step_is_found_with_what_happened_before_it(self) -> None:
        found = trend_of(
            made_series([5.0, 5.2, 4.9, 9.0, 9.1], surveys=quarterly(5, {3: "crash"}))
        )
        (step,) = found.steps
        assert (step.at, step.first, step.last, found.cause(step)) == (3, 2, 3, "crash")
        assert step.size == pytest.approx(9.05 - 5.0333, abs=1e-3)
        assert step.u == pytest.approx(0.5 * np.sqrt(1 / 3 + 1 / 2))
        assert str(statements(found)[0]).endswith(
            "between 2020-07-15 and 2020-10-14, after: crash"
        )

    def test_other_tables_are_a_cause(self) -> None:
        found = trend_of(
            made_series([9.0, 9.1, 3.0], surveys=quarterly(3, active={2: ("abc",)}))
        )
        (step,) = found.steps
        assert (step.known, str(found.cause(step))) == (
            True,
            "other compensation files loaded",
        )

    def test_without_uncertainty_nothing_is_claimed(self) -> None:
        found = trend_of(made_series([1.0, 50.0, 1.0], u=None), 10.0)
        assert (found.verdict, found.explained.courses, found.leaving) == (
            "undecided",
            (),
            None,
        )

    @pytest.mark.parametrize("event", ["", "crash"])
    def test_a_crash_between_two_visits_is_never_denied(self, event: str) -> None:
        """Three surveys in a week, three more two years later: a line explains them as well as a
        step does."""
        dice = np.random.default_rng(7)
        days = (0, 1, 2, 730, 731, 732)
        surveys = tuple(
            Survey(
                time=FIRST + timedelta(days=each),
                name=str(number),
                event=event if number == 3 else "",
            )
            for number, each in enumerate(days)
        )
        for size in (8.0, 30.0, 100.0, -30.0):
            values = [size * (number > 2) + dice.normal() for number in range(6)]
            found = trend_of(
                made_series(values, u=1.0, quantity=SQUARENESS, surveys=surveys), 1000.0
            )
            (step,) = found.explained.courses
            assert (found.verdict, step.kind, step.first, step.last) == (
                "changed",
                "step",
                2,
                3,
            )
            assert abs(step.size - size) < 4 * step.u
            assert found.leaving is None, "at once or gradually: no day follows from it"

    def test_scatter_beyond_u_is_no_step(self) -> None:
        dice = np.random.default_rng(3)
        invented = 0
        for _ in range(40):
            noisy = dice.normal(0, 2.0, (20, 26))
            series = [
                replace(made_series(noisy[:, at].tolist(), u=1.0), quantity=f"Q{at:02d}")
                for at in range(26)
            ]
            invented += any(
                each.verdict == "changed" for each in trends_of(series, lambda *_: None)
            )
        assert invented <= 4

    def test_a_sign_that_turned_is_a_change_of_the_function_not_of_its_range(self) -> None:
        bow = 6 * np.sin(np.linspace(0, np.pi, 11))
        values = np.stack([bow, bow, bow, -bow, -bow])
        one = made_series([6.0] * 5, u=1.0)
        function = replace(
            one,
            quantity="EYX",
            nodes_mm=np.linspace(0, 500, 11),
            values=values,
            u=np.full((5, 11), 1.0),
        )
        (found,) = trends_of([function], lambda *_: None)
        (step,) = found.steps
        assert (found.verdict, step.node, step.first, step.last) == ("changed", 5, 2, 3)

    def test_a_machine_that_is_loaded_every_year_has_one_slope(self) -> None:
        """The tables take back what was measured; the drift goes on through them, and its day
        follows."""
        dice = np.random.default_rng(5)
        years = np.arange(24) / 4
        values = 8.0 * years - 8.0 * np.floor(years) + dice.normal(0, 0.3, 24)
        loads = {4 * number: (f"{number:012x}",) for number in range(1, 6)}
        found = trend_of(
            made_series(
                values.tolist(),
                u=0.3,
                quantity=SQUARENESS,
                surveys=quarterly(24, active=loads),
            ),
            20.0,
        )
        assert found.line is not None
        assert found.line.size == pytest.approx(8.0, abs=2 * found.line.u)
        assert found.leaving is not None
        assert sum(step.known for step in found.steps) == 5

    @pytest.mark.parametrize("every", [1, 2, 3])
    def test_tables_loaded_before_every_few_surveys_are_no_other_change(
        self, every: int
    ) -> None:
        loads = {number: (f"{number:012x}",) for number in range(0, 12, every)}
        values = [5.0 * (number // every % 2) for number in range(12)]
        found = trend_of(
            made_series(
                values, u=0.3, quantity=SQUARENESS, surveys=quarterly(12, active=loads)
            )
        )
        assert {each.known for each in found.explained.courses} == {True}

    def test_a_run_in_that_levels_off_has_no_day(self) -> None:
        dice = np.random.default_rng(6)
        years = np.arange(24) / 4
        values = 12.0 * (1 - np.exp(-years / 0.6)) + dice.normal(0, 0.3, 24)
        found = trend_of(made_series(values.tolist(), u=0.3, quantity=SQUARENESS), 15.0)
        assert [each.kind for each in found.explained.courses] == ["run-in"]
        assert found.leaving is None

    def test_seasons_are_neither_steps_nor_a_line(self) -> None:
        values = 5.0 * np.sin(
            2 * np.pi * np.arange(24) * 91 / 365.25
        ) + np.random.default_rng(8).normal(0, 0.5, 24)
        found = trend_of(made_series(values.tolist(), u=0.5, quantity=SQUARENESS))
        assert [each.kind for each in found.explained.courses] == ["season"]

    def test_a_crash_between_visits_is_no_season(self) -> None:
        """Visits of a few days lie at as many places of the year as there are visits: any levels
        look like a season."""
        seasons, found = 0, 0
        for seed in range(100):
            dice = np.random.default_rng(seed)
            days = [
                start + each
                for start in np.cumsum(dice.uniform(200, 900, 3))
                for each in range(3)
            ]
            surveys = tuple(
                Survey(time=FIRST + timedelta(days=float(each)), name=str(number))
                for number, each in enumerate(days)
            )
            at = int(dice.integers(1, 9))
            values = dice.normal(0, 1.0, 9) + 12.0 * (np.arange(9) >= at)
            courses = trend_of(
                made_series(values.tolist(), u=1.0, quantity=SQUARENESS, surveys=surveys)
            ).explained.courses
            seasons += any(each.kind == "season" for each in courses)
            found += any(
                each.kind == "step" and each.first < at <= each.last for each in courses
            )
        assert seasons <= 8
        assert found >= 90

    @few(40)
    @given(st.integers(0, 2**32), st.integers(4, 60), st.floats(6.4, 20.0))
    def test_a_change_that_was_taken_back_before_the_next_survey_is_not_denied(
        self, seed: int, count: int, size: float
    ) -> None:
        """No step shows one survey among many: a change of 3 U is not excluded there."""
        dice = np.random.default_rng(seed)
        values = np.clip(dice.normal(0, 1.0, count), -1.5, 1.5)
        values[int(dice.integers(1, count - 1))] = size + 1.5
        asked, *others = trends_of(
            [
                replace(made_series(each.tolist(), u=1.0), quantity=f"Q{at:02d}")
                for at, each in enumerate((values, 0 * values, 0 * values))
            ],
            lambda *_: None,
        )
        assert asked.verdict != "unchanged"
        assert {each.verdict for each in others} == {"unchanged"}

    def test_what_all_surveys_have_in_common_hides_no_change(self) -> None:
        """A crash of 2.5 µm at U 3 µm, of which nine tenths are the same in every survey."""
        values = [5.0 + 2.5 * (number >= 14) + 0.1 * (-1) ** number for number in range(20)]
        common = math.sqrt(1 - 0.1**2)
        assert trend_of(made_series(values, u=1.5, common=common)).steps[0].at == 14
        assert (
            trend_of(made_series(values, u=1.5)).verdict != "changed"
            or trend_of(made_series(values, u=1.5)).steps
        )

    def test_other_instruments_are_off_together(self) -> None:
        """Three surveys by another laser, 2 u off: their common part explains it; by the same laser
        it is a change."""
        values = [0.0, 0.1, -0.1, 0.1, 2.0, 2.1, 1.9]
        one = made_series(values, u=1.0, common=0.99)
        other = tuple(
            replace(each, standing=Standing(instruments="new" if number > 3 else "old"))
            for number, each in enumerate(one.surveys)
        )
        assert trend_of(one).verdict == "changed"
        assert trend_of(replace(one, surveys=other)).verdict != "changed"

    def test_not_decidable_names_how_many_surveys_decide(self) -> None:
        found = trend_of(made_series([0.0, 3.2], u=1.0, quantity=SQUARENESS))
        assert found.verdict == "changed", "one question alone: beyond k = 2"
        many = [
            replace(made_series([0.0, 4.6 * (at == 0)], u=1.0), quantity=f"Q{at:03d}")
            for at in range(200)
        ]
        asked, *others = trends_of(many, lambda *_: None)
        assert (asked.verdict, asked.explained.further) == ("undecided", 2)
        assert {each.verdict for each in others} == {"unchanged"}


class TestLine:
    def test_a_drift_leaves_the_tolerance_on_the_day_that_the_line_says(self) -> None:
        """1 µm a year from 5 µm: 10 µm after five years, within its interval; the interval holds
        the truth."""
        values = [5.0 + 1.0 * (number * QUARTER / YEAR) for number in range(12)]
        found = trend_of(made_series(values, u=0.1), tolerance=10.0)
        assert found.line is not None
        assert found.line.size == pytest.approx(1.0)
        assert found.leaving is not None
        assert found.leaving.earliest is not None
        assert found.leaving.likely is not None
        assert found.leaving.latest is not None
        assert abs(found.leaving.likely - (FIRST + 5 * YEAR)) < timedelta(days=2)
        assert found.leaving.earliest < found.leaving.likely < found.leaving.latest

    def test_the_interval_of_the_day_holds_what_all_surveys_have_in_common(self) -> None:
        values = [5.0 + 1.0 * (number * QUARTER / YEAR) for number in range(12)]
        alone, shared = (
            trend_of(made_series(values, u=u, common=common), 10.0).leaving
            for u, common in ((0.1, 0.0), (1.0, math.sqrt(0.99)))
        )
        assert alone is not None
        assert shared is not None
        assert None not in (alone.earliest, alone.latest, shared.earliest, shared.latest)
        assert (
            shared.latest - shared.earliest > 4 * YEAR > 2 * (alone.latest - alone.earliest)
        )  # type: ignore[operator]

    def test_a_signed_figure_leaves_below_and_a_magnitude_never(self) -> None:
        values = [-1.0 - number for number in range(8)]
        found = trend_of(made_series(values, u=0.2, quantity=SQUARENESS), tolerance=20.0)
        assert found.leaving is not None
        assert found.leaving.tolerance == -20.0
        better = trend_of(
            made_series([12.0 - 0.4 * number for number in range(8)], u=0.1), tolerance=15.0
        )
        assert better.line is not None
        assert better.leaving is None, "a machine that improves leaves nothing"

    def test_the_line_goes_on_behind_a_step(self) -> None:
        values = [20.0 + 0.5 * number for number in range(6)] + [
            5.0 + 0.5 * number for number in range(6, 16)
        ]
        found = trend_of(made_series(values, u=0.2, quantity=SQUARENESS))
        assert {each.kind for each in found.explained.courses} == {"step", "line"}
        assert found.line is not None
        assert found.line.size == pytest.approx(0.5 * YEAR / QUARTER, abs=2 * found.line.u)

    def test_a_day_that_has_passed_is_not_named_as_one_to_come(self) -> None:
        """The line is beyond the tolerance already, the last figure only perhaps, within its U."""
        found = trend_of(
            made_series([8.0 + 0.2 * number for number in range(12)], u=0.2), tolerance=10.0
        )
        assert found.outside == "perhaps"
        assert already_perhaps(found)
        assert leaves(found).startswith("not decidable: perhaps outside ")
        assert "too large), tolerance 10 µm" in fleet_html([found], "store", "en")

    @pytest.mark.parametrize(
        ("last", "u", "verdict", "english", "german"),
        [
            (8.0, 0.5, "conform", ": conform, tolerance 10 µm", ": konform, Toleranz 10 µm"),
            (9.5, 0.5, "not_decidable", "not decidable", "nicht entscheidbar"),
            (8.0, None, "not_decidable", "not decidable", "nicht entscheidbar"),
            (
                12.0,
                0.5,
                "not_conform",
                "not conform, tolerance 10",
                "nicht konform, Toleranz 10",
            ),
        ],
    )
    def test_the_last_figure_is_judged_by_the_tolerance_of_the_store(
        self, last: float, u: float | None, verdict: str, english: str, german: str
    ) -> None:
        """ISO 14253-1, in the table, for programs and on the sheet; without a tolerance there is no
        word of it."""
        series = made_series([8.0, 8.0, last], u=u)
        found = trend_of(series, tolerance=10.0)
        assert found.conformity == verdict
        assert as_json([found], [])["series"][0]["conformity"] == verdict
        assert leaves(found).startswith(verdict.replace("_", " "))
        assert english in fleet_html([found], "store", "en")
        assert german in fleet_html([found], "store", "de")
        plain = trend_of(series)
        assert plain.conformity is None
        assert "conform" not in leaves(plain) + fleet_html([plain], "store", "en")

    def test_the_day_of_a_machine_with_seasons_is_true_as_often_as_its_interval_states(
        self,
    ) -> None:
        held = asked = 0
        for seed in range(60):
            dice = np.random.default_rng(seed)
            years = np.sort(dice.uniform(0, 5, 20))
            years -= years[0]
            surveys = tuple(
                Survey(time=FIRST + float(each) * YEAR, name=str(number))
                for number, each in enumerate(years)
            )
            values = (
                3.0 * years
                + 5.0 * np.sin(2 * np.pi * (years + dice.random()))
                + dice.normal(0, 0.5, 20)
            )
            found = trend_of(
                made_series(values.tolist(), u=0.5, quantity=SQUARENESS, surveys=surveys),
                24.0,
            ).leaving
            if found is not None and found.earliest is not None:
                asked += 1
                held += found.earliest <= FIRST + 8 * YEAR and (
                    found.latest is None or found.latest >= FIRST + 8 * YEAR
                )
        assert asked > 50
        assert 0.9 * asked <= held

    @pytest.mark.parametrize(
        "values",
        [[5.0, 5.1, 5.0, 4.9, 5.1], [5.0, 6.0, 7.0], [0.0, 4.0, 0.0, 4.0, 8.0, 0.0], [5.0]],
    )
    def test_none_where_it_is_not_justified(self, values: list[float]) -> None:
        """A slope within its uncertainty, too few surveys, scatter alone."""
        assert trend_of(made_series(values, u=1.5), 100.0).line is None

    @few(30)
    @given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=12), st.floats(1e-6, 1e6))
    def test_whatever_the_figures_there_is_an_answer(
        self, values: list[float], tolerance: float
    ) -> None:
        found = trend_of(made_series(values), tolerance)
        assert found.outside in ("yes", "perhaps", "no")
        assert found.verdict in ("changed", "unchanged", "undecided")

    def test_the_interval_of_a_skewed_figure_decides_where_it_stands(self) -> None:
        even = made_series([9.0], u=0.5)
        skewed = replace(even, shown=np.array([[9.0, 0.5, 8.6, 10.6]]))
        assert trend_of(even, 10.2).outside == "no"
        assert trend_of(skewed, 10.2).outside == "perhaps"


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """Three machines: one still, one that drifts away, one that crashed."""
    store = Store(str(tmp_path / "store"), create=True)
    write_history(store, "still", [5.0, 5.1, 4.9, 5.0, 5.1])
    write_history(store, "drifts", [5.0 + 1.0 * number for number in range(6)])
    write_history(store, "crashed <b>", [5.0, 5.1, 30.0, 30.2], events={2: "crash & bang"})
    return store


def test_the_commands_say_the_same_as_table_json_and_csv(
    store: Store, tmp_path: Path
) -> None:
    options = ("trend", store.root, "--tolerance", f"{RMS}=12")
    found = {
        each["machine"]: each
        for each in json.loads(stepdiag(*options, "--json").out)["series"]
    }
    assert (found["still"]["verdict"], found["still"]["changes"]) == ("unchanged", [])
    assert found["crashed <b>"]["changes"][0]["cause"] == "crash & bang"
    assert found["crashed <b>"]["outside"] == "yes"
    assert found["drifts"]["leaving"]["likely"] is not None
    assert (
        stepdiag(*options, "--csv", tmp_path / "t.csv", "--report", tmp_path / "t.html").code
        == 0
    )
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
        return {
            each["machine"]: each["tolerance"]
            for each in json.loads(stepdiag("trend", store.root, "--json", *options).out)[
                "series"
            ]
        }

    assert set(tolerances().values()) == {None}
    file = Path(store.root) / "tolerances.toml"
    file.write_text(
        f'[all]\n"{RMS}" = 12\n[machine.drifts]\n"{RMS}" = 20\n[machine."still"]\n"{RMS}" = 8.5\n',
        encoding="utf-8",
    )
    assert tolerances() == {"still": 8.5, "drifts": 20.0, "crashed <b>": 12.0}
    assert tolerances("--tolerance", f"{RMS}=30") == dict.fromkeys(
        ("still", "drifts", "crashed <b>"), 30.0
    )
    days = {
        each["machine"]: each["leaving"]
        for each in json.loads(stepdiag("trend", store.root, "--json").out)["series"]
    }
    assert days["drifts"]["tolerance"] == 20.0
    assert days["drifts"]["likely"] is not None
    sheet = store.root + ".html"
    assert stepdiag("trend", store.root, "--report", sheet).code == 0
    assert "out of tolerance from" in Path(sheet).read_text(encoding="utf-8")
    for wrong, words in (
        ("[all]\nEQQ = 1\n", "EQQ"),
        ("[all]\nEXX = -1\n", "EXX"),
        ("[al]\n", "all"),
        ("\0", "tolerances.toml"),
    ):
        file.write_text(wrong, encoding="utf-8")
        told = stepdiag("trend", store.root)
        assert (told.code, words in told.refusal) == (2, True), told


def test_one_machine_and_unknown_ones(store: Store) -> None:
    assert {
        each["machine"]
        for each in json.loads(
            stepdiag("trend", store.root, "--machine", "still", "--json").out
        )["series"]
    } == {"still"}
    assert (
        "valid names: crashed <b>, drifts, still"
        in stepdiag("trend", store.root, "--machine", "nobody").refusal
    )
    assert stepdiag("trend", store.root, "--tolerance", "EXX=5").code == 2
    assert stepdiag("trend", store.root, "--tolerance", f"{RMS}=-5").code == 2


def test_the_sheet_has_one_picture_a_machine_worst_first_in_both_languages(
    store: Store,
) -> None:
    trends = trends_of(series_of(store), lambda *_: 12.0)
    assert [machine for machine, _ in worst_first(trends)] == [
        "crashed <b>",
        "drifts",
        "still",
    ]
    for language, title in (("en", "Machines over time"), ("de", "Maschinen im Verlauf")):
        sheet = fleet_html(trends, "store", language)  # type: ignore[arg-type]
        assert title in sheet
        assert sheet.count("<article") == sheet.count("<svg") == 3
        points = [
            (each, point)
            for _, (each, *_) in worst_first(trends)
            for point in each.series.points
        ]
        said = re.findall(r'class="titled"[^>]*><title>([^<]+)</title>', sheet)
        figures = [
            f"{point.value:.2f} ± {2 * (point.u or 0):.2f} {UNITS[each.series.unit]}"
            for each, point in points
        ]
        assert [words.rpartition(" = ")[2].replace(",", ".") for words in said] == figures, (
            "every survey says its figure with U"
        )
        assert ("," in said[0].rpartition(" = ")[2]) == (language == "de")
        tables = [
            b64decode(each).decode()
            for each in re.findall(
                r'href="data:text/csv;charset=utf-8;base64,([^"]+)"', sheet
            )
        ]
        assert tables == [as_csv([each]) for _, (each, *_) in worst_first(trends)]


def test_the_page_answers_here_and_to_nobody_elses_name(store: Store) -> None:
    app = create_app(
        Sheets(
            store.state, lambda: (trends_of(series_of(store), lambda *_: 12.0), ()), "store"
        ),
        "en",
        "a token",
    )
    assert visit(app, "/", "localhost:8430", token="a%20token")[0] == 200
    assert visit(app, "/", "evil.example", token="a%20token")[0] == 421
    status, body = visit(app, "/trend.json", "127.0.0.1", token="a%20token")
    assert (status, len(json.loads(body)["series"])) == (200, 3)


@pytest.mark.parametrize("path", ["/", "/trend.json", "/trend.csv"])
def test_the_page_answers_nobody_without_the_token(
    store: Store, path: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stepdiag.page.security.DELAY_S", 0.0)
    app = create_app(
        Sheets(
            store.state, lambda: (trends_of(series_of(store), lambda *_: 12.0), ()), "store"
        ),
        "en",
        "a token",
    )
    assert visit(app, path, "localhost:8430")[0] == 401
    assert visit(app, path, "localhost:8430", token="another")[0] == 401


def test_a_function_takes_at_most_a_kilobyte() -> None:
    """Issue 17, item 5; all 18 functions at 11 nodes."""
    about = About(
        machine="M",
        survey="0" * 16,
        time=FIRST,
        event="",
        method="estimate",
        software="1.2.3.dev4+gabcdef",
        conditions="{}" * 100,
    )
    assert (
        len(to_parquet(table_of(about, whole_result_rows(np.random.default_rng(1), 0.0))))
        < 18 * 1024
    )
