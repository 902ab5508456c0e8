"""`stepdiag fourdof` as a service engineer meets it: from recorded samples and stage runs to a
calibration file and the test figures."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from stepdiag.base.errors import DataError, StepdiagError, UsageError
from stepdiag.cli.app import app, build
from stepdiag.daq.survey.head_file import parse_head_file
from stepdiag.fourdof.record import HeadRecord, read_head_csv, render_head_csv
from stepdiag.solver.fourdof.head import URAD_PER_ARCSEC
from stepdiag.virtual.instruments.head import (
    Disturbance,
    HeadOptics,
    HeadStand,
    VirtualHead,
    Wander,
)
from testkit.exact.heads import survey_section, write_head_file
from testkit.ordinary.heads import stage_pose
from testkit.timeline import survey_text

STAND = HeadStand(np.zeros(3), *np.eye(3)[[2, 0, 1]])
STILL = np.zeros((1, 2))


@pytest.fixture(scope="module", autouse=True)
def _commands():
    build()


def fourdof(*arguments):
    """Run a command; return its output, or raise what refused it."""
    done = CliRunner().invoke(app, ["fourdof", *map(str, arguments)])
    if isinstance(done.exception, StepdiagError):
        raise done.exception
    assert done.exit_code == 0, done.output
    return done.stdout


def samples(distance_mm, seconds, *, amplitude, period_s, rate_hz=20.0, optics=None):
    """Samples of a standing target under a wandering laser."""
    time = np.arange(0.0, seconds, 1 / rate_hz)
    wander = Disturbance(pointing_urad=Wander(amplitude=amplitude, period_s=period_s, seed=3))
    head = VirtualHead(
        optics or HeadOptics(),
        STAND,
        stage_pose(distance_mm, STILL, STILL, STAND),
        disturbance=wander,
    )
    still = np.zeros((len(time), 2))
    return HeadRecord(
        time_s=time,
        channels=head.channels(stage_pose(distance_mm, still, still, STAND), time).astype(
            float
        ),
    )


def write_samples(path, *arguments, **options):
    path.write_text(render_head_csv(samples(*arguments, **options)), encoding="utf-8")
    return path


def write_stage_run(path, detector, column):
    """What a person writes down at the stage: the head's normalised reading beside the
    reference."""
    reference = np.linspace(-1.0, 1.0, 27) * (650.0 if detector == "qd" else 600.0)
    moved = np.zeros((27, 2))
    moved[:, column] = reference
    none = np.zeros((27, 2))
    shift, turn = (
        (1e-3 * moved, none) if detector == "qd" else (none, moved * URAD_PER_ARCSEC)
    )
    channels = VirtualHead(
        HeadOptics(), STAND, stage_pose(500.0, STILL, STILL, STAND)
    ).channels(stage_pose(500.0, shift, turn, STAND), np.zeros(27))
    first = 0 if detector == "qd" else 6
    reading = channels[:, first + column] / channels[:, first + 2]
    rows = [f"{a:.6f},{b:.3f}" for a, b in zip(reading, reference, strict=True)]
    path.write_text(
        "\n".join([f"reading,reference_{'um' if detector == 'qd' else 'arcsec'}", *rows])
        + "\n",
        encoding="utf-8",
    )
    return path


def test_from_a_new_head_to_its_calibration_file(tmp_path):
    fourdof(
        "new",
        "--id",
        "4D-9",
        "--psd1-focal-mm",
        150,
        "--psd2-focal-mm",
        150,
        "--out",
        tmp_path / "new.toml",
    )
    runs = [
        f"{detector}.{axis}={write_stage_run(tmp_path / f'{detector}{axis}.csv', detector, column)}"
        for detector in ("qd", "psd2")
        for column, axis in enumerate("xy")
    ]
    arguments = [part for run in runs for part in ("--run", run)]
    out, picture = tmp_path / "head.toml", tmp_path / "residuals.svg"
    said = fourdof(
        "calibrate",
        *arguments,
        "--base",
        tmp_path / "new.toml",
        "--out",
        out,
        "--reference",
        "stage 12",
        "--plot",
        picture,
    )
    assert said.count("yes") == 4
    file = parse_head_file(out.read_bytes(), "head.toml")
    assert (file.head.id, file.head.reference) == ("4D-9", "stage 12")
    assert file.qd.x.kind == "erf"
    assert 0 < file.psd2.y.u_um < 1.5
    assert picture.read_text().startswith("<svg")
    assert "residual of the fitted curve" in picture.read_text()
    with pytest.raises(UsageError, match="expected a new file"):
        fourdof("calibrate", *arguments, "--base", out, "--out", out)


def test_what_nothing_has_measured_is_refused_and_the_next_command_named(tmp_path):
    """A file of `new` gave a pitch 40 u off, and one without signs covered 1 per cent."""
    fourdof(
        "new",
        "--id",
        "4D-9",
        "--psd1-focal-mm",
        150,
        "--psd2-focal-mm",
        150,
        "--out",
        tmp_path / "new.toml",
    )
    wobble = write_samples(tmp_path / "w.csv", 300.0, 20.0, amplitude=100.0, period_s=3.0)
    with pytest.raises(
        DataError,
        match=r"stability: qd.x: .*no measurement of qd.x, .*; next: `stepdiag fourdof "
        r"commission`",
    ):
        fourdof(
            "stability", wobble, "--calibration", tmp_path / "new.toml", "--distance-mm", 300
        )
    run = write_stage_run(tmp_path / "qdx.csv", "qd", 0)
    fourdof(
        "calibrate",
        "--run",
        f"qd.x={run}",
        "--base",
        tmp_path / "new.toml",
        "--out",
        tmp_path / "part.toml",
    )
    file = parse_head_file((tmp_path / "part.toml").read_bytes(), "part.toml")
    assert file.measured["qd.x"].by == "fourdof calibrate"
    with pytest.raises(
        DataError, match=r"stability: qd.y: expected a measured value in this field"
    ):
        fourdof(
            "stability", wobble, "--calibration", tmp_path / "part.toml", "--distance-mm", 300
        )


def test_a_survey_file_gives_the_program_that_commissions_its_head(tmp_path):
    """The run of the head and nothing else of the plan; the profile's signals and travel are the
    machine's own."""
    (tmp_path / "survey.toml").write_text(
        survey_text(
            size=(300.0, 300.0, 300.0),
            n=3,
            setups=("ppp", "fourdof-z"),
            signals=survey_section("/dev/null1"),
        )
    )
    fourdof(
        "new",
        "--id",
        "4D-001",
        "--psd1-focal-mm",
        150,
        "--psd2-focal-mm",
        150,
        "--out",
        tmp_path / "head.toml",
    )
    (tmp_path / "mine.toml").write_text('[program]\nstand = "M70 (AT {count})"\n')
    ours = (
        "--controller",
        "fanuc",
        "--profile",
        tmp_path / "mine.toml",
        "--out",
        tmp_path / "nc",
    )
    said = fourdof("commission", tmp_path / "survey.toml", *ours)
    assert "next: start `stepdiag run survey.toml`" in said
    (program,) = (tmp_path / "nc").glob("O*")
    text = program.read_text()
    assert text.count("(WOBBLE THE POINTING") == 2
    assert "M70 (AT " in text
    (tmp_path / "plain.toml").write_text(
        survey_text(size=(300.0, 300.0, 300.0), n=3, signals=survey_section("/dev/null1"))
    )
    with pytest.raises(
        UsageError, match="expected a run fourdof-x, fourdof-y or fourdof-z, found ppp"
    ):
        fourdof(
            "commission",
            tmp_path / "plain.toml",
            "--controller",
            "fanuc",
            "--out",
            tmp_path / "none",
        )
    with pytest.raises(UsageError, match="--controller with a survey file"):
        fourdof("commission", tmp_path / "survey.toml", "--out", tmp_path / "none")
    with pytest.raises(UsageError, match="--calibration with logs"):
        fourdof("commission", tmp_path / "0001.mcap", "--out", tmp_path / "made.toml")


def test_the_pages_of_figures_are_html_where_asked(tmp_path):
    write_head_file(tmp_path / "head.toml")
    source = write_samples(tmp_path / "s.csv", 2000.0, 120.0, amplitude=5.0, period_s=60.0)
    arguments = (
        "--calibration",
        tmp_path / "head.toml",
        "--distance-mm",
        2000,
        "--plot",
        tmp_path / "allan.html",
    )
    assert "straightness x" in fourdof("stability", source, *arguments)
    page = (tmp_path / "allan.html").read_text()
    assert "<title>Allan deviation</title>" in page
    assert page.count("Allan deviation of") >= 4
    with pytest.raises(UsageError, match=r"--plot: expected a file named \*.svg or \*.html"):
        fourdof("stability", source, *arguments[:-1], tmp_path / "allan.png")


def test_stability_says_what_compensation_takes_away(tmp_path):
    write_head_file(tmp_path / "head.toml")
    source = write_samples(tmp_path / "s.csv", 2000.0, 120.0, amplitude=5.0, period_s=60.0)
    said = json.loads(
        fourdof(
            "stability",
            source,
            "--calibration",
            tmp_path / "head.toml",
            "--distance-mm",
            2000,
            "--json",
        )
    )
    assert set(said) == {"straightness x", "straightness y", "angle x", "angle y"}
    for figures in said.values():
        assert figures["removed_percent"] > 80.0
        assert (
            len(figures["tau_s"])
            == len(figures["raw_allan"])
            == len(figures["compensated_allan"])
            > 3
        )


def test_compare_with_a_reference_instrument(tmp_path):
    """A reference that stood 20 urad askew: straightness is compared free of its line, angles from
    the first position."""
    position = np.arange(0.0, 1001.0, 100.0)
    bow, pitch = 3.0 * np.sin(position / 150.0), 4.0 * np.cos(position / 300.0)
    ours = [f"{p},{b:.4f},{a:.4f}" for p, b, a in zip(position, bow, pitch, strict=True)]
    theirs = [
        f"{p},{b + 0.02 * p + (0.5 if p == 500 else 0):.4f},{(a + 7) * URAD_PER_ARCSEC:.4f}"
        for p, b, a in zip(position, bow, pitch, strict=True)
    ]
    (tmp_path / "ours.csv").write_text(
        "\n".join(["position_mm,EYX_um,EBX_arcsec", *ours]) + "\n"
    )
    (tmp_path / "api.csv").write_text(
        "\n".join(["position_mm,EYX_um,EBX_urad", *theirs]) + "\n"
    )
    said = json.loads(
        fourdof(
            "compare", tmp_path / "ours.csv", "--reference", tmp_path / "api.csv", "--json"
        )
    )
    assert said["EYX"]["lowest"] == pytest.approx(-0.5 * 10 / 11, abs=0.02)
    assert said["EBX"]["rms"] == pytest.approx(0.0, abs=1e-3)
    assert "EYX" in fourdof(
        "compare",
        tmp_path / "ours.csv",
        "--reference",
        tmp_path / "api.csv",
        "--plot",
        tmp_path / "c.svg",
    )
    (tmp_path / "other.csv").write_text("position_mm,EXY_um\n0,0\n100,1\n")
    with pytest.raises(DataError, match="expected one of the functions EYX, EBX"):
        fourdof("compare", tmp_path / "ours.csv", "--reference", tmp_path / "other.csv")


def test_compare_finds_how_far_the_heads_stood_from_each_other(tmp_path):
    """A reference 100 mm along the axis and 40 mm beside it: yaw, pitch and roll show the arm; 3 um
    of differences become the noise."""
    position = np.arange(0.0, 1001.0, 50.0)
    rng = np.random.default_rng(1)
    turns = [
        30.0 * np.sin(position / scale) for scale in (300.0, 220.0, 170.0)
    ]  # roll, pitch, yaw of X in urad
    arm = np.array([100.0, -40.0, 25.0])
    moved = 1e-3 * np.cross(np.column_stack(turns), arm)
    bow = np.column_stack(
        [np.zeros(21), 4.0 * np.sin(position / 400.0), 3.0 * np.cos(position / 500.0)]
    )
    ours, theirs = (
        bow + moved + rng.normal(0.0, 0.1, moved.shape),
        bow + rng.normal(0.0, 0.1, moved.shape),
    )
    columns = np.column_stack([position, ours[:, 1:], *turns])
    head = "position_mm,EYX_um,EZX_um,EAX_urad,EBX_urad,ECX_urad"
    (tmp_path / "ours.csv").write_text(
        "\n".join([head, *(",".join(f"{value:.5f}" for value in row) for row in columns)])
        + "\n"
    )
    lines = [
        ",".join(f"{value:.5f}" for value in row)
        for row in np.column_stack([position, theirs[:, 1:]])
    ]
    (tmp_path / "theirs.csv").write_text(
        "\n".join(["position_mm,EYX_um,EZX_um", *lines]) + "\n"
    )
    said = json.loads(
        fourdof(
            "compare", tmp_path / "ours.csv", "--reference", tmp_path / "theirs.csv", "--json"
        )
    )
    found = said["arms"]["X"]
    assert max(said["EYX"]["rms"], said["EZX"]["rms"]) > 1.0
    assert np.all(np.abs(np.array(found["mm"]) - arm) < 3 * np.array(found["u_mm"]))
    assert max(found["u_mm"]) < 5.0
    assert max(found["rms_um"].values()) < 0.25
    assert "X: distance of the head from the reference x +" in fourdof(
        "compare", tmp_path / "ours.csv", "--reference", tmp_path / "theirs.csv"
    )


def test_align_shows_a_recording(tmp_path):
    source = write_samples(tmp_path / "s.csv", 2000.0, 5.0, amplitude=500.0, period_s=60.0)
    said = fourdof("align", source)
    assert {"QD", "PSD1", "PSD2"} <= set(said.split())
    assert said.count("O") >= 6


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.csv", "time_s,qd_x,qd_y\n0,1,2\n", "no column qd_sum"),
        (
            "a.csv",
            "time_s,qd_x,qd_y,qd_sum\n1,1,2,3\n0,1,2,3\n",
            "a.csv: line 3: expected a time later than in the row before",
        ),
        (
            "a.txt",
            "",
            "expected a survey file (.toml), a log (.mcap) or samples (.csv), found .txt",
        ),
        (
            "a.csv",
            "time_s,qd_x,qd_y,qd_sum\n0,1,2,3\n1,1,2,3\n",
            "expected nine channels: QD, PSD1 and PSD2, found 3: a QD alone",
        ),
    ],
)
def test_a_source_that_does_not_serve_is_refused(tmp_path, name, text, message):
    write_head_file(tmp_path / "head.toml")
    (tmp_path / name).write_text(text)
    with pytest.raises(StepdiagError) as refused:
        fourdof(
            "stability",
            tmp_path / name,
            "--calibration",
            tmp_path / "head.toml",
            "--distance-mm",
            300,
        )
    assert message in str(refused.value)


def test_a_gap_in_the_samples_is_no_stability():
    record = samples(500.0, 10.0, amplitude=1.0, period_s=5.0)
    late = HeadRecord(
        time_s=np.where(record.time_s > 5.0, record.time_s + 3.0, record.time_s),
        channels=record.channels,
    )
    with pytest.raises(
        DataError, match="expected samples in every interval of 1 s, found no samples after"
    ):
        late.averaged(1.0)


def test_samples_go_to_csv_and_back():
    record = samples(500.0, 2.0, amplitude=1.0, period_s=5.0)
    again = read_head_csv(render_head_csv(record), "s.csv")
    assert again.channels == pytest.approx(record.channels)
    assert again.time_s == pytest.approx(record.time_s, abs=1e-6)
