"""Every wire and file against an implementation that nobody here wrote. `make partners` brings
them.

Modbus: libmodbus as server and client, modbus-serial, jsmodbus, pymodbus' simulator. S7: snap7's C
server. Figures: promtool and Prometheus. The store: DuckDB, polars, pandas. Logs with @mcap/core,
OPC UA with node-opcua and asyncua, MQTT with mosquitto and aiomqtt stand in tests/system, on every
run.
"""

import asyncio
import json
import os
import re
import select
import shutil
import socket
import subprocess
import sys
import threading
import time
import tty
import urllib.parse
import urllib.request
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from stepdiag.base.result.result import parse_result
from stepdiag.daq.links.controls import modbus, s7
from stepdiag.daq.records.events import ReadRange
from stepdiag.fleet.archive import add
from stepdiag.fleet.store import Store
from stepdiag.virtual.base.reserved import reserved_port
from stepdiag.virtual.bench.bench import VirtualBench
from stepdiag.virtual.bench.config import load_config
from testkit.fleets import finished_survey
from testkit.running.hall import daemon, hall, until

pytestmark = pytest.mark.partner

HERE, CHECKOUT = Path(__file__).parent, Path(__file__).parents[2]
BLOCK = ReadRange("holding", 0, 14)
HELD = b"".join((1000 + at).to_bytes(2, "big") for at in range(14))
PATIENCE_S = 30.0


@contextmanager
def process(*command, cwd=None):
    """Run a partner; it is ready when its first line stands there."""
    with subprocess.Popen(
        list(map(str, command)), stdout=subprocess.PIPE, text=True, cwd=cwd
    ) as run:
        try:
            assert run.stdout.readline() == "ready\n"
            yield run
        finally:
            run.kill()


@contextmanager
def cable():
    """Two serial lines, each the far end of the other."""
    ends = [os.openpty() for _ in range(2)]
    for _, near in ends:
        tty.setraw(near)
    stop = threading.Event()

    def carry():
        (one, _), (other, _) = ends
        while not stop.is_set():
            for ready in select.select([one, other], [], [], 0.05)[0]:
                os.write(other if ready == one else one, os.read(ready, 4096))

    thread = threading.Thread(target=carry)
    thread.start()
    try:
        yield tuple(os.ttyname(near) for _, near in ends)
    finally:
        stop.set()
        thread.join()
        for far, near in ends:
            os.close(far)
            os.close(near)


@pytest.fixture(scope="session")
def plc(tmp_path_factory):
    """The control of plc.c."""
    program = tmp_path_factory.mktemp("plc") / "plc"
    flags = subprocess.run(
        ["pkg-config", "--cflags", "--libs", "libmodbus"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    subprocess.run(["gcc", "-O1", "-o", program, HERE / "plc.c", *flags], check=True)
    return program


async def exchanged(module, settings, ranges, address, value):
    """Poll three times and write a word, as the daemon does; return the first range of each
    poll."""
    link = await module.open_link(settings, ranges)
    try:
        polls = [(await link.read()).data[0] for _ in range(3)]
        await link.write_word(
            "holding" if module is modbus else ranges[0].table, address, value
        )
        return polls
    finally:
        link.close()


def follows(run, settings):
    """A Modbus control that holds the block gives it at every poll and takes the handshake."""
    assert asyncio.run(exchanged(modbus, settings, [BLOCK], 100, 7)) == [HELD] * 3
    assert run.stdout.readline() == "100=7\n"


def test_libmodbus_over_tcp(plc):
    port = reserved_port()
    with process(plc, "tcp", port) as run:
        follows(run, modbus.TcpSettings(host="127.0.0.1", port=port, timeout_s=5.0))


def test_libmodbus_over_a_serial_line(plc):
    with cable() as (ours, theirs), process(plc, "rtu", theirs) as run:
        follows(run, modbus.RtuSettings(port=ours, parity="N", timeout_s=5.0))


@pytest.mark.parametrize("program", ["modbus-serial.mjs", "jsmodbus.mjs"])
def test_a_control_made_of_node(program):
    port = reserved_port()
    with process("node", program, port, cwd=HERE / "js") as run:
        follows(run, modbus.TcpSettings(host="127.0.0.1", port=port, timeout_s=5.0))


def test_the_simulator_of_pymodbus(tmp_path):
    port, http = reserved_port(), reserved_port()
    registers = [{"addr": at, "value": 1000 + at} for at in range(14)]
    device = {
        "setup": {
            "co size": 0,
            "di size": 0,
            "hr size": 101,
            "ir size": 0,
            "shared blocks": True,
            "type exception": False,
            "defaults": {
                "value": dict.fromkeys(("bits", "uint16", "uint32", "float32"), 0)
                | {"string": " "},
                "action": dict.fromkeys(("bits", "uint16", "uint32", "float32", "string")),
            },
        },
        "invalid": [],
        "write": [100],
        "bits": [],
        "uint16": [*registers, 100],
        "uint32": [],
        "float32": [],
        "string": [],
        "repeat": [],
    }
    names = (
        "VendorName",
        "ProductCode",
        "VendorUrl",
        "ProductName",
        "ModelName",
        "MajorMinorRevision",
    )
    server = {
        "comm": "tcp",
        "host": "127.0.0.1",
        "port": port,
        "framer": "socket",
        "device_id": 1,
        "identity": dict.fromkeys(names, ""),
    }
    setup = tmp_path / "setup.json"
    setup.write_text(
        json.dumps({"server_list": {"server": server}, "device_list": {"device": device}}),
        encoding="utf-8",
    )
    command = [
        sys.executable,
        "-m",
        "pymodbus.server.simulator.main",
        "--modbus_server",
        "server",
        "--modbus_device",
        "device",
        "--http_host",
        "127.0.0.1",
        "--http_port",
        str(http),
        "--json_file",
        str(setup),
    ]
    with (
        (tmp_path / "said.txt").open("w") as log,
        subprocess.Popen(command, stdout=log, stderr=log, cwd=tmp_path) as run,
    ):
        try:
            _listening(port)
            settings = modbus.TcpSettings(host="127.0.0.1", port=port, timeout_s=5.0)
            assert asyncio.run(exchanged(modbus, settings, [BLOCK], 100, 7)) == [HELD] * 3
            (written,) = asyncio.run(
                exchanged(modbus, settings, [ReadRange("holding", 100, 1)], 100, 7)
            )[:1]
            assert written == b"\x00\x07"
        finally:
            run.kill()


def test_libmodbus_reads_the_virtual_control(tmp_path):
    """mbpoll, a client of libmodbus, sees the setup and the position at which the virtual machine
    stands."""
    text = (
        'time_scale = 20.0\n[volume]\nincrements = 1\n[program]\nsetups = ["ppp"]\npause_s = '
        "2000.0\n"
    )
    bench = VirtualBench(load_config(text), tmp_path)
    bench.start()
    try:
        port = str(bench.addresses["plc_port"])
        told = subprocess.run(
            [
                "mbpoll",
                "-m",
                "tcp",
                "-p",
                port,
                "-a",
                "1",
                "-r",
                "1",
                "-c",
                "14",
                "-t",
                "4",
                "-1",
                "127.0.0.1",
            ],
            capture_output=True,
            text=True,
            check=True,
            timeout=PATIENCE_S,
        )
        assert len(re.findall(r"^\[\d+\]:", told.stdout, flags=re.MULTILINE)) == 14
    finally:
        bench.close()


def test_the_c_server_of_snap7():
    port = reserved_port()
    with process(CHECKOUT / ".setup/snap7/bin/python", HERE / "snap7_server.py", port) as run:
        settings = s7.S7Settings(host="127.0.0.1", port=port, timeout_s=5.0)
        polls = asyncio.run(exchanged(s7, settings, [ReadRange("db1", 0, 14)], 20, 7))
        assert polls == [bytes(range(10, 24))] * 3
        assert run.stdout.readline() == "20=7\n"


def test_prometheus_evaluates_every_panel_of_the_dashboard(tmp_path):
    """promtool finds nothing to say of the figures; a real server scrapes a recording daemon, and
    every expression gives a value."""
    port, ours = reserved_port(), reserved_port()
    (tmp_path / "hall").mkdir()
    with hall(tmp_path / "hall", setups=("linear-x",)) as place:
        place.survey.write_text(
            f"{place.survey.read_text()}\n[metrics]\nenabled = true\nport = {ours}\n",
            encoding="utf-8",
        )
        with daemon(place.survey) as running, prometheus(tmp_path, port, ours):
            place.start_setups()
            until(running, "survey-complete")
            with urllib.request.urlopen(
                f"http://127.0.0.1:{ours}/metrics", timeout=PATIENCE_S
            ) as answer:
                figures = answer.read()
            linted = subprocess.run(
                ["promtool", "check", "metrics"],
                input=figures,
                capture_output=True,
                check=False,
            )
            assert (linted.returncode, linted.stdout + linted.stderr) == (0, b"")
            # a rate has no value before its second scrape; a good survey has no findings
            until_ns = time.monotonic_ns() + int(1e9 * PATIENCE_S)
            empty: list[str] = []
            while empty != ["Findings, by code"] and time.monotonic_ns() < until_ns:
                time.sleep(0.5)
                empty = [
                    title for title, expression in panels() if not query(port, expression)
                ]
    assert empty == ["Findings, by code"]


def panels():
    """Return title and expression of every panel, Grafana's own variables filled in."""
    board = json.loads((CHECKOUT / "docs/layouts/grafana.json").read_text(encoding="utf-8"))
    for panel in board["panels"]:
        for target in panel.get("targets", []):
            yield (
                panel["title"],
                target["expr"].replace("$instance", ".*").replace("$__rate_interval", "30s"),
            )


def query(port, expression):
    url = f"http://127.0.0.1:{port}/api/v1/query?" + urllib.parse.urlencode(
        {"query": expression}
    )
    with urllib.request.urlopen(url, timeout=PATIENCE_S) as answer:
        told = json.load(answer)
    assert told["status"] == "success", told
    return told["data"]["result"]


@contextmanager
def prometheus(folder, port, scraped):
    """Run a server that scrapes the daemon every second."""
    setup = folder / "prometheus.yml"
    setup.write_text(
        "global: {scrape_interval: 1s}\n"
        f"scrape_configs: [{{job_name: stepdiag, static_configs: [{{targets: "
        f"['127.0.0.1:{scraped}']}}]}}]\n",
        encoding="utf-8",
    )
    command = [
        "prometheus",
        f"--config.file={setup}",
        f"--storage.tsdb.path={folder / 'tsdb'}",
        f"--web.listen-address=127.0.0.1:{port}",
    ]
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as run:
        try:
            _listening(port)
            yield
        finally:
            run.terminate()


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """A store with one survey, and the values of EXX in its result."""
    folder = tmp_path_factory.mktemp("store")
    survey = finished_survey(folder / "survey")
    add(survey, Store(str(folder / "store"), create=True))
    result = parse_result((survey / "result.json").read_text(encoding="utf-8"))
    return folder / "store", result.errors["EXX"].value.tolist()


FILES = "machine=*/year=*/*.parquet"


def test_duckdb_reads_the_store(store):
    import duckdb

    root, values = store
    sql = (
        f"select value from read_parquet('{root}/{FILES}', union_by_name=true) where quantity = "
        "'EXX' order by position_mm"
    )
    assert [row[0] for row in duckdb.sql(sql).fetchall()] == values


def test_polars_reads_the_store(store):
    import polars as pl

    root, values = store
    rows = pl.concat(
        [pl.read_parquet(path, hive_partitioning=False) for path in root.glob(FILES)],
        how="diagonal",
    )
    assert (
        rows.filter(pl.col("quantity") == "EXX").sort("position_mm")["value"].to_list()
        == values
    )


def test_pandas_reads_the_store(store):
    import pandas as pd

    root, values = store
    rows = pd.concat([pd.read_parquet(path, partitioning=None) for path in root.glob(FILES)])
    assert rows[rows.quantity == "EXX"].sort_values("position_mm").value.tolist() == values


def test_every_partner_is_here():
    """A partner that is missing fails by its name, before its test fails by something else."""
    assert [
        name
        for name in ("gcc", "pkg-config", "mbpoll", "node", "prometheus", "promtool")
        if shutil.which(name) is None
    ] == []


def _listening(port):
    end = time.monotonic() + PATIENCE_S
    while True:
        with suppress(OSError):
            socket.create_connection(("127.0.0.1", port), timeout=5).close()
            return
        assert time.monotonic() < end, "nobody listens"
        time.sleep(0.05)
