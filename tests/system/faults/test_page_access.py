"""Who gets what from the page: names, origins, tokens, files; over real connections to the page's
own process."""

import http.client
import json
import socket
import ssl
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor
from urllib.parse import quote

import pytest

from testkit.played import served

pytestmark = pytest.mark.system
TOKEN = "a token of the tests: äöü"


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """A page with a token over a finished survey; what is asked here changes nothing."""
    with served(
        tmp_path_factory.mktemp("page"), token=TOKEN, names=("mill.example.org",)
    ) as running:
        running.do(running.survey.complete)
        yield running


def ask(page, path, *, method="GET", body=b"", **headers):
    """Return status, headers and body; a POST names the page as its origin, as a browser on the
    page does, unless another is given."""
    connection = http.client.HTTPConnection(page.address.removeprefix("http://"), timeout=60)
    if method == "POST":
        headers = {
            "Origin": f"http://{headers.get('Host') or page.address.removeprefix('http://')}",
            **headers,
        }
    connection.request(
        method, path, body, {name.replace("_", "-"): value for name, value in headers.items()}
    )
    answer = connection.getresponse()
    told = answer.status, dict(answer.getheaders()), answer.read()
    connection.close()
    return told


def bearer(token):
    """Return the header that carries a token."""
    return f"Bearer {quote(token)}"


@pytest.mark.parametrize(
    "host",
    [
        "localhost:8420",
        "127.0.0.1",
        "127.9.9.9:1",
        "[::1]:8420",
        "LOCALHOST.",
        "mill.example.org",
        "Mill.Example.org:443",
    ],
)
def test_names_of_this_computer_are_answered(page, host):
    assert ask(page, "/about.json", Host=host)[0] == 200


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "127.0.0.1.evil.example",
        "localhost.evil.example:8420",
        "10.1.2.3",
        "",
        "[::2]",
        "mill.example.org.evil",
        "0x7f.1",
        "a:b",
    ],
)
@pytest.mark.parametrize("path", ["/", "/stream", "/result.json"])
def test_a_name_that_only_points_here_is_not(page, host, path):
    """DNS rebinding: the browser of a machinist asks this computer under the name of somebody
    else's site."""
    assert ask(page, path, Host=host)[0] == 421


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "null", "https://localhost.evil.example", "http://localhost:1"],
)
def test_orders_from_another_site_are_refused(page, origin):
    """Even with the token."""
    order = json.dumps({"name": "start"}).encode()
    assert (
        ask(
            page,
            "/command",
            method="POST",
            body=order,
            Origin=origin,
            Host="localhost",
            Authorization=bearer(TOKEN),
        )[0]
        == 403
    )
    assert (
        ask(
            page,
            "/access",
            method="POST",
            Origin=origin,
            Host="localhost",
            Authorization=bearer(TOKEN),
        )[0]
        == 403
    )
    assert page.do(lambda: list(page.survey.ordered)) == []


def test_an_order_that_does_not_say_where_it_comes_from_is_refused(page):
    """A form of another site, in a browser that leaves Origin out: even with the token."""
    connection = http.client.HTTPConnection(page.address.removeprefix("http://"), timeout=60)
    connection.request(
        "POST",
        "/command",
        b'{"name":"start"}',
        {"Authorization": bearer(TOKEN), "Content-Type": "text/plain"},
    )
    answer = connection.getresponse()
    assert (answer.status, "Origin" in answer.read().decode()) == (403, True)
    connection.close()
    assert page.do(lambda: list(page.survey.ordered)) == []


def test_files_are_for_those_with_the_token(page):
    """A list, a result, a report and a log: 403 without; by header, or by the cookie that the token
    was exchanged for."""
    paths = (
        "/downloads.json",
        "/result.json",
        "/download/report.html",
        "/download/result.json",
    )
    assert [ask(page, path)[0] for path in paths] == [403] * 4
    assert [ask(page, path, Authorization=bearer(TOKEN))[0] for path in paths] == [200] * 4
    status, headers, _ = ask(page, "/access", method="POST", Authorization=bearer(TOKEN))
    cookie = headers["set-cookie"]
    assert status == 204
    assert "httponly" in cookie.lower()
    assert "samesite=strict" in cookie.lower()
    assert quote(TOKEN) not in cookie
    shown = cookie.partition(";")[0]
    assert [ask(page, path, Cookie=shown)[0] for path in paths] == [200] * 4
    assert ask(page, "/download/report.html", Cookie=shown + "x")[0] == 403
    assert (
        ask(page, "/command", method="POST", body=b'{"name":"start"}', Cookie=shown)[0] == 403
    )


def test_wrong_tokens_are_delayed_counted_and_said(tmp_path):
    """Each later than the one before, and ten of one address are a finding of the survey."""
    with served(tmp_path, token=TOKEN) as page:
        assert ask(page, "/about.json")[0] == 200  # its process is up

        def guess(_):
            began = time.monotonic()
            assert (
                ask(page, "/access", method="POST", Authorization=bearer("guess" * 4))[0]
                == 403
            )
            return time.monotonic() - began

        with ThreadPoolExecutor(10) as guessing:
            took = sorted(guessing.map(guess, range(10)))
        assert took[0] >= 0.2
        assert took[-1] > 1.5 * took[0]
        assert page.do(lambda: list(page.survey.guessed)) == [("127.0.0.1", 10)]


def test_orders_are_logged_with_their_address(tmp_path, capsys):
    """Who did it is asked afterwards."""
    with served(tmp_path, token=TOKEN) as page:
        ask(
            page,
            "/command",
            method="POST",
            body=b'{"name":"pause"}',
            Authorization=bearer(TOKEN),
        )
        assert page.do(lambda: page.survey.addresses) == ["127.0.0.1"]


def certified(folder):
    """Return a certificate for localhost and its key, as files."""
    crt, key = folder / "page.crt", folder / "page.key"
    subprocess.run(
        [
            "openssl",
            "req",
            "-x509",
            "-newkey",
            "ec",
            "-pkeyopt",
            "ec_paramgen_curve:prime256v1",
            "-nodes",
            "-subj",
            "/CN=localhost",
            "-days",
            "2",
            "-addext",
            "subjectAltName=DNS:localhost",
            "-keyout",
            key,
            "-out",
            crt,
        ],
        check=True,
        capture_output=True,
    )
    return crt, key


def test_who_says_nothing_of_encryption_keeps_no_place(tmp_path):
    """A connection that never begins its TLS handshake is closed like one that never says what it
    wants: long before a minute is over."""
    crt, key = certified(tmp_path)
    with served(tmp_path, certificate=str(crt), key=str(key)) as page:
        port = int(page.address.rpartition(":")[2])
        with (
            socket.create_connection(("127.0.0.1", port), timeout=60) as silent,
            socket.create_connection(("127.0.0.1", port)) as half,
        ):
            half.settimeout(60)
            half.sendall(b"\x16\x03\x01\x02\x00\x01")
            assert silent.recv(1) == b""
            assert half.recv(1) == b""


def test_certificates_encrypt_the_page(tmp_path):
    """With certificate and key nothing is answered in the clear."""
    crt, key = certified(tmp_path)
    with served(tmp_path, token=TOKEN, certificate=str(crt), key=str(key)) as page:
        port = int(page.address.rpartition(":")[2])
        connection = http.client.HTTPSConnection(
            "localhost", port, timeout=60, context=ssl.create_default_context(cafile=str(crt))
        )
        connection.request(
            "POST",
            "/access",
            headers={"Authorization": bearer(TOKEN), "Origin": f"https://localhost:{port}"},
        )
        answer = connection.getresponse()
        assert answer.status == 204
        assert "secure" in answer.getheader("set-cookie").lower()
        connection.close()
        with socket.create_connection(("127.0.0.1", port), timeout=60) as plain:
            plain.sendall(b"GET /about.json HTTP/1.1\r\nHost: localhost\r\n\r\n")
            assert b"version" not in plain.recv(1000)
