"""The page's process: page and metrics on given addresses, with the fewest rights.

    python -m stepdiag.page.process PAGE METRICS
        PAGE and METRICS are descriptors of listening sockets, "-" for none; started by
        `stepdiag.page.keeper`
    stepdiag page FILE
        started by systemd, which passes the sockets (sd_listen_fds(3))

A single connection transports the daemon's data and the page's commands (`stepdiag.page.messages`).
The connection consists of standard input and output, or of a Unix socket if the page is a systemd
unit with its own account.
"""

import asyncio
import contextlib
import mimetypes
import os
import signal
import socket
import sys
import time
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import BinaryIO

import uvicorn
from anyio.to_thread import current_default_thread_limiter
from starlette.applications import Starlette

from stepdiag.base.errors import DeviceError, system_words
from stepdiag.base.messages import message
from stepdiag.daq.service.priority import lower_priority
from stepdiag.page.app import Page, create_app
from stepdiag.page.connections import (
    LONGEST_HEAD,
    CappedListener,
    PunctualLoop,
    PunctualProtocol,
)
from stepdiag.page.messages import LENGTH_BYTES, PageSettings, settings_decoder
from stepdiag.page.metrics import create_metrics
from stepdiag.page.remote import RemoteDaemon
from stepdiag.walls.confine import confine, die_with_parent, readable_by_program

THREADS = 4
"""Largest number of threads that read files at once."""
SOCKET = "STEPDIAG_PAGE_SOCKET"
"""Environment variable with the path of the socket between the units of daemon and page."""
FIRST_HANDED = 3
PATIENCE_S, AGAIN_S = 10.0, 0.2
GRACE_S = 1
"""Time in s in which open downloads can continue after the end of the daemon."""


class _Server(uvicorn.Server):
    @contextlib.contextmanager
    def capture_signals(self) -> Generator[None, None, None]:
        yield


def main(page: str, metrics: str) -> None:
    die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the daemon, not this process
    hears, asks = sys.stdin.buffer, _own_output()
    length = int.from_bytes(hears.read(LENGTH_BYTES), "big")
    settings = settings_decoder.decode(hears.read(length))
    _serve_sockets(
        hears,
        asks,
        settings,
        *(None if each == "-" else int(each) for each in (page, metrics)),
    )


def serve_activated(survey_file: Path) -> None:
    """Serve the addresses received from systemd until the daemon closes the connection. Raises
    DeviceError if no daemon is running.

    The secrets are credentials of this unit: the daemon cannot read them.
    """
    # both modules load numpy, which the page of a daemon does not need
    from stepdiag.daq.survey.file import load_survey
    from stepdiag.page.settings import page_settings

    survey = load_survey(survey_file)
    settings = page_settings(survey_file, survey)
    line = _called(Path(os.environ[SOCKET]))
    asks = os.fdopen(os.dup(line.fileno()), "wb", buffering=0)
    os.set_blocking(asks.fileno(), False)
    handed = {
        one.getsockname()[1]: one.detach()
        for one in (socket.socket(fileno=each) for each in _handed_over())
    }
    page, metrics = (
        handed.get(each.port) if each.enabled else None
        for each in (survey.page, survey.metrics)
    )
    _serve_sockets(os.fdopen(line.detach(), "rb", buffering=0), asks, settings, page, metrics)


def _handed_over() -> range:
    """Return the descriptors of the sockets that systemd opened (sd_listen_fds(3)): they begin at 3
    and are only for this process."""
    if os.environ.get("LISTEN_PID") != str(os.getpid()):
        return range(0)
    return range(FIRST_HANDED, FIRST_HANDED + int(os.environ.get("LISTEN_FDS", "0")))


def _called(path: Path) -> socket.socket:
    end = time.monotonic() + PATIENCE_S
    while True:
        line = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            line.connect(str(path))
        except OSError as error:
            line.close()
            if time.monotonic() > end:
                raise DeviceError(
                    str(path), expected=message("recorder-to-call"), found=system_words(error)
                ) from error
            time.sleep(AGAIN_S)
        else:
            return line


def _serve_sockets(
    hears: BinaryIO,
    asks: BinaryIO,
    settings: PageSettings,
    page: int | None,
    metrics: int | None,
) -> None:
    daemon = RemoteDaemon(asks)
    servers = []
    if page is not None:
        shown = Page(daemon, settings)
        daemon.on_picture = lambda picture: shown.broadcaster.show(picture.snapshot)
        daemon.on_end = shown.broadcaster.close
        servers.append(
            (_server(create_app(shown, daemon, settings), settings), CappedListener(page))
        )
    if metrics is not None:
        servers.append((_server(create_metrics(daemon.figures)), CappedListener(metrics)))
    mimetypes.init()  # this reads /etc
    lower_priority()
    with asyncio.Runner(loop_factory=PunctualLoop) as runner:
        runner.get_loop()  # asyncio makes a pair of sockets
        still_open = confine(readable_by_program(Path(settings.folder)))
        if page is not None:
            shown.still_open = still_open
        runner.run(_serve(daemon, hears, servers, still_open))
    os._exit(0)  # then all data are written, and the daemon waits


def _own_output() -> BinaryIO:
    asks = os.fdopen(os.dup(1), "wb", buffering=0)
    os.set_blocking(asks.fileno(), False)
    os.dup2(2, 1)
    return asks


def _server(app: Starlette, settings: PageSettings | None = None) -> uvicorn.Server:
    config = uvicorn.Config(
        app,
        http=PunctualProtocol,
        ws="none",
        lifespan="off",
        log_config=None,
        log_level="critical",
        access_log=False,
        server_header=False,
        proxy_headers=False,
        h11_max_incomplete_event_size=LONGEST_HEAD,
        timeout_graceful_shutdown=GRACE_S,
        ssl_certfile=settings.certificate or None if settings is not None else None,
        ssl_keyfile=settings.key or None if settings is not None else None,
    )
    config.load()  # certificates are read before the access to the disk is closed
    return _Server(config)


async def _serve(
    daemon: RemoteDaemon,
    hears: BinaryIO,
    servers: Sequence[tuple[uvicorn.Server, CappedListener]],
    still_open: Sequence[str],
) -> None:
    current_default_thread_limiter().total_tokens = THREADS
    asyncio.get_running_loop().set_exception_handler(
        lambda _, context: daemon.say_fault(context.get("exception") or context["message"])
    )
    tasks = [
        asyncio.create_task(server.serve(sockets=[listener])) for server, listener in servers
    ]
    daemon.say_ready(tuple(still_open))
    hearing = asyncio.create_task(daemon.hear(hears))
    done, _ = await asyncio.wait([hearing, *tasks], return_when=asyncio.FIRST_COMPLETED)
    daemon.on_end()
    for server, _ in servers:
        server.should_exit = True
    await asyncio.gather(*tasks)
    for task in done:
        task.result()


if __name__ == "__main__":
    main(*sys.argv[1:])
