"""what somebody else may hand to the program, one target for each kind of file or stream: the worst
that may happen is a refusal.

A target does with the bytes all that the program would do: what a reader lets pass must not bring
down what comes after it.
"""

import asyncio
import struct
import tempfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np
from starlette.requests import Request

from stepdiag.base.errors import StepdiagError
from stepdiag.base.readings.readings import parse_readings, render_readings
from stepdiag.base.result.result import Result, parse_result
from stepdiag.comparing.compare import compare, trend
from stepdiag.daemon.driving import sequence_of
from stepdiag.daq.capture.capture import Capture
from stepdiag.daq.formats.instruments.angles import ELCOMAT, WYLER, AnglesSettings
from stepdiag.daq.formats.instruments.fourdof import FourdofSettings
from stepdiag.daq.formats.instruments.framed import FramesSettings
from stepdiag.daq.formats.instruments.ids3010 import Ids3010Settings
from stepdiag.daq.formats.instruments.lasertex import LasertexDecoder, LasertexSettings
from stepdiag.daq.formats.instruments.line import LineSettings
from stepdiag.daq.formats.instruments.nd import NdSettings
from stepdiag.daq.formats.instruments.qudis import QudisSettings
from stepdiag.daq.formats.instruments.tqd import TqdSettings
from stepdiag.daq.formats.instruments.umd.decoder import UmdSettings
from stepdiag.daq.formats.registry import make_decoder
from stepdiag.daq.formats.signals import (
    CONTRACT_SIGNALS,
    SignalDecoder,
    SignalSpec,
    plan_reads,
)
from stepdiag.daq.log.codec import decode
from stepdiag.daq.log.reader import DAMAGE
from stepdiag.daq.log.topics import RAW_TOPICS
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.records.events import ModbusBlock
from stepdiag.daq.survey.bundle import read_bundle
from stepdiag.daq.survey.file import load_survey, parse_survey
from stepdiag.daq.survey.head_file import parse_head_file, render_head_file
from stepdiag.daq.survey.template import template
from stepdiag.daq.timing.stream import StreamBuffer
from stepdiag.exporters.export.export import export
from stepdiag.exporters.safety.verify import verify_files
from stepdiag.exporters.tables import lattice
from stepdiag.fourdof.calibrated import calibrated
from stepdiag.fourdof.commissioning import (
    calibrate_axis,
    compare_curves,
    parse_curves,
    parse_stage_run,
    stability_of,
)
from stepdiag.fourdof.record import read_head_csv
from stepdiag.page.app import Page
from stepdiag.page.messages import PageSettings
from stepdiag.report.document import build_report
from stepdiag.solver.fourdof.head import motion
from stepdiag.solver.methods.registry import METHODS
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.methods.standard_figures import standards_report
from stepdiag.solver.model.angles import parse_angles, render_angles
from stepdiag.solver.model.layout import lay_out
from stepdiag.virtual.instruments.interferometers import Climate, Lasertex
from testkit.exact.heads import head_file, survey_section
from testkit.exact.results import made_result
from testkit.exact.surveys import Bench
from testkit.hostile.foreign_base import Target, refusing, text_of
from testkit.hostile.foreign_logs import log_targets
from testkit.hostile.foreign_tables import Everything, table_targets
from testkit.timeline import survey_text

FORMATS = {
    "umd": UmdSettings(),
    "line": LineSettings(
        pattern=r"(?P<position>[-+0-9.]+) (?P<counter>\d+) (?P<beam>[0-9.]+)"
    ),
    "nd": NdSettings(),
    "fourdof": FourdofSettings(),
    "tqd": TqdSettings(),
    "ids3010": Ids3010Settings(),
    "lasertex": LasertexSettings(),
    "qudis": QudisSettings(),
    "frames": FramesSettings(
        sync="AA55",
        layout=("counter u16", "position i32", "beam f32", "status u8"),
        unit="nm",
    ),
    "elcomat": AnglesSettings(pattern=ELCOMAT, unit="arcsec"),
    "wyler": AnglesSettings(pattern=WYLER, unit="mrad", request="P"),
}
STREAM = (
    b"1500 1500 1000 3 9 1 8 100000\r\n1500 1499 1001 1 9 2 10 6000\r\n1500 0 1002 1 9 3 0 "
    b"0\r\n+1.234 17 0.9\r\n+   12.3456 \r\n"
)
LASER = Lasertex(
    lambda: Climate(air_c=20.0, material_c=20.0, pressure_hpa=1013.0, humidity_percent=50.0)
)
LASER.respond(LasertexDecoder.greeting)
HEIGHTS = np.linspace(0.0, 1.0, 8)
STREAMS = {
    "ids3010": b'{"jsonrpc": "2.0", "result": [0, 640, 500], "id": 2}\r\n{"jsonrpc": "2.0", '
    b'"result": [0, 1, 1234567890, 3], "id": 1}\r\n',
    "lasertex": LASER.encode(HEIGHTS, HEIGHTS > 0.2),
    "frames": b"".join(
        b"\xaa\x55" + struct.pack("<HifB", number, 1000 * number, 0.9, 0)
        for number in range(8)
    ),
    "qudis": struct.pack("<7i", 24, 3, 0x0773, 0, 1, 0, 1)
    + struct.pack("<5i4I", 32, 4, 0x0F00, 7, 0, 5, 1 << 31, 9, 1 << 31),
    "elcomat": b"3 013 1.234 -0.567\r3 011 1.235 -0.567\r",
    "wyler": b"A 0.0123 mm/m\rA 0.0124 mm/m\r",
}
"""Of the formats that `STREAM` means nothing to."""
MESSAGE = (
    b'{"time":{"sec":1,"nsec":2},"t_mono_ns":"5","order":0,"skip":[0],"run":[1],"after_us":[0],'
    b'"data":["x"]}'
)
ANGLES = (
    b"axis,position_mm,EA_urad,EB_urad,EC_urad,u_urad\nx,0,0,0,0,0.1\nx,100,1,2,,0.1\nx,300,2,3,"
    b"4,0.1\n"
)
CURVES = (
    b"position_mm,EYX_um,EBX_arcsec,ECX_urad\n0,0,0,0\n100,1.5,2,3\n200,-1,0.5,\n300,0,0,1\n"
)
STAGE = b"reading,reference_um\n" + b"".join(
    b"%.2f,%d\n" % (0.1 * step, 65 * step) for step in range(-6, 7)
)


def wobble(qd_x: float, qd_y: float) -> bytes:
    """Samples of a head that stands while the laser's pointing wobbles; the QD's spot moves in
    proportion to its distance."""
    rows = (
        f"{0.5 * n:.1f},{qd_x * n:.0f},{qd_y * n:.0f},1000000,{50 * n},{70 * n},1000000,{-50 * n}"
        f",{-70 * n},1000000\n"
        for n in range(8)
    )
    return (
        "time_s,qd_x,qd_y,qd_sum,psd1_x,psd1_y,psd1_sum,psd2_x,psd2_y,psd2_sum\n"
        + "".join(rows)
    ).encode()


HEAD_SAMPLES, FAR_SAMPLES = wobble(351.0, -491.4), wobble(989.4, -1385.2)
"""300 and 900 mm from a head whose lever is 30 mm longer than the distance."""
BENCH = Bench(size_mm=(300.0, 200.0, 100.0), increments=2)
READINGS = render_readings(BENCH.survey()).encode()
HEAD = render_head_file(head_file())
RESULT = made_result({"EXX": [0.0, 11.0, 7.0, 3.0, 5.0]}, squareness={"C0Y": 12.0})
OTHER_REGISTERS = {
    "stopped": SignalSpec(address=3, table="coil", type="bit"),
    "x_mm": SignalSpec(address=9, type="float32", order="CDAB", scale=1e-3),
    "stop_count": SignalSpec(address=7, table="input", type="uint32", order="DCBA"),
}


def targets() -> dict[str, Target]:
    """Return every target by name."""
    found = {
        f"decoder {name}": Target(STREAMS.get(name, STREAM), _decoded(name))
        for name in FORMATS
    }
    found["log message"] = Target(MESSAGE, _message)
    found["registers"] = Target(bytes(range(28)) * 2, refusing(_registers))
    found["readings"] = Target(READINGS, refusing(_readings), weight=0.3)
    found["angles"] = Target(ANGLES, refusing(_angles), weight=0.5)
    found["result"] = Target(_result_seed(), refusing(_result), weight=0.2)
    found["survey"] = Target(template().encode(), refusing(_survey))
    found["survey of a head"] = Target(_head_survey().encode(), refusing(_survey))
    found["files of a survey"] = Target(
        b'[machine]\nexisting = ["a.txt"]\n', refusing(_files_of_a_survey)
    )
    found["head file"] = Target(HEAD.encode(), refusing(_head_file))
    found["head samples"] = Target(HEAD_SAMPLES, refusing(_head_samples))
    found["stage run"] = Target(STAGE, refusing(_stage_run))
    found["curves"] = Target(CURVES, refusing(_curves))
    found["page order"] = Target(
        b'{"name":"name","arguments":{"operator":"A","workpiece":"B"}}', page_order
    )
    return found | log_targets() | table_targets()


def _decoded(name: str) -> Callable[[bytes], object]:
    def target(data: bytes) -> object:
        buffer = StreamBuffer(make_decoder(name, FORMATS[name]))  # type: ignore[arg-type]
        half = len(data) // 2
        for number, chunk in enumerate((data[:half], data[half:], data)):
            buffer.feed(chunk, (number + 1) * 20_000_000)
        return buffer.heard(), buffer.span(0, 1e12), buffer.breaks

    return target


def _message(data: bytes) -> object:
    try:
        return [decode(topic, data) for topic in RAW_TOPICS.values()]
    except DAMAGE:
        return None


def _registers(data: bytes) -> object:
    seen = []
    for signals in (CONTRACT_SIGNALS, OTHER_REGISTERS):
        ranges = plan_reads(signals)
        answers = tuple(
            data[place : place + asked.byte_count] for place, asked in enumerate(ranges)
        )
        seen.append(SignalDecoder(signals).decode(ModbusBlock(0, 1000, ranges, answers)))
    return seen


def _readings(data: bytes) -> object:
    readings = parse_readings(text_of(data), "foreign")
    render_readings(readings)
    with suppress(StepdiagError):
        standards_report(lay_out(readings))
    for method in METHODS:
        with suppress(StepdiagError):
            solve(readings, method=method).to_json()
    with suppress(StepdiagError):
        build_report(RESULT, source="result.json", readings=readings)
    return readings


def _angles(data: bytes) -> object:
    angles = parse_angles(text_of(data), "foreign")
    render_angles(angles)
    return solve(parse_readings(READINGS.decode()), angles=angles).to_json()


def _result_seed() -> bytes:
    return solve(parse_readings(READINGS.decode())).to_json().encode()


def _exported_quickly(result: Result) -> object:
    with tempfile.TemporaryDirectory() as folder:
        return export(
            result,
            "siemens",
            None,
            step_mm=float(result.volume.step_mm[0]),
            accept=Everything(),
            out_dir=Path(folder),
        )


def _result(data: bytes) -> object:
    result = parse_result(text_of(data), "foreign")
    result.to_json().encode("utf-8")
    good = parse_result(_result_seed().decode())
    for ask in (
        lambda: compare(good, result),
        lambda: trend([good, result, good]),
        lambda: _exported_quickly(result),
        lambda: verify_files(
            result,
            [lattice.render(lattice.lattice_of(result, float(result.volume.step_mm[0])))],
            nodes=3,
        ),
        lambda: build_report(result, source="foreign"),
    ):
        with suppress(StepdiagError):
            ask()
    return result


def _survey(data: bytes) -> object:
    survey = parse_survey(text_of(data), "foreign")
    book = PassBook(survey)
    Capture(survey, book.start(skip_open_dwell=False)).finish()
    return sequence_of(survey)


def _files_of_a_survey(data: bytes) -> object:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "survey.toml"
        path.write_text(
            _head_survey()
            + '[[export]]\ncontroller = "siemens"\nprofile = "profile.toml"\n[solver]\nangles = '
            '"angles.csv"\n'
        )
        (Path(folder) / "head.toml").write_text(HEAD)
        for name in ("angles.csv", "profile.toml", "a.txt", "head.toml"):
            (Path(folder) / name).write_bytes(data)
            with suppress(StepdiagError):
                read_bundle(path, load_survey(path))
    return None


def _head_survey() -> str:
    return survey_text(setups=("ppp", "fourdof-x"), signals=survey_section("/dev/null1"))


def _head_file(data: bytes) -> object:
    file = parse_head_file(data, "foreign")
    render_head_file(file)
    record = read_head_csv(HEAD_SAMPLES.decode(), "")
    return motion(record.channels, np.full(len(record.channels), 500.0), calibrated(file))


def _head_samples(data: bytes) -> object:
    record = read_head_csv(text_of(data), "foreign")
    return stability_of(record, head_file(), 500.0, 1.0)


def _stage_run(data: bytes) -> object:
    run = parse_stage_run(text_of(data), "foreign")
    for detector in ("qd", "psd2"):
        with suppress(StepdiagError):
            calibrate_axis(run, detector, head_file(), degree=5, u_reference=0.1)
    return run


def _curves(data: bytes) -> object:
    return compare_curves(
        parse_curves(CURVES.decode(), ""), parse_curves(text_of(data), "foreign")
    )


class _Heeding:
    """Stands for the daemon: takes what the page lets through."""

    async def order(self, name: str, arguments: Mapping[str, str], _address: str) -> str:
        assert isinstance(name, str)
        assert all(isinstance(word, str) for item in arguments.items() for word in item)
        return ""

    def say_guesses(self, _address: str, _count: int) -> None:
        """Hear of wrong tokens."""


def page_order(data: bytes) -> object:
    """Send the bytes as the order of somebody who has the token, and as the token of somebody who
    has not."""
    page = Page(_Heeding(), PageSettings(folder="", token="secret"))  # type: ignore[arg-type]
    page.access.guesses.delay_s = 0.0
    answers = [
        asyncio.run(_answered(page, b"Bearer secret", data)),
        asyncio.run(_answered(page, b"Bearer " + data, data)),
    ]
    assert answers[0] in (204, 400)
    assert answers[1] == 403 or data == b"secret"
    return answers


async def _answered(page: Page, authorization: bytes, body: bytes) -> int:
    parts = [{"type": "http.request", "body": body, "more_body": False}]

    async def receive() -> dict[str, object]:
        return parts.pop()

    scope = {
        "type": "http",
        "method": "POST",
        "path": "/command",
        "headers": [(b"authorization", authorization)],
    }
    return (await page.command(Request(scope, receive))).status_code
