"""Serves page and metrics inside the daemon's own event loop, without touching its signals or its logging."""

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator, Generator

import uvicorn
from starlette.applications import Starlette

from stepdiag.daq.records.status import StatusSource
from stepdiag.page.app import create_app
from stepdiag.solver.errors import DeviceError
from stepdiag.texts.texts import Language

BACKLOG = 64
GRACE_S = 1.0
"""How long open downloads may go on once the daemon ends."""


class _Server(uvicorn.Server):
    """uvicorn without its signal handlers: the daemon has its own."""

    @contextlib.contextmanager
    def capture_signals(self) -> Generator[None, None, None]:
        """Leave the process's signals alone."""
        yield


def open_socket(host: str, port: int, section: str) -> socket.socket:
    """Return a listening socket; DeviceError where the address is taken or not this machine's. Port 0 takes any free one.

    ``section`` is the part of the survey file that the address stands in.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
        listener.listen(BACKLOG)
    except OSError as why:
        listener.close()
        raise DeviceError(
            f"{section}.host, {section}.port", expected=f"a free address {host}:{port}", found=str(why),
            remedy="choose another port, or end the program that holds it",
        ) from why  # fmt: skip
    return listener


@contextlib.asynccontextmanager
async def page_served(
    source: StatusSource, *, host: str = "127.0.0.1", port: int = 8420, token: str = "", language: Language = "en"
) -> AsyncIterator[str]:
    """Serve the page while the block runs; yields its address (``http://127.0.0.1:8420``)."""
    app = create_app(source, token=token, language=language)
    async with app_served(app, host=host, port=port, section="page") as address:
        try:
            yield address
        finally:
            await app.state.broadcaster.close()


@contextlib.asynccontextmanager
async def app_served(app: Starlette, *, host: str, port: int, section: str) -> AsyncIterator[str]:
    """Serve an application while the block runs; yields its address (``http://127.0.0.1:8420``)."""
    listener = open_socket(host, port, section)
    config = uvicorn.Config(
        app, log_config=None, access_log=False, server_header=False, lifespan="on", timeout_graceful_shutdown=int(GRACE_S)
    )
    server = _Server(config)
    task = asyncio.create_task(server.serve(sockets=[listener]), name=f"{section} server")
    try:
        bound = listener.getsockname()
        yield f"http://{f'[{bound[0]}]' if ':' in bound[0] else bound[0]}:{bound[1]}"
    finally:
        server.should_exit = True
        await task
