"""`stepdiag fourdof` live: a head that talks on a pty (binary, ASCII) or answers on it (tqd)."""

import json
import time
from contextlib import contextmanager

import numpy as np
import pytest
from typer.testing import CliRunner

from stepdiag.base.errors import DeviceError
from stepdiag.cli.app import app, build
from stepdiag.daq.survey.head_file import parse_head_file
from stepdiag.virtual.base.clock import Clock
from stepdiag.virtual.base.faults import FaultBoard
from stepdiag.virtual.base.ports import SerialLine
from stepdiag.virtual.instruments.head import (
    Disturbance,
    HeadOptics,
    HeadStand,
    VirtualHead,
    Wander,
)
from stepdiag.virtual.instruments.head_wire import FourdofHead, QuadrantDetector
from stepdiag.virtual.instruments.talker import HEAD_CABLE, Talker
from testkit.exact.heads import survey_section, write_head_file
from testkit.ordinary.heads import stage_pose
from testkit.timeline import survey_text

pytestmark = pytest.mark.system

STAND = HeadStand(np.zeros(3), *np.eye(3)[[2, 0, 1]])
STILL = np.zeros((1, 2))


@pytest.fixture(scope="module", autouse=True)
def _commands():
    build()


@contextmanager
def talking_head(
    folder, *, amplitude=50.0, period_s=2.0, encoding="binary", tqd=False, stage=(0.0,)
):
    """A head on ``folder/head`` under a wandering laser, its target 500 mm away and ``stage[0]`` um
    aside; a survey file lies beside."""
    wander = Disturbance(pointing_urad=Wander(amplitude=amplitude, period_s=period_s, seed=3))
    head = VirtualHead(
        HeadOptics(), STAND, stage_pose(500.0, STILL, STILL, STAND), disturbance=wander
    )

    def look(wall_s):
        still = np.zeros((len(wall_s), 2))
        shift = still + np.array([1e-3 * stage[0], 0.0])
        return head.channels(stage_pose(500.0, shift, still, STAND), wall_s)

    device = (
        QuadrantDetector(look, full_sum=HeadOptics().qd.full_sum)
        if tqd
        else FourdofHead(look, rate_hz=200.0, encoding=encoding)
    )
    talker = Talker(
        SerialLine(folder / "head"),
        device,
        HEAD_CABLE,
        clock=Clock(),
        faults=FaultBoard(()),
        chunk_s=0.02,
    )
    section = (
        survey_section(folder / "head")
        .replace("[head.fourdof]", f'[head.fourdof]\nencoding = "{encoding}"')
        .replace("250.0", "200.0")
    )
    if tqd:
        section = f'\n[head]\nformat = "tqd"\nport = "{folder / "head"}"\n'
    (folder / "survey.toml").write_text(survey_text(signals=section))
    write_head_file(folder / "head.toml")
    talker.start()
    try:
        yield folder / "survey.toml"
    finally:
        talker.close()


def fourdof(*arguments, typed=""):
    done = CliRunner().invoke(app, ["fourdof", *map(str, arguments)], input=typed)
    assert done.exit_code == 0, (done.output, done.exception)
    return done.stdout


@pytest.mark.impatient
@pytest.mark.parametrize("encoding", ["binary", "ascii"])
def test_stability_of_a_live_head_is_recorded_and_the_recording_says_the_same(
    tmp_path, encoding
):
    with talking_head(tmp_path, encoding=encoding) as survey:
        rest = (
            "--calibration",
            tmp_path / "head.toml",
            "--distance-mm",
            500,
            "--interval-s",
            0.25,
            "--json",
        )
        live = json.loads(
            fourdof(
                "stability", survey, "--seconds", 3, "--record", tmp_path / "kept.csv", *rest
            )
        )
    kept = json.loads(fourdof("stability", tmp_path / "kept.csv", *rest))
    assert live["straightness x"]["removed_percent"] > 80.0
    assert kept["straightness x"]["raw_fluctuation"] == pytest.approx(
        live["straightness x"]["raw_fluctuation"], rel=0.02
    )


@pytest.mark.impatient
def test_a_live_calibration_asks_for_the_stage(tmp_path, monkeypatch):
    """A person sets the stage, types its reading, and the head is averaged there: 13 places and one
    slip of the finger."""
    stage = [0.0]
    places = iter([*np.linspace(-600.0, 600.0, 13), "six", ""])

    def answer(question, **_):
        said = next(places)
        assert (
            question == "qd.x: reading of the reference in µm (an empty line ends the input)"
        )
        if isinstance(said, float):
            stage[0] = said
            time.sleep(0.1)
        return str(said)

    monkeypatch.setattr("typer.prompt", answer)
    monkeypatch.setattr("stepdiag.head.source.STAGE_S", 0.3)
    with talking_head(tmp_path, amplitude=0.0, stage=stage) as survey:
        said = fourdof(
            "calibrate",
            "--run",
            f"qd.x={survey}",
            "--base",
            tmp_path / "head.toml",
            "--out",
            tmp_path / "new.toml",
            "--json",
        )
    assert max(map(abs, json.loads(said)["qd.x"]["residual"])) < 1.5
    assert parse_head_file(
        (tmp_path / "new.toml").read_bytes(), "new.toml"
    ).qd.x.coefficients_um[1] == pytest.approx(1414.2, rel=0.01)


@pytest.mark.impatient
@pytest.mark.parametrize("tqd", [False, True])
def test_align_shows_the_live_head(tmp_path, tqd):
    with talking_head(tmp_path, tqd=tqd) as survey:
        said = fourdof("align", survey, "--seconds", 1.5)
    assert "QD" in said
    assert ("PSD2" in said) != tqd


def test_a_head_that_is_not_there_is_a_device_error(tmp_path):
    (tmp_path / "survey.toml").write_text(
        survey_text(signals=survey_section(tmp_path / "nowhere"))
    )
    write_head_file(tmp_path / "head.toml")
    done = CliRunner().invoke(
        app, ["fourdof", "align", str(tmp_path / "survey.toml"), "--seconds", "1"]
    )
    assert isinstance(done.exception, DeviceError)
    assert "nowhere" in str(done.exception)
