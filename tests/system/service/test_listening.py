"""The ports of every command that serves: those that are documented, and no other; a command that
works on files has none.

In this test's own process every command that the tests call is watched for ports (`testkit.cli`).
"""

import socket
import subprocess
import sys
import urllib.error
import urllib.request

import pytest

from stepdiag.fleet.store import Store
from stepdiag.virtual.base.reserved import reserved_port
from testkit.cli import stepdiag
from testkit.fleets import write_history
from testkit.running.hall import daemon, hall
from testkit.running.opcua import Serving, prepared
from testkit.running.ports import listening

pytestmark = pytest.mark.system


def test_the_recorder_listens_for_page_and_metrics_alone(tmp_path):
    page, metrics = reserved_port(), reserved_port()
    with hall(tmp_path, page=True, page_port=page) as place:
        place.survey.write_text(
            f"{place.survey.read_text()}\n[metrics]\nenabled = true\nport = {metrics}\n"
        )
        with daemon(place.survey) as process:
            assert listening(process.process.pid) == {("tcp", page), ("tcp", metrics)}


def test_the_page_of_a_fleet_is_one_port_and_shows_nothing_without_its_token(tmp_path):
    write_history(Store(str(tmp_path / "store"), create=True), "Lathe", [5.0, 5.1, 5.2, 5.4])
    port = reserved_port()
    command = [
        sys.executable,
        "-m",
        "stepdiag",
        "fleet",
        str(tmp_path / "store"),
        "--port",
        str(port),
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            address = process.stdout.readline().split()[0]
            with opened(address) as answer:
                assert b"Lathe" in answer.read()
                assert "token" not in answer.geturl()
            with pytest.raises(urllib.error.HTTPError, match="401"):
                opened(address.partition("?")[0])
            assert listening(process.pid) == {("tcp", port)}
        finally:
            process.terminate()


def opened(address):
    """Open an address as a browser does: a cookie that is set goes back."""
    for _ in range(100):
        try:
            return urllib.request.build_opener(urllib.request.HTTPCookieProcessor()).open(
                address, timeout=60
            )
        except urllib.error.HTTPError:
            raise
        except urllib.error.URLError:
            continue
    raise AssertionError(address)


def test_what_publishes_by_opc_ua_listens_on_its_own_port_alone(tmp_path):
    with Serving(prepared(tmp_path), "--plain") as serving:
        assert listening(serving.process.pid) == {
            ("tcp", int(serving.url.split(":")[2].partition("/")[0]))
        }


def test_a_port_that_a_command_opens_is_seen(monkeypatch):
    """The watch of all other tests: a command that binds a port is an error there."""

    def opens_a_port(*_, **__):
        with socket.socket() as one:
            one.bind(("127.0.0.1", 0))

    monkeypatch.setattr("stepdiag.fleet.store.Store.__init__", opens_a_port)
    with pytest.raises(AssertionError, match="listens on"):
        stepdiag("trend", "store")
