"""Every option of a command changes what it prints or writes, or is refused: none is accepted and not used."""

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import typer.main

from stepdiag.cli.app import app
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.tables.fit import fitted
from stepdiag.solver.result.result import Result
from testkit.cli import Told, stepdiag
from testkit.exact.machines import profile_of, profile_text
from testkit.exact.results import VOLUME, made_result

GOLDEN = Path(__file__).parents[2] / "data" / "golden_stepdiag_rigidbody_FXYZ.csv"
ERRORS = {"EXX": [0, 3, 8, 12, 20], "EYY": [0, -9, -5, -12, -19], "EZZ": [0, 6, -4, 5, 9], "EYX": [0, 5, 8, 4, 0]}
SECTION = "[uncertainty]\nrepeatability_um = 4.0\n"
ANGLES = "axis,position_mm,EA_urad,EB_urad,EC_urad\n" + "".join(f"X,{x:g},{x * 0.05:g},0,0\n" for x in range(0, 1001, 100))
BOW = "position_mm,EYX_um,u_EYX_um\n" + "".join(f"{x:g},{40 - 0.00016 * (x - 500) ** 2:g},0.3\n" for x in range(0, 1001, 100))
SURVEY = """\
[survey]
name = "small"
machine = "test"
[volume]
size_mm = [200.0, 200.0, 200.0]
increments = 4
[plan]
setups = ["ppp", "npp", "pnp", "ppn"]
[laser]
format = "umd"
port = "/dev/null"
"""
STATED = {
    "--compensation": ["--compensation", "off"],
    "--active": ["--active", "active.ini"],
    "--active-date": ["--active-date", "2026-01-01"],
    "--active-source": ["--active-source", "archive"],
}
CALLS: dict[str, tuple[list[str], dict[str, list[str]]]] = {
    "solve": (
        ["solve", "readings.csv", "--out", "first.json"],
        {
            "--out": ["--out", "new.json"], "--method": ["--method", "least-squares"], "--chain": ["--chain", "XFYZ"],
            "--angles": ["--angles", "angles.csv"], "--straightness": ["--straightness", "bow.csv"],
            "--environment": ["--environment", "air.toml"], "--uncertainty": ["--uncertainty", "uncertainty.toml"],
            "--run": ["--run", "none.rtl"], "--monte-carlo": ["--monte-carlo", "1000"], "--json": ["--json"], **STATED,
        },
    ),
    "plan": (
        ["plan", "survey.toml"],
        {"--minutes": ["--minutes", "300"], "--target-um": ["--target-um", "40"], "--apply": ["--apply"], "--json": ["--json"]},
    ),
    "profile": (["profile", "siemens"], {"--out": ["--out", "new.toml"]}),
    "export": (
        ["export", "result.json", "--controller", "siemens", "--step-mm", "100", "--out", "out"],
        {
            "--controller": ["--controller", "neutral"], "--out": ["--out", "elsewhere"], "--profile": ["--profile", "profile.toml"],
            "--step-mm": ["--step-mm", "50"], "--accept": ["--accept", "no-such-code"], "--json": ["--json"], **STATED,
        },
    ),
    "verify": (
        ["verify", "result.json", "AX_EEC.INI"],
        {
            "--profile": ["--profile", "profile.toml"], "--diagonal": ["--diagonal", "none.rtl"], "--out": ["--out", "new.svg"],
            "--json": ["--json"], **STATED,
        },
    ),
    "compare": (
        ["compare", "result.json", "later.json"],
        {
            "--loaded": ["--loaded", "AX_EEC.INI"], "--profile": ["--profile", "profile.toml"], "--out": ["--out", "new"],
            "--letterhead": ["--letterhead", "head.toml"], "--pdf": ["--pdf"], "--language": ["--language", "de"], "--json": ["--json"],
        },
    ),
}  # fmt: skip
"""A call of each command that works on files alone, and every option of it with a value other than the call's own."""


def unstated() -> Result:
    """A result whose survey does not say whether a compensation was active."""
    made = made_result(ERRORS, squareness={"C0Y": 15.0, "B0Z": -12.0, "A0Z": 11.0}, u_um=0.1)
    return replace(made, extra={**made.extra, "survey": {}})


@pytest.fixture
def shop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a file of each kind, which is where the commands work."""
    result = unstated()
    profile = profile_of("siemens", VOLUME)
    plan = controller_named("siemens").plan(fitted(result, profile.machine.functions, profile.machine.squareness_into).curves, profile)
    for file in controller_named("siemens").render(plan.tables, profile):
        (tmp_path / file.name).write_bytes(file.data)
    x, y, z = (size / 4 for size in VOLUME.size_mm)
    texts = {
        "result.json": result.to_json(),
        "later.json": replace(result, errors={**result.errors, "EXX": result.errors["EYY"]}).to_json(),
        "profile.toml": profile_text("siemens", steps_mm=(x, y, z), references_mm=VOLUME.origin_mm, direction="mean"),
        "survey.toml": SURVEY,
        "angles.csv": ANGLES,
        "bow.csv": BOW,
        "air.toml": "[environment]\nair_temperature_c = 25.0\n",
        "uncertainty.toml": SECTION,
        "active.ini": "",
        "head.toml": 'name = "Workshop"\n',
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    shutil.copy(GOLDEN, tmp_path / "readings.csv")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def outcome(folder: Path, arguments: list[str]) -> tuple[Told, dict[Path, bytes]]:
    """What a call comes to: its end, its words and the files there afterwards."""
    told = stepdiag(*arguments)
    return told, {path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def _put_back(folder: Path, files: dict[Path, bytes]) -> None:
    """Bring a folder back to the files that it held."""
    shutil.rmtree(folder / "out", ignore_errors=True)
    for path in folder.iterdir():
        if path.is_file() and path.relative_to(folder) not in files:
            path.unlink()
    for path, data in files.items():
        (folder / path).write_bytes(data)


def options_of(name: str) -> set[str]:
    (command,) = (each for key, each in typer.main.get_command(app).commands.items() if key == name)
    return {parameter.opts[-1] for parameter in command.params if parameter.opts[-1].startswith("--")}


def cases() -> Iterator[tuple[str, str]]:
    yield from ((name, option) for name, (_, options) in CALLS.items() for option in options)


@pytest.mark.parametrize("name", sorted(CALLS))
def test_every_option_is_tried(name):
    stepdiag("--version")
    assert set(CALLS[name][1]) == options_of(name)


@pytest.mark.parametrize(("name", "option"), list(cases()))
def test_an_option_changes_what_comes_out_or_is_refused(name, option, shop):
    call, options = CALLS[name]
    before = outcome(shop, ["--version"])[1]
    plain = outcome(shop, call)
    _put_back(shop, before)
    if option in call:
        at = call.index(option)
        call = call[:at] + call[at + 2 :]
    assert outcome(shop, [*call, *options[option]]) != plain


@pytest.mark.parametrize(
    "given",
    [("--angles", "angles.csv"), ("--chain", "XFYZ"), ("--straightness", "bow.csv"), ("--uncertainty", "uncertainty.toml"),
     ("--monte-carlo", "1000"), ("--run", "none.rtl")],
)  # fmt: skip
def test_logs_take_no_option_of_readings(given, shop):
    """Angles beside logs were read by nobody: 3.5 um of uncertainty where they give 1.7."""
    told = stepdiag("solve", shop, *given)
    assert told.code == 2
    assert f"{given[0]}: expected one readings file (*.csv), found logs" in told.refusal


@pytest.mark.parametrize("method", ["least-squares", "wang2000"])
@pytest.mark.parametrize(
    "given",
    [("--angles", "angles.csv"), ("--straightness", "bow.csv"), ("--uncertainty", "uncertainty.toml"), ("--monte-carlo", "1000")],
)
def test_a_closed_form_takes_the_readings_alone(method, given, shop):
    assert stepdiag("solve", "readings.csv", "--method", method, *given).code == 2


@pytest.mark.parametrize("given", [("--active-date", "2026-01-01"), ("--active-source", "archive")])
@pytest.mark.parametrize("state", [(), ("--compensation", "off")])
def test_when_and_how_files_were_read_out_needs_the_files(given, state, shop):
    told = stepdiag("solve", "readings.csv", *state, *given)
    assert told.code == 2
    assert "--active" in told.refusal
