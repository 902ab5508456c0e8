"""Old surveys solved anew in processes and on a real Dask cluster: nothing lost, nothing twice, the
same bytes where nothing changed.

Nobody without a certificate reaches a scheduler or a worker, from this computer neither.
"""

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from stepdiag.base.result.members import software
from stepdiag.fleet.archive import add
from stepdiag.fleet.store import Store, manifest_of
from testkit.cli import stepdiag
from testkit.fleets import finished_survey, series_of
from testkit.running.ports import listening

pytestmark = pytest.mark.system
SURVEYS = 4


@pytest.fixture(scope="module")
def surveys(tmp_path_factory):
    """Finished surveys of as many machines."""
    folder = tmp_path_factory.mktemp("surveys")
    return [
        finished_survey(folder / str(number), machine=f"M{number}")
        for number in range(SURVEYS)
    ]


@pytest.fixture
def store(surveys, tmp_path):
    made = Store(str(tmp_path / "store"), create=True)
    for each in surveys:
        add(each, made)
    return made


def resolving(store, *options):
    """Start the command."""
    command = [sys.executable, "-m", "stepdiag", "resolve", store.root, *map(str, options)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def workers_of(pid):
    """Return the processes of the cluster that compute: those of multiprocessing below the
    command."""
    found = []
    for line in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(line.read_text().rpartition(")")[2].split()[1])
            words = (line.parent / "cmdline").read_bytes()
        except OSError:
            continue
        if parent == pid and b"spawn_main" in words:
            found.append(int(line.parent.name))
    return found


def test_a_worker_killed_in_mid_run_loses_nothing_and_the_bytes_are_the_same(store):
    before = sorted(path for path in Path(store.root).rglob("*") if path.is_file())
    with resolving(store, "--workers", 2) as running:
        first = running.stdout.readline()
        assert len(workers_of(running.pid)) == 2
        assert listening(running.pid) == set()
        os.kill(workers_of(running.pid)[0], signal.SIGKILL)
        told, errors = running.communicate(timeout=240)
    assert running.returncode == 0, errors
    lines = [first, *told.splitlines()]
    assert len({line.split(": ")[1] for line in lines}) == len(lines) == SURVEYS
    assert all("same bytes as before" in line for line in lines), lines
    assert sorted(path for path in Path(store.root).rglob("*") if path.is_file()) == before, (
        "what is the same is not written again"
    )


def test_another_version_writes_beside_says_what_changed_and_goes_on_where_it_stopped(
    store, tmp_path
):
    """Three surveys are as if an older version had solved them, one of them otherwise; the
    scheduler is one that was there already."""
    version = software().version
    for number, place in enumerate(store.tables()[:3]):
        path = Path(store.path(place.folder)) / "result.json"
        result = json.loads(path.read_text(encoding="utf-8"))
        result["software"]["version"] = "0.0.1"
        if number == 0:
            result["squareness"]["C0Y"] = {
                "value": 5000.0,
                "u": 1.0,
                "u_readings": 1.0,
                "unit": "urad",
            }
        path.write_text(json.dumps(result), encoding="utf-8")
        files, table = store.listed(place)
        files = {**files, "result.json": hashlib.sha256(path.read_bytes()).hexdigest()}
        Path(store.path(place.listed)).write_bytes(manifest_of(place, files, table))
    with cluster(tmp_path) as there:
        found = json.loads(
            finished(resolving(store, *there.options, "--machine", "M1", "--json"))
        )
        assert [each["outcome"] for each in found] == ["solved anew"]
        with resolving(store, *there.options, "--json") as running:
            assert listening(running.pid) == set()
            found += json.loads(finished(running))
    assert sorted(each["outcome"] for each in found) == ["solved anew"] * 3 + [
        "the same bytes"
    ] * (SURVEYS - 3)
    assert len({each["survey"] for each in found}) == SURVEYS, (
        "what was done already is not done again"
    )
    assert {each.machine for each in series_of(store, software=version)} == {"M0", "M1", "M2"}
    assert {each.machine for each in series_of(store)} == {
        f"M{number}" for number in range(SURVEYS)
    }


def test_a_scheduler_that_is_away_is_said(store, tmp_path, monkeypatch):
    monkeypatch.setattr("stepdiag.fleet.resolve.PATIENCE_S", 1)
    told = stepdiag(
        "resolve", store.root, "--scheduler", "tls://127.0.0.1:9", *certificates(tmp_path)
    )
    assert told.code == 4
    assert "Dask scheduler" in told.refusal


@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:8786", "127.0.0.1:8786", "scheduler.json", "inproc://1"]
)
def test_a_scheduler_without_tls_is_refused(store, tmp_path, address):
    told = stepdiag("resolve", store.root, "--scheduler", address, *certificates(tmp_path))
    assert told.code == 2
    assert "tls://HOST:PORT" in told.refusal


@pytest.mark.parametrize("missing", ["--ca", "--certificate", "--key"])
def test_a_scheduler_needs_every_certificate(store, tmp_path, missing):
    given = certificates(tmp_path)
    at = given.index(missing)
    told = stepdiag(
        "resolve",
        store.root,
        "--scheduler",
        "tls://127.0.0.1:9",
        *given[:at],
        *given[at + 2 :],
    )
    assert (told.code, told.refusal.startswith(missing)) == (2, True)


def test_a_scheduler_whose_certificate_another_ca_signed_gets_no_task(
    store, tmp_path, monkeypatch
):
    monkeypatch.setattr("stepdiag.fleet.resolve.PATIENCE_S", 3)
    (tmp_path / "stranger").mkdir()
    with cluster(tmp_path / "stranger", workers=0) as there:
        told = stepdiag("resolve", store.root, *there.options[:2], *certificates(tmp_path))
    assert told.code == 4


def certificates(folder):
    """Return the options that name a CA, a certificate signed by it and its key: one self-signed
    certificate for all roles."""
    if not (folder / "dask.pem").exists():
        command = (
            "openssl req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=dask -keyout dask.key "
            "-out dask.pem"
        )
        subprocess.run(command.split(), cwd=folder, check=True, capture_output=True)
    return (
        "--ca",
        str(folder / "dask.pem"),
        "--certificate",
        str(folder / "dask.pem"),
        "--key",
        str(folder / "dask.key"),
    )


def finished(process):
    """Return what a command said, once it is done."""
    told, errors = process.communicate(timeout=240)
    assert process.returncode == 0, errors
    return told


class cluster:  # noqa: N801  # a context like those of functions
    """A scheduler and its workers, each a process of its own."""

    def __init__(self, folder, workers=2):
        self.workers = workers
        self.file = folder / "scheduler.json"
        self.folder = folder
        self.processes = []

    def __enter__(self):
        given = certificates(self.folder)
        tls = ("--tls-ca-file", given[1], "--tls-cert", given[3], "--tls-key", given[5])
        self._start(
            "distributed.cli.dask_scheduler",
            "--host",
            "tls://127.0.0.1:0",
            "--no-dashboard",
            *tls,
            "--scheduler-file",
            self.file,
        )
        end = time.monotonic() + 120
        while not self.file.exists() or not self.file.read_text():
            assert time.monotonic() < end
            time.sleep(0.1)
        address = json.loads(self.file.read_text())["address"]
        for _ in range(self.workers):
            self._start(
                "distributed.cli.dask_worker",
                address,
                *tls,
                "--nthreads",
                "1",
                "--no-dashboard",
                "--local-directory",
                self.folder,
            )
        self.options = ("--scheduler", address, *given)
        return self

    def __exit__(self, *_):
        for process in reversed(self.processes):
            process.terminate()
        for process in self.processes:
            process.wait(60)

    def _start(self, module, *options):
        command = [sys.executable, "-m", module, *map(str, options)]
        self.processes.append(
            subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        )
