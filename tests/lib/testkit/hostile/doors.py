"""Every file door of the command line: a command, the files that it is given, and the one of them
that somebody else wrote."""

import re
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from stepdiag.daq.survey.template import template
from stepdiag.exporters.export.export import export
from stepdiag.exporters.files.sets import SUMS
from stepdiag.exporters.neutral import etalon
from stepdiag.exporters.profiles.file import parse_profile
from stepdiag.exporters.profiles.registry import controller_named
from testkit.exact.machines import MACHINES, profile_text
from testkit.exact.results import VOLUME
from testkit.hostile.door import LOG, Door
from testkit.hostile.doors_shop import shop_doors
from testkit.hostile.foreign import (
    ANGLES,
    CURVES,
    HEAD,
    HEAD_SAMPLES,
    READINGS,
    STAGE,
    targets,
)
from testkit.hostile.foreign_logs import SURVEY, contents, recorded
from testkit.hostile.foreign_tables import RESULT as TABLED
from testkit.hostile.foreign_tables import Everything
from testkit.hostile.one_field import wrong_csv, wrong_json, wrong_toml, wrong_words

RESULT = targets()["result"].seed.decode()
RUN = (
    "position_mm,off_um,on_um\n-200,0,0\n-150,5,4\n-100,11,6\n-50,9,1\n0,7,-3\n50,5,-3\n100,3,"
    "-2\n150,4,3\n200,5,5\n"
)
CHAIN = "FXYZ"
ENVIRONMENT = (
    "[environment]\nmaterial_temperature_c = 20.0\nair_temperature_c = 20.0\nair_pressure_hpa = "
    "1013.25\nrelative_humidity_percent = 50.0\n"
)
UNCERTAINTY = "[uncertainty]\nalignment_mrad = 0.5\ndrift_um = 1.0\n"
WHOLE = {LOG: recorded()}
TAKEN = re.findall(rb'"window_from_mono_ns":"(\d+)"', contents(WHOLE[LOG]))[1].decode()
JUDGED = (
    f"""{{"time_s":1.0,"stops":4,"reason":"made up","doubts":[{{"setup":"ppp","pass_number":1,"stop":1,"code":"made-up",
"text":"x","taken_ns":{TAKEN}}}]}}""".replace("\n", "")  # noqa: E501
    + "\n"
)
LETTERHEAD = 'company = "Works"\naddress = "Street 1\\nTown"\n'

ACCEPTED = {"heidenhain": ("--accept", "profile-assumed")}

NEVER_DONE = {"fourdof show": 3, "fourdof show, contents": 3}
"""Doors whose right files end in a refusal by what they hold, after all of them was read: no run of
the head."""


@cache
def doors() -> dict[str, Door]:
    """Return every door by name."""
    return {
        **dict(_solving()),
        **dict(_results()),
        **dict(_surveys()),
        **dict(_head()),
        **dict(_controls()),
        **dict(shop_doors()),
    }


def profile_for(name: str) -> str:
    """Return a profile whose tables run over the volume of the result."""
    direction = MACHINES[name].directions[
        0 if name == "fanuc" else -1
    ]  # of both ways verify calls a table of this made up result too small
    finer = (
        0.25 if name == "fanuc" else 1.0
    )  # its coarse steps would leave this made up machine worse
    return profile_text(
        name,
        steps_mm=(100.0 * finer, 100.0 * finer, 50.0 * finer),
        references_mm=(-200.0, 0.0, -100.0),
        direction=direction,
    )


def _solving() -> Iterator[tuple[str, Door]]:
    readings, angles = {"r.csv": READINGS.decode()}, ANGLES.decode()
    out = ("--out", "out.json")
    yield "solve readings", Door(("solve", "r.csv", *out), readings, "r.csv", wrong_csv)
    straight = "position_mm,approach,EYX_um,u_EYX_um\n0,1,0,0.5\n150,1,1,0.5\n300,1,0,0.5\n"
    yield (
        "solve straightness",
        Door(
            ("solve", "r.csv", "--straightness", "s.csv", *out),
            {**readings, "s.csv": straight},
            "s.csv",
            wrong_csv,
        ),
    )
    yield (
        "solve angles",
        Door(
            ("solve", "r.csv", "--angles", "a.csv", *out),
            {**readings, "a.csv": angles},
            "a.csv",
            wrong_csv,
        ),
    )
    command = ("solve", "r.csv", "--uncertainty", "u.toml", *out)
    yield (
        "solve uncertainty",
        Door(command, {**readings, "u.toml": UNCERTAINTY}, "u.toml", wrong_toml),
    )
    command = ("solve", LOG, "--environment", "e.toml", *out)
    yield (
        "solve environment",
        Door(command, {"e.toml": ENVIRONMENT}, "e.toml", wrong_toml, WHOLE),
    )


def _results() -> Iterator[tuple[str, Door]]:
    result = {"r.json": RESULT}
    report = ("report", "r.json", "--out", "r.html")
    yield "report", Door(report, result, "r.json", wrong_json)
    yield (
        "report readings",
        Door(
            (*report, "--readings", "r.csv"),
            {**result, "r.csv": READINGS.decode()},
            "r.csv",
            wrong_csv,
        ),
    )
    yield (
        "report letterhead",
        Door(
            (*report, "--letterhead", "l.toml"),
            {**result, "l.toml": LETTERHEAD},
            "l.toml",
            wrong_toml,
        ),
    )
    yield (
        "report as left",
        Door(
            (*report, "--as-left", "s.json"),
            {**result, "s.json": RESULT},
            "s.json",
            wrong_json,
        ),
    )
    yield (
        "compare",
        Door(
            ("compare", "r.json", "s.json"),
            {**result, "s.json": RESULT},
            "s.json",
            wrong_json,
        ),
    )
    text = etalon.render(TABLED).data.decode()
    yield (
        "import",
        Door(
            ("import", "e.txt", "--chain", CHAIN, "--out", "out.json"),
            {"e.txt": text},
            "e.txt",
            wrong_words,
        ),
    )


def _surveys() -> Iterator[tuple[str, Door]]:
    survey = template().replace("/var/lib", "var")
    own, installed = {"s.toml": survey}, "etc/stepdiag/s.toml"
    yield "plan", Door(("plan", "s.toml"), own, "s.toml", wrong_toml)
    yield "status", Door(("status", "s.toml"), own, "s.toml", wrong_toml)
    yield (
        "program",
        Door(
            ("program", "s.toml", "--controller", "fanuc", "--out", "nc"),
            own,
            "s.toml",
            wrong_toml,
        ),
    )
    profile = profile_for("fanuc") + '[program]\nbegin = "G90"\n'
    command = (
        "program",
        "s.toml",
        "--controller",
        "fanuc",
        "--profile",
        "p.toml",
        "--out",
        "nc",
    )
    yield "program profile", Door(command, {**own, "p.toml": profile}, "p.toml", wrong_toml)
    yield (
        "service",
        Door(
            ("service", "install", installed, "--root", "."),
            {installed: survey},
            installed,
            wrong_toml,
        ),
    )
    yield from _logs()


def _logs() -> Iterator[tuple[str, Door]]:
    commands = {
        "info": ("info", LOG),
        "replay": ("replay", LOG, "--out", "again"),
        "solve logs": ("solve", LOG, "--out", "out.json"),
        "status of logs": ("status", "."),
        "fourdof show": ("fourdof", "show", LOG, "--out", "shown"),
    }
    for name, command in commands.items():
        yield name, Door(command, {"survey": SURVEY}, "survey", wrong_toml)
        yield (
            f"{name}, contents",
            Door(
                command, {"contents": contents(recorded()).decode()}, "contents", wrong_words
            ),
        )
    cut = {"survey of a cut log": SURVEY}
    yield (
        "recover",
        Door(
            ("recover", LOG, "--out", "mended.mcap"), cut, "survey of a cut log", wrong_toml
        ),
    )
    yield (
        "replay survey",
        Door(
            ("replay", LOG, "--survey", "s.toml", "--out", "again"),
            {"s.toml": SURVEY},
            "s.toml",
            wrong_toml,
            WHOLE,
        ),
    )
    accept = ("accept", ".", "ppp/1/1", "--reason", "seen")
    yield (
        "accept",
        Door(accept, {"survey": SURVEY, "judged.jsonl": JUDGED}, "survey", wrong_toml),
    )
    yield (
        "accept judged",
        Door(accept, {"judged.jsonl": JUDGED}, "judged.jsonl", wrong_words, WHOLE),
    )


def _head() -> Iterator[tuple[str, Door]]:
    samples, head = {"near.csv": HEAD_SAMPLES.decode()}, {"head.toml": HEAD}
    calibration = ("--calibration", "head.toml")
    yield (
        "fourdof align",
        Door(("fourdof", "align", "near.csv"), samples, "near.csv", wrong_csv),
    )
    stability = ("fourdof", "stability", "near.csv", *calibration, "--distance-mm", "500")
    yield "fourdof stability", Door(stability, {**samples, **head}, "near.csv", wrong_csv)
    calibrate = (
        "fourdof",
        "calibrate",
        "--run",
        "psd2.x=stage.csv",
        "--base",
        "head.toml",
        "--out",
        "new.toml",
    )
    stage = {"stage.csv": STAGE.decode().replace("_um", "_arcsec"), **head}
    yield "fourdof calibrate stage", Door(calibrate, stage, "stage.csv", wrong_csv)
    yield "fourdof calibrate head", Door(calibrate, stage, "head.toml", wrong_toml)
    curves = {"c.csv": CURVES.decode(), "d.csv": CURVES.decode()}
    yield (
        "fourdof compare",
        Door(
            ("fourdof", "compare", "c.csv", "--reference", "d.csv"),
            curves,
            "d.csv",
            wrong_csv,
        ),
    )


def _controls() -> Iterator[tuple[str, Door]]:
    for name in MACHINES:
        files, beside = (
            {"r.json": TABLED.to_json(), "p.toml": profile_for(name)},
            dict(MACHINES[name].files),
        )
        command = (
            "export",
            "r.json",
            "--controller",
            name,
            "--profile",
            "p.toml",
            "--out",
            "files",
            *ACCEPTED.get(name, ()),
        )
        yield f"export {name} result", Door(command, files, "r.json", wrong_json, beside)
        yield f"export {name} profile", Door(command, files, "p.toml", wrong_toml, beside)
        yield from _signtest(name)
        yield from _verify(name)


def _signtest(name: str) -> Iterator[tuple[str, Door]]:
    files, beside = (
        {"p.toml": profile_for(name), "r.json": TABLED.to_json(), "run.csv": RUN},
        dict(MACHINES[name].files),
    )
    command = ("signtest", "--controller", name, "--profile", "p.toml", "--result", "r.json")
    yield (
        f"signtest {name} profile",
        Door((*command, "--out", "bump"), files, "p.toml", wrong_toml, beside),
    )
    if name == "neutral":
        runs = {"off.csv": _linear_run(0.0), "on.csv": _linear_run(10.0)}
        yield (
            "signtest readings",
            Door(
                (*command, "--off", "off.csv", "--on", "on.csv"),
                {**files, **runs},
                "on.csv",
                wrong_csv,
                beside,
            ),
        )
        yield (
            "signtest run",
            Door((*command, "--run", "run.csv"), files, "run.csv", wrong_csv, beside),
        )


def _linear_run(bump_um: float) -> str:
    """Return readings of a run along X over a bump."""
    own = (0.0, 5.5, 11.0, 9.0, 7.0, 5.0, 3.0, 4.0, 5.0)
    moved = [
        um - bump_um * (abs(at) <= 100)
        for at, um in zip(range(-200, 201, 50), own, strict=True)
    ]
    rows = [
        f"linear-x,1,{stop},{50 * stop - 200},0,0,{50 * stop + 1e-3 * um:.4f}"
        for stop, um in enumerate(moved)
    ]
    return "setup,pass,stop,x_mm,y_mm,z_mm,reading_mm\n" + "".join(f"{row}\n" for row in rows)


def _verify(name: str) -> Iterator[tuple[str, Door]]:
    """Each kind of file that a control takes, changed without its hashes; and a set whose list of
    hashes is wrong."""
    texts, binary = _exported(name)
    profile, result = {"p.toml": profile_for(name)}, {"r.json": TABLED.to_json()}
    beside = {**MACHINES[name].files, **binary}
    tables = [
        each
        for each in texts
        if each != f"files/{SUMS}"
        and not each.endswith((".txt", ".TXT", ".json"))
        and "RESTORE" not in each
    ]
    for place in tables[:1]:
        alone = {other: text for other, text in texts.items() if other in tables}
        command = ("verify", "r.json", *alone, "--profile", "p.toml")
        yield (
            f"verify {name} table",
            Door(command, {**alone, **profile, **result}, place, wrong_words, beside),
        )
    command = ("verify", "r.json", "files", "--profile", "p.toml")
    yield (
        f"verify {name} set",
        Door(command, {**texts, **profile, **result}, f"files/{SUMS}", wrong_words, beside),
    )
    if name == "siemens":
        command = ("report", "r.json", "files", "--profile", "p.toml", "--out", "r.html")
        yield (
            "report files",
            Door(
                command, {**texts, **profile, **result}, f"files/{SUMS}", wrong_words, beside
            ),
        )


def _exported(name: str) -> tuple[dict[str, str], dict[str, bytes]]:
    """Return the files of an export: those that are ASCII with single ends of lines as text, others
    as bytes."""
    profile = parse_profile(
        profile_for(name), "p.toml", controller_named(name), VOLUME, MACHINES[name].files
    )
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "files"
        export(TABLED, name, profile, accept=Everything(), out_dir=out)  # type: ignore[arg-type]
        found = {f"files/{path.name}": path.read_bytes() for path in sorted(out.iterdir())}
    texts = {place: data.decode() for place, data in found.items() if data.isascii()}
    return texts, {place: data for place, data in found.items() if place not in texts}
