"""Every option of a command changes what it prints or writes, or is refused: none is accepted and
not used."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer.main

from stepdiag.base.result.result import Result
from stepdiag.cli import LINUX_ONLY
from stepdiag.cli.app import app
from stepdiag.exporters.neutral import etalon
from stepdiag.exporters.profiles.file import parse_profile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.safety.sign_test import bump
from stepdiag.exporters.tables.fit import fitted
from stepdiag.exporters.tables.tables import total_correction_um
from stepdiag.fleet.archive import add as archived
from stepdiag.fleet.store import Store
from stepdiag.fourdof.record import HeadRecord, render_head_csv
from stepdiag.virtual.instruments.head import (
    Disturbance,
    HeadOptics,
    HeadStand,
    VirtualHead,
    Wander,
)
from testkit.cli import Told, stepdiag
from testkit.elsewhere import contents, put_back
from testkit.exact.heads import write_head_file
from testkit.exact.machines import profile_of, profile_text
from testkit.exact.results import VOLUME, made_result
from testkit.fleets import finished_survey, write_history
from testkit.ordinary.heads import stage_pose
from testkit.planned import plan_once

Outcome = tuple[Told, dict[Path, bytes]]
GOLDEN = Path(__file__).parents[2] / "data" / "golden_stepdiag_rigidbody_FXYZ.csv"
ERRORS = {
    "EXX": [0, 3, 8, 12, 20],
    "EYY": [0, -9, -5, -12, -19],
    "EZZ": [0, 6, -4, 5, 9],
    "EYX": [0, 5, 8, 4, 0],
}
SECTION = "[uncertainty]\nrepeatability_um = 4.0\n"
ANGLES = "axis,position_mm,EA_urad,EB_urad,EC_urad\n" + "".join(
    f"X,{x:g},{x * 0.05:g},0,0\n" for x in range(0, 1001, 100)
)
BOW = "position_mm,EYX_um,u_EYX_um\n" + "".join(
    f"{x:g},{40 - 0.00016 * (x - 500) ** 2:g},0.3\n" for x in range(0, 1001, 100)
)
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
            "--out": ["--out", "new.json"],
            "--method": ["--method", "least-squares"],
            "--chain": ["--chain", "XFYZ"],
            "--angles": ["--angles", "angles.csv"],
            "--straightness": ["--straightness", "bow.csv"],
            "--environment": ["--environment", "air.toml"],
            "--uncertainty": ["--uncertainty", "uncertainty.toml"],
            "--tolerance": ["--tolerance", "tolerance.toml"],
            "--run": ["--run", "none.rtl"],
            "--monte-carlo": ["--monte-carlo", "1000"],
            "--verbose": ["--verbose"],
            "--json": ["--json"],
            **STATED,
        },
    ),
    "plan": (
        ["plan", "survey.toml"],
        {
            "--minutes": ["--minutes", "40"],
            "--target-um": ["--target-um", "40"],
            "--apply": ["--apply"],
            "--verbose": ["--verbose"],
            "--json": ["--json"],
        },
    ),
    "profile": (["profile", "siemens"], {"--out": ["--out", "new.toml"]}),
    "export": (
        [
            "export",
            "result.json",
            "--controller",
            "siemens",
            "--step-mm",
            "100",
            "--out",
            "out",
        ],
        {
            "--controller": ["--controller", "neutral"],
            "--out": ["--out", "elsewhere"],
            "--profile": ["--profile", "profile.toml"],
            "--step-mm": ["--step-mm", "50"],
            "--accept": ["--accept", "no-such-code"],
            "--json": ["--json"],
            "--verbose": ["--verbose"],
            **STATED,
        },
    ),
    "verify": (
        ["verify", "result.json", "AX_EEC.INI"],
        {
            "--profile": ["--profile", "profile.toml"],
            "--diagonal": ["--diagonal", "none.rtl"],
            "--out": ["--out", "new.svg"],
            "--custody": ["--custody", "."],
            "--key-certificate": ["--key-certificate", "none.pem"],
            "--json": ["--json"],
            "--verbose": ["--verbose"],
            "--before": ["--before", "AX_EEC.INI"],
            "--read-back": ["--read-back", "AX_EEC.INI"],
            **STATED,
        },
    ),
    "compare": (
        ["compare", "result.json", "later.json"],
        {
            "--loaded": ["--loaded", "AX_EEC.INI"],
            "--profile": ["--profile", "profile.toml"],
            "--out": ["--out", "new"],
            "--letterhead": ["--letterhead", "paper.toml"],
            "--pdf": ["--pdf"],
            "--language": ["--language", "de"],
            "--json": ["--json"],
        },
    ),
    "report": (
        ["report", "result.json", "AX_EEC.INI"],
        {
            "--out": ["--out", "new.html"],
            "--readings": ["--readings", "readings.csv"],
            "--profile": ["--profile", "none.toml"],
            "--as-left": ["--as-left", "later.json"],
            "--letterhead": ["--letterhead", "paper.toml"],
            "--pdf": ["--pdf"],
            "--laboratory": ["--laboratory", "signed.toml"],
            "--language": ["--language", "de"],
            "--json": ["--json"],
        },
    ),
    "certificate": (
        ["certificate", "result.json", "--laboratory", "laboratory.toml", "--out", "c.xml"],
        {
            "--out": ["--out", "new.xml"],
            "--laboratory": ["--laboratory", "other.toml"],
            "--as-left": ["--as-left", "later.json"],
            "--report": ["--report", "paper.toml"],
            "--key": ["--key", "none.pem"],
            "--key-certificate": ["--key-certificate", "none.pem"],
            "--letterhead": ["--letterhead", "paper.toml"],
            "--profile": ["--profile", "profile.toml"],
            "--pdf": ["--pdf", "c.pdf"],
        },
    ),
    "import": (
        ["import", "etalon.txt", "--chain", "FXYZ", "--out", "taken.json"],
        # tests/stepdiag/fourdof/test_tables.py tries --map
        {"--chain": ["--chain", "XFYZ"], "--out": ["--out", "elsewhere.json"], "--map": []},
    ),
    # tests/system/recording/test_further_setup.py tries --note, with the daemon
    "next": (
        ["next", "survey.toml"],
        {"--take": ["--take"], "--json": ["--json"], "--note": []},
    ),
    "program": (
        ["program", "survey.toml", "--controller", "siemens", "--out", "out"],
        {
            "--controller": ["--controller", "fanuc"],
            "--out": ["--out", "elsewhere"],
            "--profile": ["--profile", "program.toml"],
            "--json": ["--json"],
        },
    ),
    "signtest: bump": (
        [
            "signtest",
            "--controller",
            "siemens",
            "--profile",
            "profile.toml",
            "--result",
            "result.json",
            "--out",
            "out",
        ],
        {
            "--controller": ["--controller", "fanuc"],
            "--profile": ["--profile", "none.toml"],
            "--function": ["--function", "EYY"],
            "--result": ["--result", "wider.json"],
            "--out": ["--out", "elsewhere"],
            "--off": ["--off", "off.csv"],
            "--on": ["--on", "on.csv"],
            "--run": ["--run", "dial.csv"],
            "--date": ["--date", "2026-01-01"],
            "--json": ["--json"],
        },
    ),
    "signtest: verdict": (
        [
            "signtest",
            "--controller",
            "siemens",
            "--profile",
            "profile.toml",
            "--result",
            "result.json",
            "--run",
            "dial.csv",
        ],
        {
            "--controller": ["--controller", "fanuc"],
            "--profile": ["--profile", "none.toml"],
            "--function": ["--function", "EYY"],
            "--result": ["--result", "wider.json"],
            "--out": ["--out", "out"],
            "--off": ["--off", "off.csv"],
            "--on": ["--on", "on.csv"],
            "--run": ["--run", "other.csv"],
            "--date": ["--date", "2026-01-01"],
            "--json": ["--json"],
        },
    ),
    "signtest: verdict for programs": (
        [
            "signtest",
            "--controller",
            "siemens",
            "--profile",
            "profile.toml",
            "--result",
            "result.json",
            "--run",
            "dial.csv",
            "--json",
        ],
        {
            "--controller": ["--controller", "fanuc"],
            "--profile": ["--profile", "none.toml"],
            "--function": ["--function", "EYY"],
            "--result": ["--result", "wider.json"],
            "--out": ["--out", "out"],
            "--off": ["--off", "off.csv"],
            "--on": ["--on", "on.csv"],
            "--run": ["--run", "other.csv"],
            "--date": ["--date", "2026-01-01"],
            "--json": [],
        },
    ),
    "decode": (
        ["decode", "0001/0001.mcap"],
        {
            "--to": ["--to", "parquet"],
            "--out": ["--out", "new.csv"],
            "--stream": ["--stream", "head"],
            "--survey": ["--survey", "survey.toml"],
        },
    ),
    "info": (["info", "0001/0001.mcap"], {"--json": ["--json"]}),
    "complete": (
        ["complete", "0001"],
        {"--readings": ["--readings"], "--certificate": ["--certificate"]},
    ),
    "trend": (
        ["trend", "store"],
        {
            "--machine": ["--machine", "Lathe"],
            "--tolerance": ["--tolerance", "volumetric-rms=15"],
            "--software": ["--software", "9"],
            "--csv": ["--csv", "new.csv"],
            "--report": ["--report", "new.html"],
            "--language": ["--language", "de"],
            "--json": ["--json"],
        },
    ),
    "archive add": (
        ["archive", "add", "0001", "--to", "out"],
        {"--to": ["--to", "elsewhere"], "--json": ["--json"]},
    ),
    "replay": (
        ["replay", "0001"],
        {
            "--out": ["--out", "elsewhere"],
            "--survey": ["--survey", "survey.toml"],
            "--json": ["--json"],
        },
    ),
    "fourdof new": (
        [
            "fourdof",
            "new",
            "--id",
            "4D-9",
            "--psd1-focal-mm",
            "150",
            "--psd2-focal-mm",
            "150",
            "--out",
            "new.toml",
        ],
        {
            "--id": ["--id", "4D-8"],
            "--psd1-focal-mm": ["--psd1-focal-mm", "140"],
            "--psd2-focal-mm": ["--psd2-focal-mm", "140"],
            "--out": ["--out", "other.toml"],
        },
    ),
    "fourdof calibrate": (
        [
            "fourdof",
            "calibrate",
            "--run",
            "qd.x=stage.csv",
            "--base",
            "head.toml",
            "--out",
            "new.toml",
        ],
        {
            "--run": ["--run", "qd.y=stage.csv"],
            "--base": ["--base", "none.toml"],
            "--out": ["--out", "other.toml"],
            "--reference": ["--reference", "stage 12"],
            "--u-reference": ["--u-reference", "5"],
            "--degree": ["--degree", "3"],
            "--plot": ["--plot", "new.svg"],
            "--json": ["--json"],
        },
    ),
    "fourdof stability": (
        [
            "fourdof",
            "stability",
            "near.csv",
            "--calibration",
            "head.toml",
            "--distance-mm",
            "500",
        ],
        {
            "--calibration": ["--calibration", "none.toml"],
            "--distance-mm": ["--distance-mm", "900"],
            "--seconds": ["--seconds", "9"],
            "--interval-s": ["--interval-s", "2"],
            "--record": ["--record", "new.csv"],
            "--plot": ["--plot", "new.svg"],
            "--json": ["--json"],
        },
    ),
    "fourdof compare": (
        ["fourdof", "compare", "ours.csv", "--reference", "theirs.csv"],
        {
            "--reference": ["--reference", "ours.csv"],
            "--plot": ["--plot", "new.svg"],
            "--json": ["--json"],
        },
    ),
    "fourdof align": (["fourdof", "align", "near.csv"], {"--seconds": ["--seconds", "9"]}),
}
"""A call of each command that works on files alone, and every option of it with a value other than
the call's own.

After a colon stands what a call of the command is for, where it has several.
"""

NEEDED = {
    "demo": [],
    "stream": ["survey.toml", "ppp", "x.csv", "--unit", "mm"],
    "setup": ["new.toml"],
    "status": ["."],
    "fleet": ["store"],
    "publish": ["result.json", "--broker", "localhost"],
}
"""What the commands that need Linux take at least, where it is no survey file."""

COVERED: dict[str, dict[str, list[str]]] = {
    "demo": {
        "system/service/test_demo_live.py": ["--live", "--out"],
        "stepdiag/cli/test_demo_and_fleet.py": ["--browser", "--json", "--seed", "--verbose"],
    },
    "init": {
        "stepdiag/cli/test_survey_and_logs.py": [
            "--feedback",
            "--machine-class",
            "--pitch-mm",
        ]
    },
    "setup": {
        "system/shop/test_setup.py": [
            "--baud",
            "--chain",
            "--compensation",
            "--control",
            "--feedback",
            "--host",
            "--increments",
            "--laser-format",
            "--laser-port",
            "--machine",
            "--machine-class",
            "--origin",
            "--pitch-mm",
            "--port",
            "--seconds",
            "--size",
        ]
    },
    "check": {"system/shop/test_check.py": ["--json", "--seconds"]},
    "run": {"stepdiag/cli/test_entry.py": ["--verbose"]},
    "pack": {},
    "page": {},
    "status": {"stepdiag/cli/test_status.py": ["--json", "--verbose"]},
    "accept": {
        "stepdiag/cli/test_status.py": ["--begun", "--reason", "--verbose"],
        "system/recording/test_doubts.py": ["--name"],
    },
    "correct": {"daq/capture/test_cause.py": ["--name", "--yes"]},
    "begin": {},
    "stream": {"daq/recording/test_streamed.py": ["--began", "--unit"]},
    "rtl": {"stepdiag/cli/test_runs.py": ["--machine", "--out"]},
    "recover": {"stepdiag/cli/test_survey_and_logs.py": ["--json", "--out"]},
    "archive check": {"stepdiag/fleet/test_custody.py": []},
    "fleet": {
        "stepdiag/cli/test_demo_and_fleet.py": [
            "--host",
            "--language",
            "--port",
            "--software",
            "--tolerance",
        ]
    },
    "resolve": {
        "stepdiag/fleet/test_archive.py": ["--json", "--machine", "--survey"],
        "system/service/test_resolve.py": [
            "--ca",
            "--certificate",
            "--key",
            "--scheduler",
            "--workers",
        ],
    },
    "publish": {
        "system/service/test_publish.py": [
            "--broker",
            "--ca",
            "--every",
            "--once",
            "--password-file",
            "--topic",
            "--user",
        ],
        "system/service/test_opcua.py": ["--certificate", "--key", "--opcua", "--plain"],
        "stepdiag/publish/test_messages.py": ["--schema"],
    },
    "fourdof commission": {
        "system/recording/test_commission_head.py": ["--calibration", "--json"],
        "stepdiag/cli/test_fourdof.py": ["--out", "--controller", "--profile"],
    },
    "proof": {
        "system/recording/test_proof_run.py": [
            "--controller",
            "--json",
            "--loaded",
            "--minutes",
            "--out",
            "--profile",
            "--verbose",
        ],
    },
    "fourdof show": {"system/recording/test_fourdof_survey.py": ["--out"]},
    "service install": {"stepdiag/daemon/test_installation.py": ["--dry-run", "--root"]},
    "service remove": {"stepdiag/daemon/test_installation.py": ["--dry-run", "--root"]},
    "service publish": {
        "stepdiag/daemon/test_publication.py": [
            "--broker",
            "--ca",
            "--certificate",
            "--dry-run",
            "--opcua",
            "--plain",
            "--remove",
            "--root",
        ]
    },
}
"""Commands with processes, terminals or logs of a live run: the test, below tests/, that uses each
option."""


def unstated() -> Result:
    """A result without a survey: nothing states whether a compensation was active."""
    made = made_result(ERRORS, squareness={"C0Y": 15.0, "B0Z": -12.0, "A0Z": 11.0}, u_um=0.1)
    return replace(made, survey=None)


def write_head(folder: Path) -> None:
    """Write what the commands of the 4-DOF head take: its file, a stage run, samples at two
    distances, curves of two instruments."""
    write_head_file(folder / "head.toml")
    reference = np.linspace(-600.0, 600.0, 27)
    rows = "".join(f"{at / 900:.6f},{at + 0.2 * np.sin(at):.3f}\n" for at in reference)
    (folder / "stage.csv").write_text(f"reading,reference_um\n{rows}", encoding="utf-8")
    stand = HeadStand(np.zeros(3), *np.eye(3)[[2, 0, 1]])
    time = np.arange(0.0, 60.0, 0.05)
    still = np.zeros((len(time), 2))
    for name, distance_mm in (("near.csv", 500.0), ("far.csv", 2000.0)):
        wander = Disturbance(pointing_urad=Wander(amplitude=20.0, period_s=7.0, seed=3))
        head = VirtualHead(
            HeadOptics(),
            stand,
            stage_pose(distance_mm, still[:1], still[:1], stand),
            disturbance=wander,
        )
        channels = head.channels(stage_pose(distance_mm, still, still, stand), time).astype(
            float
        )
        (folder / name).write_text(
            render_head_csv(HeadRecord(time_s=time, channels=channels)), encoding="utf-8"
        )
    for name, size in (("ours.csv", 1.0), ("theirs.csv", 1.1)):
        rows = "".join(f"{at},{size * (at / 100) ** 2:g}\n" for at in range(0, 500, 100))
        (folder / name).write_text(f"position_mm,EYX_um\n{rows}", encoding="utf-8")


@pytest.fixture(scope="module")
def goods(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a file of each kind: files of a control, results, a finished survey, a store of
    archived ones."""
    folder = tmp_path_factory.mktemp("goods")
    result = unstated()
    profile = profile_of("siemens", VOLUME)
    control = controller_named("siemens")
    plan = control.plan(
        fitted(result, profile.machine.functions, profile.machine.squareness_into).curves,
        profile,
    )
    for file in control.render(plan.tables, profile):
        (folder / file.name).write_bytes(file.data)
    (folder / "etalon.txt").write_bytes(etalon.render(result).data)
    x, y, z = (size / 4 for size in VOLUME.size_mm)
    written = profile_text(
        "siemens", steps_mm=(x, y, z), references_mm=VOLUME.origin_mm, direction="mean"
    )
    wider = replace(
        result, volume=replace(VOLUME, size_mm=tuple(1.5 * size for size in VOLUME.size_mm))
    )
    moved = bump(
        control, parse_profile(written, "profile.toml", control, VOLUME, {}), "EXX"
    ).tables
    low = VOLUME.origin_mm[0]
    points = np.array(
        [[low + at, 0.0, 0.0] for at in np.linspace(0.0, VOLUME.size_mm[0], 17)]
    )
    (curve,) = fitted(result, ["EXX"]).curves
    dial = list(
        zip(
            points[:, 0],
            curve.at(points[:, 0]),
            total_correction_um(moved, points)[:, 0],
            strict=True,
        )
    )
    texts = {
        "result.json": result.to_json(),
        "later.json": replace(
            result, errors={**result.errors, "EXX": result.errors["EYY"]}
        ).to_json(),
        "wider.json": wider.to_json(),
        "profile.toml": written,
        "program.toml": "[program]\nfeed_decimals = 2\n",
        "survey.toml": SURVEY,
        "angles.csv": ANGLES,
        "bow.csv": BOW,
        "air.toml": "[environment]\nair_temperature_c = 25.0\n",
        "uncertainty.toml": SECTION,
        "active.ini": "",
        "laboratory.toml": "[certificate]\nbegun = 2026-05-30\nended = 2026-05-31\n",
        "signed.toml": '[[person]]\nname = "M. Muster"\n',
        "other.toml": "[certificate]\nbegun = 2026-05-30\nended = 2026-06-01\n",
        "tolerance.toml": "[tolerance]\nsquareness_urad = 20.0\n",
        "paper.toml": 'name = "Workshop"\n',
        "dial.csv": "position_mm,off_um,on_um\n"
        + "".join(f"{at:g},{own},{own + by}\n" for at, own, by in dial),
        "other.csv": "position_mm,off_um,on_um\n"
        + "".join(f"{at:g},{own},{own - by}\n" for at, own, by in dial),
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    shutil.copy(GOLDEN, folder / "readings.csv")
    write_head(folder)
    survey = finished_survey(folder, event="crash")
    store = Store(str(folder / "store"), create=True)
    archived(survey, store)
    write_history(store, "Lathe", [5.0, 5.1, 5.2, 5.4])
    return folder


@pytest.fixture(scope="module")
def kept(goods: Path) -> dict[Path, bytes]:
    """The files of that folder as they were made."""
    return contents(goods)


@pytest.fixture(autouse=True)
def planned_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Search the surveys of one question once: the search takes seconds."""
    plan_once(monkeypatch)


@pytest.fixture
def shop(goods: Path, kept: dict[Path, bytes], monkeypatch: pytest.MonkeyPatch) -> Path:
    """That folder as it was made, which is where the commands work: always the same, so that a path
    in an answer is no difference."""
    if contents(goods) != kept:
        put_back(goods, kept)
    monkeypatch.chdir(goods)
    return goods


@pytest.fixture(scope="module")
def plain(goods: Path, kept: dict[Path, bytes]) -> Callable[[str], Outcome]:
    """What each call comes to without a further option, worked out once in that folder as it was
    made."""

    @cache
    def plain(name: str) -> Outcome:
        found = outcome(goods, CALLS[name][0])
        put_back(goods, kept)
        return found

    return plain


def outcome(folder: Path, arguments: list[str]) -> Outcome:
    """What a call comes to: its end, its words and the files there afterwards."""
    return stepdiag(*arguments), contents(folder)


def commands(group: Any = None, before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every command with its name, those of a group behind the name of it."""
    for name, command in (group or typer.main.get_command(app)).commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, f"{before}{name} ")
        else:
            yield before + name, command


def options_of(name: str) -> set[str]:
    command = dict(commands())[name.partition(":")[0]]
    return {
        parameter.opts[-1]
        for parameter in command.params
        if parameter.opts[-1].startswith("--")
    }


def cases() -> Iterator[tuple[str, str]]:
    yield from (
        (name, option)
        for name, (_, options) in CALLS.items()
        for option, words in options.items()
        if words
    )


def without(call: list[str], option: str) -> list[str]:
    """Return a call without an option and its value, however often it is given."""
    left = iter(call)
    kept = []
    for word in left:
        if word == option:
            next(left, None)
        else:
            kept.append(word)
    return kept


@pytest.mark.parametrize("name", sorted(CALLS))
def test_every_option_is_tried(name):
    stepdiag("--version")
    assert set(CALLS[name][1]) == options_of(name)


def test_every_command_is_tried_or_named_with_its_tests():
    stepdiag("--version")
    named = {
        name: {option for options in tests.values() for option in options}
        for name, tests in COVERED.items()
    }
    tried = {name.partition(":")[0] for name in CALLS}
    assert not tried & named.keys()
    assert tried | named.keys() == {name for name, _ in commands()}
    missing = {
        (name, option)
        for name, options in named.items()
        for option in options_of(name) ^ options
    }
    assert not missing


@pytest.mark.parametrize(
    ("name", "place", "option"),
    [
        (n, p, o)
        for n, tests in COVERED.items()
        for p, options in tests.items()
        for o in options
    ],
)
def test_the_named_test_uses_the_option(name, place, option):
    text = (Path(__file__).parents[2] / place).read_text(encoding="utf-8")
    assert f'"{option}"' in text
    assert f'"{name.split()[-1]}"' in text


@pytest.mark.parametrize(("name", "option"), list(cases()))
def test_an_option_changes_what_comes_out_or_is_refused(name, option, shop, plain):
    call, options = CALLS[name]
    usual = plain(name)
    assert outcome(shop, [*without(call, option), *options[option]]) != usual


@pytest.mark.parametrize("name", sorted(CALLS))
def test_the_same_call_makes_the_same(name, shop, plain):
    """Otherwise any option would seem to change something. What a call is for is done, too."""
    usual = plain(name)
    assert usual[0].code in (0, 5), usual[0]
    assert outcome(shop, CALLS[name][0]) == usual


@pytest.mark.parametrize(
    "given",
    [
        ("--angles", "angles.csv"),
        ("--chain", "XFYZ"),
        ("--straightness", "bow.csv"),
        ("--uncertainty", "uncertainty.toml"),
        ("--tolerance", "tolerance.toml"),
        ("--monte-carlo", "1000"),
        ("--run", "none.rtl"),
    ],
)
def test_logs_take_no_option_of_readings(given, shop):
    """Angles beside logs were read by nobody: 3.5 µm of uncertainty where they give 1.7."""
    told = stepdiag("solve", shop, *given)
    assert told.code == 2
    assert f"{given[0]}: expected one readings file (*.csv), found logs" in told.refusal


@pytest.mark.parametrize("method", ["least-squares", "wang2000"])
@pytest.mark.parametrize(
    "given",
    [
        ("--angles", "angles.csv"),
        ("--straightness", "bow.csv"),
        ("--uncertainty", "uncertainty.toml"),
        ("--monte-carlo", "1000"),
    ],
)
def test_a_closed_form_takes_the_readings_alone(method, given, shop):
    assert stepdiag("solve", "readings.csv", "--method", method, *given).code == 2


@pytest.mark.parametrize(
    "given", [("--active-date", "2026-01-01"), ("--active-source", "archive")]
)
@pytest.mark.parametrize("state", [(), ("--compensation", "off")])
def test_when_and_how_files_were_read_out_needs_the_files(given, state, shop):
    told = stepdiag("solve", "readings.csv", *state, *given)
    assert told.code == 2
    assert "--active" in told.refusal


def test_a_scheduler_has_workers_of_its_own(tmp_path):
    told = stepdiag("resolve", tmp_path, "--workers", "1", "--scheduler", "tcp://127.0.0.1:1")
    assert told.code == 2
    assert "--workers: expected no --scheduler together with this option" in told.refusal


def test_files_are_worked_on_wherever_python_runs(shop, plain):
    """Without the modules and calls that Windows has not, each call ends alike with the same bytes;
    what needs Linux is refused."""
    calls = {name: call for name, (call, _) in CALLS.items()}
    linux = {
        name: ["run", "survey.toml"]
        if name == "run"
        else [*name.split(), *NEEDED.get(name, ["survey.toml"])]
        for name in LINUX_ONLY
    }
    given = json.dumps({**calls, **linux})
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    ended = subprocess.run(
        [sys.executable, "-m", "testkit.elsewhere"],
        input=given,
        capture_output=True,
        text=True,
        cwd=shop,
        env=environment,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    ends = json.loads(ended.stdout)
    for name in LINUX_ONLY:
        code, out, refusal, _ = ends[name]
        assert (code, out) == (2, ""), name
        assert f"stepdiag {name}: expected Linux" in refusal
    for name in calls:
        told, files = plain(name)
        hashes = {str(path): sha256(data).hexdigest() for path, data in files.items()}
        assert [*told, hashes] == ends[name], name
