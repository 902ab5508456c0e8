"""``solve`` as a person and a program meet it, and how soon the command line is there."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from stepdiag.base.findings import Finding
from stepdiag.base.readings.readings import render_readings
from stepdiag.base.result.result import DISPLACEMENTS, ROTATIONS, parse_result
from stepdiag.terminal.tables import print_findings, print_tables
from testkit.cli import stepdiag
from testkit.exact.madeup import made_up_result
from testkit.exact.results import made_result
from testkit.exact.surveys import DIAGONALS, LINEAR, Bench

GOLDEN = Path(__file__).parents[2] / "data" / "golden_stepdiag_rigidbody_FXYZ.csv"


def cells(out: str, name: str) -> list[str]:
    """Return the cells of the row that begins with a name."""
    rows = (
        [cell.strip() for cell in line.strip("│ ").split("│")] for line in out.splitlines()
    )
    return next(row for row in rows if row[0] == name)


class TestSolve:
    def test_a_result_at_a_glance(self, tmp_path):
        told = stepdiag("solve", GOLDEN, "--out", tmp_path / "result.json", "--verbose")
        assert told.code == 0
        assert "volume of 1000 x 800 x 500 mm" in told.out
        assert float(cells(told.out, "EXX")[1]) == pytest.approx(16.22, abs=4.0), (
            "range of the shape, um; unknown angles make u 6 um"
        )
        assert cells(told.out, "EXX")[5] == "shape only"
        assert cells(told.out, "EYX")[5] == "yes"
        assert cells(told.out, "scale X") == ["scale X", "-", "-", "µm/m", "NO"]
        assert float(cells(told.out, "C0Y")[1]) == pytest.approx(-20.0, abs=1.1)
        assert float(cells(told.out, "diagonal X-Y-Z- to X+Y+Z+ (ppp)")[1]) == pytest.approx(
            0.4, abs=0.05
        ), "the mirror's tilt in mrad"
        assert "WARNING unidentified" in told.out

    def test_for_programs_it_prints_the_bytes_that_it_writes(self, tmp_path):
        told = stepdiag("solve", GOLDEN, "--out", tmp_path / "result.json", "--json")
        assert told.out == (tmp_path / "result.json").read_text(encoding="utf-8")
        assert parse_result(told.out).chain == "FXYZ"

    def test_a_result_is_never_overwritten(self, tmp_path):
        (tmp_path / "result.json").write_text("mine", encoding="utf-8")
        told = stepdiag("solve", GOLDEN, "--out", tmp_path / "result.json")
        assert told.code == 2
        assert (tmp_path / "result.json").read_text(encoding="utf-8") == "mine"

    @pytest.mark.parametrize(
        ("arguments", "code", "words"),
        [
            (("--method", "estimat"), 2, "did you mean 'estimate'?"),
            (("--chain", "XYZ"), 2, "chain"),
            (("--angles", "none.csv"), 2, "none.csv: expected a readable file"),
        ],
    )
    def test_wrong_usage_is_named(self, arguments, code, words):
        told = stepdiag("solve", GOLDEN, *arguments)
        assert told.code == code
        assert words in told.refusal

    def test_straightness_that_was_measured_otherwise_joins_the_readings(self, tmp_path):
        """A straightness far from the golden one contradicts the diagonals: named, and left out."""
        bow = "".join(
            f"{x:g},{40 - 0.00016 * (x - 500) ** 2:g},0.3\n" for x in range(0, 1001, 100)
        )
        (tmp_path / "s.csv").write_text(
            "position_mm,EYX_um,u_EYX_um\n" + bow, encoding="utf-8"
        )
        told = stepdiag("solve", GOLDEN, "--straightness", tmp_path / "s.csv", "--json")
        assert told.code == 0, told.err
        result = json.loads(told.out)
        assert result["head_straightness"]["EYX"]["passes"] == 1
        assert result["head_straightness"]["EYX"]["used"] is False
        assert [
            each["severity"]
            for each in result["findings"]
            if each["code"] == "straightness-misclosure"
        ] == ["error"]

    def test_logs_bring_their_own_straightness(self, tmp_path):
        told = stepdiag("solve", tmp_path, "--straightness", "s.csv")
        assert told.code == 2
        assert (
            "--straightness: expected one readings file (*.csv), found logs" in told.refusal
        )

    def test_a_survey_folder_stands_for_the_result_in_it(self, tmp_path):
        assert stepdiag("solve", GOLDEN, "--out", tmp_path / "result.json").code == 0
        asked = (
            "--controller",
            "neutral",
            "--step-mm",
            "100",
            "--accept",
            "unidentified",
            "--json",
        )
        by_folder, by_file = (
            stepdiag("export", tmp_path / at, *asked, "--out", tmp_path / "n")
            for at in ("", "result.json")
        )
        assert by_folder == by_file

    def test_what_a_result_is_solved_from_is_told_from_it(self, tmp_path):
        told = stepdiag("report", GOLDEN, "--out", tmp_path / "r.html")
        assert told.code == 2
        assert (
            f"`stepdiag solve {GOLDEN} --out result.json` writes such a file" in told.refusal
        )
        told = stepdiag("report", tmp_path, "--out", tmp_path / "r.html")
        assert told.code == 2
        assert f"`stepdiag status {tmp_path}` shows what is missing" in told.refusal

    def test_readings_that_are_no_survey_are_refused(self, tmp_path):
        (tmp_path / "r.csv").write_text(
            "setup,pass,stop,x_mm,y_mm,z_mm,reading_mm\nppp,1,0,0,0,0,0\nppp,1,2,100,100,100,173\n",
            encoding="utf-8",
        )
        told = stepdiag("solve", tmp_path / "r.csv")
        assert told.code == 3
        assert (
            "(ppp), pass 1 out, row with `stop = 2`: expected a move of one axis"
            in told.refusal
        )

    def test_a_laser_of_the_wrong_sign_is_named_with_the_file(self, tmp_path):
        """The reading is the column before the last one of the golden survey."""
        head, *rows = GOLDEN.read_text(encoding="utf-8").splitlines()[1:]
        turned = [
            [*cells[:6], str(-float(cells[6])), *cells[7:]]
            for cells in (row.split(",") for row in rows)
        ]
        (tmp_path / "turned.csv").write_text(
            "\n".join([head, *(",".join(cells) for cells in turned)]), encoding="utf-8"
        )
        told = stepdiag("solve", tmp_path / "turned.csv")
        assert told.code == 3
        assert told.refusal.startswith(
            "turned.csv: diagonal X-Y-Z- to X+Y+Z+ (ppp), pass 1 out: "
        )
        assert "sign = -1" in told.refusal

    def test_what_is_neither_readings_nor_logs_is_refused_by_name(self, tmp_path):
        (tmp_path / "readings.txt").write_bytes(GOLDEN.read_bytes())
        told = stepdiag("solve", tmp_path / "readings.txt")
        assert told.code == 2
        assert (
            "readings.txt: expected one readings file (*.csv), or logs (*.mcap)"
            in told.refusal
        )
        told = stepdiag("solve", tmp_path / "none.mcap")
        assert (told.code, told.refusal) == (
            2,
            (
                f"{tmp_path / 'none.mcap'}: expected a log (*.mcap) or a folder of logs, found "
                "nothing of this name"
            ),
        )


@pytest.mark.parametrize("group", [(), ("fourdof",)])
def test_the_list_of_commands_says_whole_sentences(group):
    """80 columns wide; what is too long the library cuts off with three dots."""
    told = stepdiag(*group, "--help")
    listed = told.out.partition("Commands:")[2].strip().splitlines()
    assert len(listed) > 5
    assert [line for line in listed if not line.endswith(".") or line.endswith("...")] == []


class TestResultTable:
    def test_what_is_not_identified_is_not_a_number(self, capsys):
        print_tables(made_result({"EYX": None}, squareness={"C0Y": None}))
        out = capsys.readouterr().out
        assert cells(out, "EYX") == ["EYX", "-", "-", "-", "µm", "NO"]
        assert cells(out, "C0Y")[-1] == "NO"

    def test_uncertainty_is_shown_expanded(self, capsys):
        """k = 2 (GUM 6.2): standard uncertainty 0.3 um, shown 0.60."""
        print_tables(made_result({"EXX": [0.0, 1.0, 2.0, 3.0, 8.0]}, u_um=0.3))
        out = capsys.readouterr().out
        assert cells(out, "EXX")[1:4] == ["3.00", "8.00", "0.60"], (
            "shape 0, -1, -2, -3, 0 um once the end-point line is removed"
        )

    def test_angles_stand_below_and_of_findings_the_worst_first(self, capsys):
        findings = (
            Finding(code="b", severity="info", text="[note]"),
            Finding(code="a", severity="error", text="worst"),
        )
        print_tables(made_up_result(angles=True))
        assert cells(capsys.readouterr().out, "ECZ")[4] == "µrad"
        print_findings(findings, verbose=True)
        assert capsys.readouterr().out.splitlines() == [
            "ERROR   a: worst",
            "note    b: [note]",
        ]
        print_findings(findings, verbose=False)
        assert capsys.readouterr().out.splitlines() == [
            "ERROR   a: worst",
            "1 note(s): --verbose prints them",
        ]

    def test_of_many_findings_of_a_code_the_first_two_stand_and_the_others_are_counted(
        self, capsys
    ):
        """Nine tables that end before the travel filled a screen; an error of the same code is not
        counted among the warnings."""
        alike = [Finding(code="a", severity="warning", text=f"axis {at}") for at in range(5)]
        findings = (*alike, Finding(code="a", severity="error", text="worst"))
        print_findings(findings, verbose=False)
        assert capsys.readouterr().out.splitlines() == [
            "ERROR   a: worst",
            "WARNING a: axis 0",
            "WARNING a: axis 1",
            "3 more findings with the code a: --verbose prints them",
        ]
        print_findings(findings, verbose=True)
        assert capsys.readouterr().out.count("WARNING a") == 5


def test_help_comes_at_once():
    """Contract: under 0.25 s. What takes long to load is not loaded for it."""
    code = (
        "import sys; from typer.testing import CliRunner; from stepdiag.cli.app import app, "
        "build; build();"
        "assert CliRunner().invoke(app, ['--help']).exit_code == 0;"
        "print([n for n in ('numpy', 'rich.table', 'msgspec', 'pymodbus', 'asyncio.base_events') "
        "if n in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.strip() == "[]"


def test_three_beam_offsets_give_all_eighteen_functions(tmp_path):
    """No switch: where the beam's places tell the angular functions apart, ``solve`` of a CSV
    reports them and says so."""
    offsets = {
        f"{name}+{k}": tuple(np.roll([50.0, 0.0, 0.0], k))
        for name in DIAGONALS
        for k in (1, 2)
    }
    bench = Bench(
        angle_urad=20.0,
        diagonal_noise_um=0.1,
        linear_noise_um=0.1,
        increments=6,
        beam_offset_mm=offsets,
    )
    (tmp_path / "r.csv").write_text(
        render_readings(bench.survey((*DIAGONALS, *offsets, *LINEAR))), encoding="utf-8"
    )
    told = stepdiag(
        "solve", tmp_path / "r.csv", "--out", tmp_path / "result.json", "--verbose"
    )
    assert told.code == 0, told.refusal
    result = parse_result((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert "angles-resolved" in {finding.code for finding in result.findings}
    for name in (*DISPLACEMENTS, *ROTATIONS):
        function, true = result.errors[name], bench.truth.errors[name]
        true = true if function.slope_identified else true - true[-1] * np.arange(7) / 6
        assert np.max(np.abs(function.value - true) - 5 * function.u) < 0.05, name
        assert name in told.out
