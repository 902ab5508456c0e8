"""``program`` and ``plan``: what a survey file becomes before the machine moves."""

import itertools
import json
import re
from pathlib import Path

import pytest

from stepdiag.base.readings.runs import Plan, Run
from stepdiag.base.setups import SETUP_NAMES
from stepdiag.base.volume import Volume
from stepdiag.daq.survey.composed import MachineClass, begun
from stepdiag.daq.survey.file import parse_survey
from stepdiag.exporters.files.sets import whole
from stepdiag.solver.planning.search import ORDERS
from stepdiag.terminal.plan_tables import lines_in_words
from stepdiag.terminal.viewer import shown
from stepdiag.texts.setup_words import setup_words
from testkit.cli import stepdiag
from testkit.planned import plan_once

SURVEY = """\
[survey]
name = "small"
machine = "test"
[volume]
size_mm = [200.0, 200.0, 200.0]
increments = 2
[plan]
setups = ["ppp", "npp", "pnp", "ppn"]
[[plan.beam_offset]]
setup = "npp"
offset_mm = [0.0, 0.0, 40.0]
[laser]
format = "umd"
port = "/dev/null"
"""
BOX = Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=(500.0, 400.0, 300.0), increments=10)


@pytest.fixture(autouse=True)
def planned_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Search the surveys of one question once."""
    plan_once(monkeypatch)


@pytest.fixture
def survey(tmp_path: Path) -> Path:
    path = tmp_path / "survey.toml"
    path.write_text(SURVEY, encoding="utf-8")
    return path


class TestProgram:
    def test_the_programs_appear_whole_or_not_at_all(self, survey, tmp_path, monkeypatch):
        """Whoever finds the folder finds all setups, with their SHA-256; a half-written survey is
        driven by nobody."""
        monkeypatch.setattr("os.fsync", _broken_at(3))
        assert (
            stepdiag(
                "program", survey, "--controller", "siemens", "--out", tmp_path / "nc"
            ).code
            == 2
        )
        assert not (tmp_path / "nc").exists()
        monkeypatch.undo()
        assert (
            stepdiag(
                "program", survey, "--controller", "siemens", "--out", tmp_path / "nc"
            ).code
            == 0
        )
        assert whole(tmp_path / "nc")
        assert len(list((tmp_path / "nc").glob("*.MPF"))) == 5

    @pytest.mark.parametrize(
        ("controller", "name", "block"),
        [
            ("siemens", "STEP_NPP.MPF", "$A_DBW[4]=1"),
            ("fanuc", "O8002", "#1100=1"),
            ("heidenhain", "STEP_NPP.H", "FN 19"),
            ("linuxcnc", "step_npp.ngc", "M64 P0"),
        ],
    )
    def test_writes_one_program_a_setup(self, survey, tmp_path, controller, name, block):
        told = stepdiag(
            "program", survey, "--controller", controller, "--out", tmp_path / "nc", "--json"
        )
        said = json.loads(told.out)
        assert [each["setup"] for each in said["programs"]] == [
            "ppp",
            "npp",
            "npp+1",
            "pnp",
            "ppn",
        ]
        assert block in (tmp_path / "nc" / name).read_text(encoding="ascii")

    def test_the_profile_states_the_machines_own_signals(self, survey, tmp_path):
        """The questions about tables may still be open: they are not asked here."""
        profile = tmp_path / "p.toml"
        stepdiag("profile", "linuxcnc", "--out", profile)
        text = profile.read_text(encoding="utf-8")
        profile.write_text(
            text + '[program]\nstand = "M62 P7"\nleave = "M63 P7"\n', encoding="utf-8"
        )
        assert (
            stepdiag(
                "program",
                survey,
                "--controller",
                "linuxcnc",
                "--out",
                tmp_path / "nc",
                "--profile",
                profile,
            ).code
            == 0
        )
        program = (tmp_path / "nc" / "step_ppp.ngc").read_text(encoding="ascii")
        assert "M62 P7" in program
        assert "M68 E0 Q1" in program, (
            "what the profile does not state is the control's default"
        )

    @pytest.mark.parametrize(
        ("section", "refusal"),
        [
            ('[program]\nstnd = "M7"\n', "p.toml: program.stnd"),
            ('[program]\nstand = "M{stop}"\n', "program.stand"),
            ("[program]\ndecimals = 9\n", "p.toml: program.decimals"),
            ('[machine]\ncontroller = "fanuc"\n', "p.toml: machine.controller"),
        ],
    )
    def test_a_wrong_profile_is_refused_by_its_field(
        self, survey, tmp_path, section, refusal
    ):
        (tmp_path / "p.toml").write_text(section, encoding="utf-8")
        arguments = (
            "--controller",
            "siemens",
            "--out",
            tmp_path / "nc",
            "--profile",
            tmp_path / "p.toml",
        )
        told = stepdiag("program", survey, *arguments)
        assert told.code == 2
        assert told.refusal.startswith(refusal)

    def test_the_template_shows_the_controls_own_blocks(self, survey, tmp_path):
        """Whoever takes the # away gets the same program as without the section."""
        text = stepdiag("profile", "fanuc").out
        section = re.sub(
            r"^# (?=\[|\w+ = )", "", text[text.index("# [program]") :], flags=re.MULTILINE
        )
        (tmp_path / "p.toml").write_text(section, encoding="utf-8")
        stepdiag("program", survey, "--controller", "fanuc", "--out", tmp_path / "a")
        stepdiag(
            "program",
            survey,
            "--controller",
            "fanuc",
            "--out",
            tmp_path / "b",
            "--profile",
            tmp_path / "p.toml",
        )
        body = [(tmp_path / folder / "O8001").read_bytes() for folder in "ab"]
        assert body[0] == body[1]

    @pytest.mark.parametrize(
        ("travel", "code"),
        [
            ("[-5.0, 505.0]", 0),
            ("[-4.0, 505.0]", 5),
            ("[-5.0, 100.0]", 5),
            ("[5.0, -5.0]", 2),
        ],
    )
    def test_keeps_within_the_travel_of_the_profile(self, survey, tmp_path, travel, code):
        """Overrun included: a program that would run into a software limit is not written."""
        (tmp_path / "p.toml").write_text(
            f"[axes.X]\ntravel_mm = {travel}\n", encoding="utf-8"
        )
        told = stepdiag(
            "program",
            survey,
            "--controller",
            "siemens",
            "--profile",
            tmp_path / "p.toml",
            "--out",
            tmp_path / "nc",
        )
        assert told.code == code
        assert (tmp_path / "nc").exists() == (code == 0)
        assert code == 0 or "travel_mm" in told.refusal

    def test_an_unknown_control_is_refused(self, survey, tmp_path):
        told = stepdiag("program", survey, "--controller", "fagor", "--out", tmp_path / "nc")
        assert told.code == 2
        assert "fanuc, siemens, heidenhain, linuxcnc" in told.refusal


class TestPlan:
    def test_forecasts_and_ranks(self, survey):
        said = json.loads(stepdiag("plan", survey, "--json").out)
        assert [run["setup"] for run in said["forecast"]["runs"]] == [
            "ppp",
            "npp",
            "npp+1",
            "pnp",
            "ppn",
        ]
        assert said["forecast"]["runs"][2]["beam_offset_mm"] == [0.0, 0.0, 40.0]
        assert said["forecast"]["u"]["EXX"] > 0
        assert said["forecast"]["u"]["X"] is None, (
            "four diagonals cannot separate the three scales (theory 3)"
        )
        left = [each["left_um"]["value"] for each in said["front"]]
        assert len(left) <= 7
        assert all(then < 0.95 * now for now, then in itertools.pairwise(left)), (
            "a gain below 5 % is not printed"
        )
        assert said["best"] is None
        assert said["floor_um"] == 0.0, "no control is named"

    @pytest.mark.parametrize(("repeats", "named"), [(1, False), (2, True)])
    def test_orders_are_named_where_several_are_driven(self, repeats, named):
        run = Run(setup="ppp", repeats=repeats, axis_orders=("xyz", "yzx", "zxy"))
        drives = shown(lines_in_words(Plan(volume=BOX, runs=(run,))))
        assert ("in the axis orders xyz, yzx" in drives) is named
        assert "zxy" not in drives

    @pytest.mark.parametrize(("count", "row"), [(4, True), (5, False)])
    def test_a_row_names_few_lines_by_their_corners(self, count, row):
        """Many are counted; `--verbose` names each of them."""
        runs = tuple(Run(setup=name) for name in SETUP_NAMES[:count])
        plan = Plan(volume=BOX, runs=runs)
        diagonal = "diagonal X-Y+Z- to X+Y-Z+ (pnp)"
        assert (diagonal in shown(lines_in_words(plan, by_name=False))) is row
        assert diagonal in shown(lines_in_words(plan))

    def test_many_lines_are_counted_and_named_with_verbose(self, survey):
        """Corners of twenty lines fill half a screen; short names alone name no place."""
        survey.write_text(begun(MachineClass(), survey.name), encoding="utf-8")
        brief, whole = (
            " ".join(stepdiag("plan", survey, "--minutes", 240, *more).out.split())
            for more in ((), ("--verbose",))
        )
        assert re.search(r"BEST SURVEY for the request: \d+ step diagonals \(", brief)
        assert "BEST SURVEY for the request: diagonal X-Y-Z- to X+Y+Z+ (ppp), " in whole
        assert brief.startswith("diagonal X-Y-Z- to X+Y+Z+ (ppp), "), "seven lines are few"

    def test_for_a_person(self, survey):
        told = stepdiag("plan", survey, "--minutes", 125, "--verbose")
        assert "forecast: U (k = 2)" in told.out
        assert "recommended surveys" in told.out
        assert "diagonal X+Y-Z- to X-Y+Z+ (npp)" in told.out
        assert "BEST SURVEY" in told.out
        assert (
            "U (k = 2) assumes these sizes for errors that the readings do not determine. "
            "Machine: angular errors 15 µrad (range)" in told.out
        )

    def test_the_floor_that_the_control_sets_is_named(self, survey):
        """Tables of one input axis hold nothing of what angles do away from the middle."""
        stepdiag("profile", "fanuc", "--out", survey.with_name("fanuc.toml"))
        with survey.open("a", encoding="utf-8") as file:
            file.write('[[export]]\ncontroller = "fanuc"\nprofile = "fanuc.toml"\n')
        told = stepdiag("plan", survey, "--minutes", 90)
        assert re.search(
            r"tables that depend only on the position of one axis leave an error of 0\.\d+ µm",
            " ".join(told.out.split()),
        )

    def test_says_when_nothing_fits(self, survey):
        assert "No survey fits" in stepdiag("plan", survey, "--minutes", 10).out

    @pytest.mark.parametrize("option", ["--minutes", "--target-um"])
    def test_a_wish_below_zero_is_refused(self, survey, option):
        assert (stepdiag("plan", survey, option, -1).code) == 2

    def test_writes_its_advice_into_the_survey(self, survey):
        """The next of the list, without a wish; what is driven then is what the file says."""
        done = stepdiag("plan", survey, "--json", "--apply")
        said = json.loads(done.out)
        better = [
            each
            for each in said["front"]
            if each["left_um"]["value"] < 0.95 * said["forecast"]["left_um"]["value"]
        ]
        drives = ", ".join(run["setup"] for run in better[0]["runs"])
        assert (
            f"[plan] now contains {drives}; repeats = 1; {better[0]['increments']} increments"
            in done.refusal
        )
        again = json.loads(stepdiag("plan", survey, "--minutes", 15, "--json").out)[
            "forecast"
        ]
        assert [run["setup"] for run in again["runs"]] == [
            run["setup"] for run in better[0]["runs"]
        ]
        assert again["left_um"] == better[0]["left_um"]

    def test_the_advice_written_is_named_in_the_order_of_the_drive(self, survey):
        """A shifted line without its usual line comes after all setups on usual lines."""
        survey.write_text(begun(MachineClass(), survey.name), encoding="utf-8")
        done = stepdiag("plan", survey, "--minutes", 240, "--apply", "--verbose")
        plan = parse_survey(survey.read_text(encoding="utf-8"), survey.name).plan
        assert f"[plan] now contains {', '.join(plan.all_setups)};" in " ".join(
            done.refusal.split()
        )
        named = ", ".join(setup_words(each, "en") for each in plan.all_setups)
        assert f"BEST SURVEY for the request: {named}" in " ".join(done.out.split())
        assert (plan.axis_orders, plan.alternate_orders) == (ORDERS, True)

    def test_writes_nothing_where_nothing_fits(self, survey):
        before = survey.read_bytes()
        assert stepdiag("plan", survey, "--minutes", 10, "--apply").code == 2
        assert survey.read_bytes() == before


def _broken_at(count):
    """Return a stand-in for fsync that fails for lack of room at this call."""
    calls = []

    def fsync(_handle):
        calls.append(_handle)
        if len(calls) == count:
            raise OSError(28, "No space left on device")

    return fsync


COARSE = """\
[survey]
name = "coarse"
machine = "test"
[volume]
size_mm = [500.0, 400.0, 300.0]
increments = 4   # two days ago
[plan]
setups = ["ppp", "npp", "pnp", "ppn"]
[laser]
format = "umd"
port = "/dev/null"
"""


class TestAdviceThatCanBeFollowed:
    @pytest.mark.parametrize("asked", [("--minutes", 240), ("--target-um", 3)])
    def test_the_file_takes_what_it_is_advised(self, asked, tmp_path):
        """A head that the file does not name was advised, and refused when it was to be written."""
        path = tmp_path / "survey.toml"
        path.write_text(COARSE, encoding="utf-8")
        advice = json.loads(stepdiag("plan", path, *asked, "--json").out)
        assert not [
            run
            for each in (*advice["front"], advice["best"])
            for run in each["runs"]
            if "fourdof" in run["setup"]
        ]
        told = stepdiag("plan", path, *asked, "--apply")
        assert told.code == 0, told.refusal
        assert asked[0] == "--minutes" or "with a 4-DOF head along each axis," in " ".join(
            told.out.split()
        )
        again = json.loads(stepdiag("plan", path, "--minutes", 15, "--json").out)["forecast"]
        assert (again["increments"], again["left_um"]) == (
            advice["best"]["increments"],
            advice["best"]["left_um"],
        )
        assert again["minutes"] == pytest.approx(advice["best"]["minutes"])
        assert (
            f"increments = {advice['best']['increments']}   # two days ago"
            in path.read_text(encoding="utf-8")
        )
