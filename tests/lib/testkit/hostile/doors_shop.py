"""File doors of what a shop adds: controls over S7 and LSV2, angles of other makers, runs of other
programs, the archive, the broker."""

import re
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec

from stepdiag.base.errors import UsageError
from stepdiag.base.readings.readings import render_readings
from stepdiag.base.readings.rtl import render_rtl
from stepdiag.daq.records.status import LinkStatus
from stepdiag.daq.service.live import FILE as LIVE
from stepdiag.daq.service.live import LiveStatus
from stepdiag.daq.survey.composed import Answers, composed
from stepdiag.daq.survey.controls import CONTROLS
from stepdiag.daq.survey.file import load_survey
from stepdiag.daq.survey.template import template
from stepdiag.exporters.export.export import export
from stepdiag.exporters.profiles.file import parse_profile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.publish.messages import Watched
from testkit.exact.machines import profile_text
from testkit.exact.results import VOLUME
from testkit.exact.surveys import DIAGONALS
from testkit.fleets import finished_survey
from testkit.hostile.door import LOG, Door
from testkit.hostile.foreign import BENCH, RESULT
from testkit.hostile.foreign_logs import SURVEY, contents, recorded
from testkit.hostile.foreign_tables import RESULT as TABLED
from testkit.hostile.foreign_tables import Everything
from testkit.hostile.one_field import wrong_csv, wrong_json, wrong_toml, wrong_words

WHOLE = ("--out", "out.json")
FOLDER = "logs/bench"
ALONE = SURVEY[: SURVEY.index("[[export]]")].replace(
    'machine = "virtual"', 'machine = "virtual"\ndirectory = "logs"'
)
ANGLES_OF = {
    "elcomat": 'x = ["+C", "+B"]\ny = ["+C", "+A"]',
    "wyler": 'x = ["+A"]\ny = ["+B"]',
}
LISTS = """\
[beckhoff]
way = "lists"
axis_numbers = { X = 1, Y = 2, Z = 3 }
cross_sense = "as-error"
"""
ONE_CROSS_TABLE = ("EXX", "EYY", "EZZ", "EYX", "EXY", "EZY")


def shop_doors() -> Iterator[tuple[str, Door]]:
    """Yield every one of these doors with its name."""
    yield from _runs()
    yield from _surveys()
    yield from _lists()
    yield from _stores()
    decode = ("decode", LOG, "--out", "samples.csv")
    yield "decode", Door(decode, {"survey": SURVEY}, "survey", wrong_toml)
    yield (
        "decode, contents",
        Door(decode, {"contents": contents(recorded()).decode()}, "contents", wrong_words),
    )
    for name, wrong in (("publish live", LIVE), ("publish result", "0001/result.json")):
        files = {
            "s.toml": ALONE,
            f"{FOLDER}/{LIVE}": _live(),
            f"{FOLDER}/0001/result.json": RESULT.to_json(),
        }
        yield (
            name,
            Door(("publish",), files, f"{FOLDER}/{wrong}", wrong_json, reads=_published),
        )
    yield (
        "setup",
        Door(
            ("setup",),
            {"answers.json": _answers()},
            "answers.json",
            wrong_json,
            reads=_set_up,
        ),
    )


def _runs() -> Iterator[tuple[str, Door]]:
    """Runs of a Renishaw laser, in and out."""
    diagonals = {"r.csv": render_readings(BENCH.survey(DIAGONALS))}
    survey = BENCH.survey((*DIAGONALS, "linear-x"), passes=(1, 2))
    run = render_rtl(survey, "linear-x", {"Machine": "mill 7"})
    yield (
        "solve rtl",
        Door(
            ("solve", "r.csv", "--run", "x.rtl", *WHOLE),
            {**diagonals, "x.rtl": run},
            "x.rtl",
            wrong_words,
        ),
    )
    yield (
        "rtl",
        Door(
            ("rtl", "r.csv", "--out", "rtl"),
            {"r.csv": render_readings(survey)},
            "r.csv",
            wrong_csv,
        ),
    )
    diagonal = {"r.json": RESULT.to_json(), "d.rtl": run}
    yield (
        "verify diagonal",
        Door(("verify", "r.json", "--diagonal", "ppp=d.rtl"), diagonal, "d.rtl", wrong_words),
    )


def _surveys() -> Iterator[tuple[str, Door]]:
    """Survey files as `stepdiag setup` writes them for each control, and with each maker's
    angles."""
    for control in CONTROLS:
        text = composed(_answered(control), "s.toml").replace("/var/lib", "var")
        yield (
            f"status {control}",
            Door(("status", "s.toml"), {"s.toml": text}, "s.toml", wrong_toml),
        )
    for maker, turns in ANGLES_OF.items():
        head = (
            f'[head]\nformat = "{maker}"\nport = "/dev/null"\nbaud = '
            f"9600\n[head.angles]\n{turns}\nu_urad = 0.2\n"
        )
        text = template().replace("/var/lib", "var") + head
        yield (
            f"status {maker}",
            Door(("status", "s.toml"), {"s.toml": text}, "s.toml", wrong_toml),
        )


def _lists() -> Iterator[tuple[str, Door]]:
    """The axis lists of Beckhoff and ISG."""
    before, _, _ = profile_text(
        "beckhoff",
        steps_mm=(100.0, 100.0, 50.0),
        references_mm=(-200.0, 0.0, -100.0),
        direction="mean",
    ).partition("[beckhoff]")
    functions = re.search(r"functions = .*", before)
    assert functions is not None
    profile = before.replace(functions[0], f"functions = {list(ONE_CROSS_TABLE)}") + LISTS
    files = {"r.json": TABLED.to_json(), "p.toml": profile}
    command = (
        "export",
        "r.json",
        "--controller",
        "beckhoff",
        "--profile",
        "p.toml",
        "--out",
        "files",
    )
    yield "export isg profile", Door(command, files, "p.toml", wrong_toml)
    read = parse_profile(profile, "p.toml", controller_named("beckhoff"), VOLUME, {})
    with tempfile.TemporaryDirectory() as folder:
        export(TABLED, "beckhoff", read, accept=Everything(), out_dir=Path(folder) / "files")  # type: ignore[arg-type]
        lists = {
            path.name: path.read_text()
            for path in sorted((Path(folder) / "files").glob("achskw*.lis"))
        }
    yield (
        "verify isg list",
        Door(
            ("verify", "r.json", *lists, "--profile", "p.toml"),
            {**files, **lists},
            min(lists),
            wrong_words,
        ),
    )


def _stores() -> Iterator[tuple[str, Door]]:
    """The archive: what goes in."""
    with tempfile.TemporaryDirectory() as folder:
        survey = finished_survey(Path(folder))
        result, log = (
            (survey / "result.json").read_text(),
            {f"a/{LOG}": (survey / LOG).read_bytes()},
        )
    yield (
        "archive",
        Door(
            ("archive", "add", "a", "--to", "store"),
            {"a/result.json": result},
            "a/result.json",
            wrong_json,
            log,
        ),
    )


def _answered(control: str) -> Answers:
    return Answers(
        name="first",
        machine="mill 7",
        size_mm=(500.0, 400.0, 300.0),
        laser_port="/dev/null",
        laser_format="lasertex",
        control=control,
        host="127.0.0.1",
    )


def _answers() -> str:
    return msgspec.json.encode(_answered("siemens-828d")).decode()


def _set_up() -> str:
    """Take answers as `stepdiag setup` takes them once they are understood, and write the survey
    file of them."""
    try:
        answers = msgspec.json.decode(Path("answers.json").read_bytes(), type=Answers)
    except (
        msgspec.DecodeError,
        UnicodeDecodeError,
    ) as error:  # what the questions never let through
        raise UsageError("answers", expected="answers", found=str(error)[:200]) from error
    return composed(answers, "s.toml")


def _published() -> str:
    """Make all messages of a survey, as `stepdiag publish` sends them."""
    survey = load_survey(Path("s.toml"))
    watched = Watched(survey, survey.folder(Path("s.toml")))
    return str(
        [msgspec.json.encode(each) for each in (watched.online(online=True), *watched.now())]
    )


def _live() -> str:
    """Return the last word of a daemon."""
    link = LinkStatus(state="connected", address="/dev/null", age_s=0.1, detail="115200 baud")
    return msgspec.json.encode(
        LiveStatus(
            time_s=time.time(), waits_for="ppp 1, stop 3", message="", laser=link, plc=link
        )
    ).decode()
