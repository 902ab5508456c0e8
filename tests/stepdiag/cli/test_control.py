"""``profile``, ``export``, ``verify`` and ``signtest`` as a service engineer meets them."""

import hashlib
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.readings.readings import make_readings, render_readings
from stepdiag.base.result.interval import Interval
from stepdiag.base.result.json_tree import Node
from stepdiag.base.result.typed import read, written
from stepdiag.exporters.profiles.file import load_profile
from stepdiag.exporters.profiles.registry import CONTROLLERS, controller_named
from stepdiag.exporters.safety.sign_test import bump
from stepdiag.exporters.tables.tables import total_correction_um
from testkit.cli import stepdiag
from testkit.exact.machines import profile_text
from testkit.exact.results import VOLUME, made_result

BENT = {"EXX": [0.0, 4.0, 8.0, 12.0, 16.0], "EYX": [0.0, 3.0, 5.0, 3.0, 0.0]}


@pytest.fixture
def result(tmp_path: Path) -> Path:
    path = tmp_path / "result.json"
    path.write_text(made_result(BENT, squareness={"C0Y": 20.0}).to_json(), encoding="utf-8")
    return path


@pytest.fixture
def profile(tmp_path: Path) -> Path:
    path = tmp_path / "siemens.toml"
    text = profile_text(
        "siemens",
        steps_mm=(50.0, 50.0, 25.0),
        references_mm=(-200.0, 0.0, -100.0),
        direction="mean",
    )
    path.write_text(text, encoding="utf-8")
    return path


class TestExport:
    def test_needs_neither_profile_nor_survey(self, result, tmp_path):
        """Contract 4: the quick look."""
        told = stepdiag(
            "export",
            result,
            "--controller",
            "siemens",
            "--out",
            tmp_path / "out",
            "--step-mm",
            50,
        )
        assert told.code == 0
        assert "WARNING sign-untested" in told.out
        assert (tmp_path / "out" / "AX_EEC_UNTESTED_SIGN.INI").is_file()
        assert (tmp_path / "out" / "AX_EEC_RESTORE.INI").is_file()

    def test_what_the_result_does_not_identify_is_named_with_its_file(self, tmp_path):
        path = tmp_path / "half.json"
        path.write_text(made_result({"EYX": None}).to_json(), encoding="utf-8")
        told = stepdiag(
            "export",
            path,
            "--controller",
            "siemens",
            "--out",
            tmp_path / "out",
            "--step-mm",
            50,
        )
        assert told.code == 3
        assert told.refusal.startswith(
            "half.json: errors.EYX: expected an identified function, found null"
        )
        assert not (tmp_path / "out").exists()

    def test_for_programs_names_every_file_with_its_hash(self, result, tmp_path):
        told = stepdiag(
            "export",
            result,
            "--controller",
            "siemens",
            "--out",
            tmp_path / "out",
            "--step-mm",
            50,
            "--json",
        )
        said = json.loads(told.out)
        assert {file["name"] for file in said["files"]} == {
            path.name for path in (tmp_path / "out").iterdir()
        }
        for file in said["files"]:
            assert (
                file["sha256"]
                == hashlib.sha256((tmp_path / "out" / file["name"]).read_bytes()).hexdigest()
            )
        assert said["predicted"]["without_rigid_motion"]["after"]["largest_um"]["value"] < 1.0

    def test_a_warning_refuses_with_5_until_it_is_accepted_by_name(self, tmp_path):
        path = tmp_path / "result.json"
        path.write_text(
            made_result({"EXX": [0.0, 60.0, 120.0, 180.0, 240.0]}).to_json(), encoding="utf-8"
        )
        arguments = (
            "export",
            path,
            "--controller",
            "siemens",
            "--out",
            tmp_path / "out",
            "--step-mm",
            50,
        )
        told = stepdiag(*arguments)
        assert told.code == 5
        assert "accept this finding by its code: value-large" in told.refusal
        assert not (tmp_path / "out").exists()
        assert stepdiag(*arguments, "--accept", "value-large").code == 0

    @pytest.mark.parametrize("off_mm", [1e-4, 2e-3, -5e-3])
    @pytest.mark.parametrize("controller", sorted({*CONTROLLERS, "lattice"} - {"fanuc"}))
    def test_a_box_a_digit_or_g91_beside_whole_steps_has_tables_in_whole_steps(
        self, controller, off_mm, tmp_path
    ):
        sizes = (
            VOLUME.size_mm[0] + off_mm,
            VOLUME.size_mm[1] - off_mm,
            VOLUME.size_mm[2] + off_mm,
        )
        volume = replace(VOLUME, size_mm=sizes)
        path, out = tmp_path / "result.json", tmp_path / "out"
        path.write_text(
            made_result(BENT, squareness={"C0Y": 20.0}, volume=volume).to_json(),
            encoding="utf-8",
        )
        told = stepdiag(
            "export", path, "--controller", controller, "--out", out, "--step-mm", 50
        )
        assert told.code == 0, told.refusal
        assert stepdiag("verify", path, out).code == 0
        if controller != "lattice" and (report := out / "EXPORT_REPORT.txt").is_file():
            assert "-200 to 200 mm, step 50" in report.read_text(encoding="utf-8")

    @pytest.mark.parametrize("off_mm", [0.02, -0.5])
    def test_a_box_further_beside_whole_steps_is_refused(self, off_mm, tmp_path):
        path = tmp_path / "result.json"
        volume = replace(VOLUME, size_mm=(VOLUME.size_mm[0] + off_mm, *VOLUME.size_mm[1:]))
        path.write_text(made_result(BENT, volume=volume).to_json(), encoding="utf-8")
        told = stepdiag(
            "export",
            path,
            "--controller",
            "siemens",
            "--out",
            tmp_path / "out",
            "--step-mm",
            50,
        )
        assert told.code == 5
        assert "into whole sections" in told.refusal

    def test_an_unknown_control_meets_the_nearest(self, result, tmp_path):
        told = stepdiag(
            "export",
            result,
            "--controller",
            "simens",
            "--out",
            tmp_path / "out",
            "--step-mm",
            50,
        )
        assert (told.code, told.refusal) == (
            2,
            "--controller: expected a known controller, found simens; did you mean siemens?",
        )

    def test_what_the_data_do_not_identify_is_not_exported(self, tmp_path):
        path = tmp_path / "result.json"
        path.write_text(made_result({"EXX": None}).to_json(), encoding="utf-8")
        told = stepdiag(
            "export",
            path,
            "--controller",
            "siemens",
            "--out",
            tmp_path / "out",
            "--step-mm",
            50,
        )
        assert told.code == 3
        assert "errors.EXX" in told.refusal

    def test_a_lattice_takes_a_step_and_no_profile(self, result, profile, tmp_path):
        assert (
            stepdiag(
                "export",
                result,
                "--controller",
                "lattice",
                "--out",
                tmp_path / "out",
                "--step-mm",
                50,
            ).code
            == 0
        )
        told = stepdiag(
            "export",
            result,
            "--controller",
            "lattice",
            "--out",
            tmp_path / "b",
            "--profile",
            profile,
        )
        assert told.code == 2
        assert "--step-mm alone" in told.refusal


class TestVerify:
    def exported(self, result: Path, tmp_path: Path, controller: str) -> Path:
        out = tmp_path / controller
        assert (
            stepdiag(
                "export", result, "--controller", controller, "--out", out, "--step-mm", 25
            ).code
            == 0
        )
        return out

    @pytest.mark.parametrize("controller", sorted({*CONTROLLERS, "lattice"} - {"fanuc"}))
    def test_reads_the_folder_of_an_export_and_leaves_notes_and_restore_files_aside(
        self, result, tmp_path, controller
    ):
        said = json.loads(
            stepdiag(
                "verify", result, self.exported(result, tmp_path, controller), "--json"
            ).out
        )
        assert said["controller"] == controller
        assert "EXPORT_REPORT.txt" in said["left_aside"]
        before, after = (
            said["predicted"]["without_rigid_motion"][when]["rms_um"]
            for when in ("before", "after")
        )
        assert after["value"] < before["value"] / 2
        assert set(after) == {"value", "low", "high"}

    def test_the_restore_files_alone_change_nothing(self, result, tmp_path):
        out = self.exported(result, tmp_path, "siemens")
        said = json.loads(
            stepdiag("verify", result, *sorted(out.glob("*_RESTORE.INI")), "--json").out
        )
        before, after = (
            said["predicted"]["without_rigid_motion"][when]["rms_um"]["value"]
            for when in ("before", "after")
        )
        assert after == pytest.approx(before)

    def test_says_what_it_found_and_what_the_figures_leave_out(self, result, tmp_path):
        told = stepdiag(
            "verify", result, self.exported(result, tmp_path, "siemens"), "--verbose"
        )
        assert "cec: a positive value moves the axis in - (as-error)" in told.out
        assert (
            "computed errors do not include them: the scale of X, the scale of Y, the scale of Z"
            in told.out
        )
        assert "worse-after" not in told.out

    def test_says_what_u_takes_for_granted(self, result, tmp_path):
        found = json.loads(result.read_text(encoding="utf-8"))
        said = tmp_path / "said.json"
        said.write_text(
            json.dumps({**found, "assumed": written(Assumptions(angles_urad=7.0).stated())}),
            encoding="utf-8",
        )
        exported = stepdiag(
            "export",
            said,
            "--controller",
            "siemens",
            "--step-mm",
            25,
            "--out",
            tmp_path / "out",
            "--verbose",
        )
        for told in (exported, stepdiag("verify", said, tmp_path / "out", "--verbose")):
            assert (
                "U (k = 2) assumes these sizes for errors that the readings do not determine. "
                "Machine: angular errors 7 µrad (range)" in told.out
            )

    def test_files_with_the_wrong_sign_are_named(self, result, tmp_path):
        out = self.exported(result, tmp_path, "neutral")
        text = (out / "curves.csv").read_text(encoding="ascii")
        turned = re.sub(
            r",(-?)(\d+\.\d{3})$",
            lambda found: f",{'' if found[1] else '-'}{found[2]}",
            text,
            flags=re.MULTILINE,
        )
        (tmp_path / "curves.csv").write_text(turned, encoding="ascii")
        told = stepdiag("verify", result, tmp_path / "curves.csv")
        assert (
            told.code,
            "WARNING worse-after" in told.out,
            "WRONG sign-turned" in told.out,
        ) == (
            5,
            True,
            True,
        )
        told = stepdiag("verify", result, tmp_path / "curves.csv", "--json")
        said = json.loads(told.out)
        assert (told.code, said["verdict"]) == (5, "wrong")
        assert "sign-turned" in {table["verdict"] for table in said["tables"]}

    def test_right_files_are_said_to_be_right(self, result, tmp_path):
        told = stepdiag(
            "verify", result, self.exported(result, tmp_path, "siemens"), "--json"
        )
        said = json.loads(told.out)
        assert (told.code, said["verdict"]) == (0, "right")
        assert {table["verdict"] for table in said["tables"]} == {"right"}

    def test_a_set_that_somebody_changed_is_refused(self, result, tmp_path):
        out = self.exported(result, tmp_path, "siemens")
        (out / "AX_EEC_UNTESTED_SIGN.INI").write_bytes(b"")
        told = stepdiag("verify", result, out)
        assert (told.code, "expected the bytes that the export wrote" in told.refusal) == (
            5,
            True,
        )

    @pytest.mark.parametrize(
        ("name", "begins"), [("p.svg", b"<svg"), ("p.html", b"<!doctype html>")]
    )
    def test_draws_before_and_after(self, result, tmp_path, name, begins):
        told = stepdiag(
            "verify",
            result,
            self.exported(result, tmp_path, "siemens"),
            "--out",
            tmp_path / name,
        )
        picture = (tmp_path / name).read_bytes()
        assert told.code == 0
        assert picture.startswith(begins)
        assert picture.count(b'class="turns"') == 2
        assert b"http://" not in picture.replace(b"http://www.w3.org/2000/svg", b"")

    def test_the_picture_tells_the_intervals_of_the_table_and_not_what_tables_leave_of_the_fit(
        self, result, tmp_path
    ):
        out = self.exported(result, tmp_path, "siemens")
        figures = json.loads(stepdiag("verify", result, out, "--json").out)["predicted"][
            "without_rigid_motion"
        ]
        stepdiag("verify", result, out, "--out", tmp_path / "p.svg")
        picture = (tmp_path / "p.svg").read_text(encoding="utf-8")
        for name, when in (("before", "before"), ("after, predicted", "after")):
            rms, largest = (
                read(Node(figures[when][figure], "verify", figure), Interval)
                for figure in ("rms_um", "largest_um")
            )
            assert (
                f"{name}: rms {rms.words()} µm, largest {largest.bound()} µm (k = 2)"
                in picture
            )

    def test_a_picture_of_another_kind_is_refused(self, result, tmp_path):
        out = self.exported(result, tmp_path, "neutral")
        told = stepdiag("verify", result, out, "--out", tmp_path / "p.png")
        assert (told.code, told.refusal) == (
            2,
            "--out: expected a file named *.svg or *.html, found p.png",
        )

    def test_a_folder_without_files_of_a_control_is_refused_by_name(self, result, tmp_path):
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "EXPORT_REPORT.txt").write_text(
            "no file was written", encoding="ascii"
        )
        told = stepdiag("verify", result, tmp_path / "out")
        assert told.code == 3
        assert told.refusal.startswith(
            f"{tmp_path / 'out'}: expected a folder that an export wrote, with its SHA256SUMS"
        )

    def test_a_foreign_file_is_refused_by_name(self, result, tmp_path):
        (tmp_path / "x.csv").write_text("a,b\n", encoding="ascii")
        told = stepdiag("verify", result, tmp_path / "x.csv")
        assert told.code == 3
        assert told.refusal.startswith("x.csv: expected a compensation file")


class TestProfile:
    @pytest.mark.parametrize("controller", sorted(CONTROLLERS))
    def test_is_printed_or_written_and_never_over_a_file(self, tmp_path, controller):
        path = tmp_path / "p.toml"
        assert stepdiag("profile", controller, "--out", path).code == 0
        assert stepdiag("profile", controller).out == path.read_text(encoding="utf-8")
        assert stepdiag("profile", controller, "--out", path).code == 2

    def test_its_questions_refuse_an_export(self, result, tmp_path):
        path = tmp_path / "p.toml"
        stepdiag("profile", "siemens", "--out", path)
        told = stepdiag(
            "export",
            result,
            "--controller",
            "siemens",
            "--profile",
            path,
            "--out",
            tmp_path / "out",
        )
        assert told.code == 2
        assert "p.toml: machine.name" in told.refusal


class TestReadBack:
    """Files that were read out of the control are compared with those that were written."""

    def exported(self, result: Path, tmp_path: Path) -> Path:
        assert (
            stepdiag(
                "export",
                result,
                "--controller",
                "siemens",
                "--out",
                tmp_path / "out",
                "--step-mm",
                50,
            ).code
            == 0
        )
        return tmp_path / "out"

    def held(self, folder: Path, tmp_path: Path, switches: str) -> Path:
        """Return the tables of an export as a control would write them out, with switches."""
        texts = [
            path.read_text(encoding="ascii").replace("M17\n", "")
            for path in sorted(folder.glob("*_UNTESTED_SIGN.INI"))
        ]
        path = tmp_path / "STEPDIAG_BACK.INI"
        lines = [line for text in texts for line in text.splitlines() if line.startswith("$")]
        path.write_text("\n".join([*lines, switches, "M17", ""]), encoding="ascii")
        return path

    def switches(self, folder: Path) -> str:
        names = re.findall(
            r'"(\$(?:SN_CEC_TABLE|MA)[A-Z_]+\[[^]]*\])="',
            (folder / "READ_BACK.MPF").read_text(encoding="ascii"),
        )
        return "\n".join(f"{name}=1" for name in names)

    def test_as_written(self, result, tmp_path):
        folder = self.exported(result, tmp_path)
        told = stepdiag(
            "verify",
            result,
            folder,
            "--read-back",
            self.held(folder, tmp_path, self.switches(folder)),
        )
        assert told.code == 0, told.out
        assert re.search(
            r"read back: \d+ numbers and 18 switches and weights of the control's tables agree",
            told.out,
        )

    def test_a_table_that_is_off_is_wrong(self, result, tmp_path):
        folder = self.exported(result, tmp_path)
        off = self.switches(folder).replace(
            "$SN_CEC_TABLE_ENABLE[2]=1", "$SN_CEC_TABLE_ENABLE[2]=0"
        )
        told = stepdiag(
            "verify",
            result,
            folder,
            "--read-back",
            self.held(folder, tmp_path, off),
            "--json",
        )
        assert told.code == 5
        (found,) = json.loads(told.out)["read_back"]["findings"]
        assert (
            found["text"]
            == "SN_CEC_TABLE_ENABLE[2] is 0 in the control, but the tables act only with 1"
        )

    def test_before_loading_the_control_holds_what_the_profile_names(self, result, tmp_path):
        """Here it names nothing: tables in the control are not to be written over."""
        folder = self.exported(result, tmp_path)
        held = self.held(folder, tmp_path, self.switches(folder))
        told = stepdiag("verify", result, folder, "--before", held)
        assert told.code == 5
        assert "Do not load" in told.out
        told = stepdiag("verify", result, folder, "--before", held, "--read-back", held)
        assert told.code == 2

    def test_without_the_files_of_the_export_there_is_nothing_to_compare(
        self, result, tmp_path
    ):
        told = stepdiag("verify", result, "--read-back", result)
        assert told.code == 2
        assert "--read-back: expected the files of the export" in told.refusal


class TestSignTest:
    positions = np.linspace(-200.0, 200.0, 17)

    def arguments(self, profile: Path, result: Path) -> tuple[object, ...]:
        return "signtest", "--controller", "siemens", "--profile", profile, "--result", result

    def runs(self, profile: Path, tmp_path: Path, sense: float) -> tuple[Path, Path]:
        """Write the readings of X with the table off and on, by a control that follows the stated
        law times ``sense``."""
        test = bump(
            controller_named("siemens"),
            load_profile(profile, controller_named("siemens"), VOLUME),
            "EXX",
        )
        points = np.column_stack([self.positions, np.zeros(17), np.zeros(17)])
        moved = sense * total_correction_um(test.tables, points)[:, 0]
        paths = tmp_path / "off.csv", tmp_path / "on.csv"
        for path, by in zip(paths, (0 * moved, moved), strict=True):
            reading = (
                self.positions
                - self.positions[0]
                + 1e-3 * (0.5 * np.sin(self.positions) + by)
            )
            rows = make_readings(
                setup=["linear-x"] * 17,
                pass_number=[1] * 17,
                stop=range(17),
                position_mm=points,
                reading_mm=reading,
            )
            path.write_text(render_readings(rows), encoding="utf-8")
        return paths

    def test_writes_bump_restore_files_and_the_steps(self, profile, result, tmp_path):
        told = stepdiag(*self.arguments(profile, result), "--out", tmp_path / "bump")
        assert told.code == 0
        names = {path.name for path in (tmp_path / "bump").iterdir()}
        assert {"AX_EEC.INI", "AX_EEC_RESTORE.INI", "SIGNTEST.txt"} <= names
        assert "X moves by -10.0 µm" in (tmp_path / "bump" / "SIGNTEST.txt").read_text(
            encoding="utf-8"
        )

    def test_its_last_step_is_a_command_that_works_as_it_stands(
        self, profile, result, tmp_path, monkeypatch
    ):
        """With profile and result as they were given, which may stand in other folders; without
        --result it was refused, where the profile leaves the ends to the survey."""
        stepdiag(*self.arguments(profile, result), "--out", tmp_path / "bump")
        step = (
            (tmp_path / "bump" / "SIGNTEST.txt").read_text(encoding="utf-8").splitlines()[-1]
        )
        words = step.split("stepdiag ")[1].partition(" (")[0].split()
        off, on = self.runs(profile, tmp_path, 1.0)
        monkeypatch.chdir(tmp_path / "bump")
        told = stepdiag(*[{"OFF.csv": off, "ON.csv": on}.get(word, word) for word in words])
        assert told.code == 0, told.refusal

    def test_without_result_the_profile_must_say_where_the_table_ends(
        self, profile, tmp_path
    ):
        told = stepdiag(
            "signtest",
            "--controller",
            "siemens",
            "--profile",
            profile,
            "--out",
            tmp_path / "bump",
        )
        assert told.code == 2
        assert "start_mm and end_mm" in told.refusal
        assert "give --result" in told.refusal

    @pytest.mark.parametrize(
        ("sense", "verdict"), [(1.0, "as-error"), (-1.0, "as-compensation")]
    )
    def test_two_runs_give_the_record_for_the_profile(
        self, profile, result, tmp_path, sense, verdict
    ):
        off, on = self.runs(profile, tmp_path, sense)
        told = stepdiag(
            *self.arguments(profile, result), "--off", off, "--on", on, "--date", "2026-05-31"
        )
        assert told.code == 0
        assert (
            f'kind = "eec"\ndate = 2026-05-31\nverdict = "{verdict}"\nmachine = "test '
            'machine"\ncontrol = "siemens"' in told.out
        )
        hashes = [hashlib.sha256(path.read_bytes()).hexdigest() for path in (off, on)]
        assert f"runs_sha256 = {json.dumps(hashes)}" in told.out
        assert ("every export is refused until" in told.out) == (verdict == "as-compensation")

    def test_swapped_runs_are_refused_by_name(self, profile, result, tmp_path):
        """They were recorded as the opposite sense, and a machine went from 7.46 to 9.28 um."""
        off, on = self.runs(profile, tmp_path, 1.0)
        told = stepdiag(*self.arguments(profile, result), "--off", on, "--on", off)
        assert told.code == 3
        assert "the two runs are swapped" in told.refusal

    def test_without_the_curve_of_the_survey_there_is_no_verdict(self, profile, tmp_path):
        off, on = self.runs(profile, tmp_path, 1.0)
        full = profile.with_name("full.toml")
        ends = 'name = "{0}"\nstart_mm = {1}\nend_mm = {2}'
        text = profile.read_text(encoding="utf-8")
        for name, low, high in (
            ("AX1", -200.0, 200.0),
            ("AX2", 0.0, 400.0),
            ("AX3", -100.0, 100.0),
        ):
            text = text.replace(f'name = "{name}"', ends.format(name, low, high))
        full.write_text(text, encoding="utf-8")
        told = stepdiag(
            "signtest", "--controller", "siemens", "--profile", full, "--off", off, "--on", on
        )
        assert told.code == 2
        assert "--result: expected the result of the survey" in told.refusal

    def test_a_table_that_was_not_active_decides_nothing(self, profile, result, tmp_path):
        off, on = self.runs(profile, tmp_path, 0.0)
        told = stepdiag(*self.arguments(profile, result), "--off", off, "--on", on)
        assert told.code == 3
        assert "the table is not active" in told.refusal

    def test_a_cross_table_is_seen_with_a_dial(self, profile, result, tmp_path):
        run = tmp_path / "run.csv"
        bow = np.interp(self.positions, VOLUME.nodes_mm(0), BENT["EYX"])
        run.write_text(
            "position_mm,off_um,on_um\n"
            + "".join(
                f"{at:g},{um},{um}\n" for at, um in zip(self.positions, bow, strict=True)
            )
        )
        arguments = (*self.arguments(profile, result), "--function", "EYX")
        assert "not active" in stepdiag(*arguments, "--run", run).refusal
        assert (
            "a linear run measures only its own axis"
            in stepdiag(*arguments, "--off", run, "--on", run).refusal
        )

    @pytest.mark.parametrize(
        "extra", [(), ("--off", "a.csv"), ("--off", "a.csv", "--out", "b")]
    )
    def test_half_a_request_is_refused(self, profile, result, extra):
        told = stepdiag(*self.arguments(profile, result), *extra)
        assert told.code == 2
        assert "--out DIR to write the table with the bump" in told.refusal
