"""What `stepdiag proof` refuses, and the survey file that it writes: everything that measures stays
as the person wrote it."""

from datetime import date

import pytest

from stepdiag.base.errors import UsageError
from stepdiag.cli.proof import print_verdict
from stepdiag.daq.survey.amended import as_proof
from stepdiag.daq.survey.file import parse_survey
from stepdiag.daq.survey.models import Plan, Proof
from stepdiag.exporters.proof.judge import Proof as Verdict
from stepdiag.exporters.proof.judge import Proved
from testkit.cli import stepdiag

SURVEY = """\
# the mill
[survey]
name = "mill"   # as on the plate
machine = "Mill 3"
[volume]
size_mm = [500.0, 400.0, 300.0]
increments = 10
[plan]
setups = ["ppp", "npp", "pnp", "ppn", "linear-x"]
axis_orders = [
  "xyz",
  "zyx",
]
[machine]
chain = "XYFZ"
compensation = "on"
active = [
  "old.INI",
  "older.INI",
]
active_date = 2026-01-31
active_source = "archive"
[solver]
angles = "angles.csv"
[laser]
format = "umd"
port = "/dev/null"
latency_s = 0.02
[[export]]
controller = "siemens"
profile = "siemens.toml"
"""
PROOF = Proof(
    controller="siemens",
    result="mill/0001/result.json",
    readings="mill/0001/readings.csv",
    profile="siemens.toml",
)


def amended(text: str = SURVEY) -> str:
    plan = Plan(setups=("npp", "linear-x"), repeats=2)
    return as_proof(
        text,
        "survey.toml",
        name="mill-proof-0001",
        plan=plan,
        active=["mill/0001/exports/A.INI"],
        day=date(2026, 2, 1),
        proof=PROOF,
    )


def test_the_survey_file_of_a_proof_run_keeps_all_that_measures() -> None:
    before, after = (
        parse_survey(SURVEY, "survey.toml"),
        parse_survey(amended(), "survey.toml"),
    )
    assert after.proof == PROOF
    assert (after.identity.name, after.identity.machine) == ("mill-proof-0001", "Mill 3")
    assert (after.plan.setups, after.plan.repeats, after.plan.axis_orders) == (
        ("npp", "linear-x"),
        2,
        (),
    )
    assert (after.machine.compensation, after.machine.active) == (
        "on",
        ("mill/0001/exports/A.INI",),
    )
    assert (after.machine.active_date, after.machine.chain) == (date(2026, 2, 1), "XYFZ")
    assert (after.exports, after.solver.angles) == ((), "")
    assert (after.laser, after.box, after.plc) == (before.laser, before.box, before.plc)
    assert not after.plan.propose_next, "a proof run ends with its verdict"
    assert "# the mill" in amended()
    assert parse_survey(amended(amended()), "survey.toml") == after


def test_a_survey_file_without_these_sections_gets_them() -> None:
    less = (
        SURVEY[: SURVEY.index("[machine]")]
        + SURVEY[SURVEY.index("[laser]") : SURVEY.index("[[export]]")]
    )
    assert parse_survey(amended(less), "survey.toml").machine.compensation == "on"


def test_a_proof_run_of_a_plan_that_the_survey_cannot_hold_is_refused() -> None:
    with pytest.raises(UsageError, match="nonsense"):
        as_proof(
            SURVEY,
            "survey.toml",
            name="m",
            plan=Plan(setups=("nonsense",)),
            active=["A.INI"],
            day=date(2026, 2, 1),
            proof=PROOF,
        )


def test_what_is_missing_is_named(tmp_path) -> None:
    for name in ("siemens.toml", "angles.csv", "old.INI", "older.INI"):
        (tmp_path / name).write_text("", encoding="utf-8")
    survey, proof = tmp_path / "survey.toml", tmp_path / "survey-proof.toml"
    survey.write_text(SURVEY, encoding="utf-8")
    for options, named in (
        ((), "--controller"),
        (("--controller", "siemens", "--minutes", "0"), "--minutes"),
        (("--controller", "siemens"), "a survey with a result"),
    ):
        done = stepdiag("proof", survey, *options)
        assert (done.code, named in done.refusal) == (2, True), done
    for name in (PROOF.result, PROOF.readings, "mill/0001/exports/A.INI"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("", encoding="utf-8")
    proof.write_text(amended(), encoding="utf-8")
    for options, named in (((), "complete"), (("--out", tmp_path / "programs"), "--out")):
        done = stepdiag("proof", proof, *options)
        assert (done.code, named in done.refusal) == (2, True), done


def test_a_verdict_begins_with_the_action_and_fits_a_screen(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The states of nine tables, and the records in place of sign tests, follow with
    ``--verbose``."""
    monkeypatch.setenv("COLUMNS", "80")
    tables = tuple(
        Proved(function=name, kind="eec", factor=1.0, u=0.05, code="right", seen_um=5.0)
        for name in ("EXX", "EYY", "EZZ", "EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ")
    )
    records = ["[[sign_tests]]" + "\nline" * 9] * 2
    printed = {}
    for verbose in (False, True):
        print_verdict(Verdict(tables=tables, sigma_um=0.3), [], records, verbose=verbose)
        printed[verbose] = capsys.readouterr().out.splitlines()
    assert all(
        lines[0].startswith("the tables act as exported") for lines in printed.values()
    )
    assert len(printed[False]) <= 30 < len(printed[True])
    assert ["[[sign_tests]]" in lines for lines in printed.values()] == [False, True]
    assert any("2 profile entries" in line for line in printed[False])
