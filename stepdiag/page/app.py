"""The page as an application: the live stream, the texts, the downloads, and the commands of those who may.

It reads from the daemon only what `daq.records.status.StatusSource` offers, and nothing it does can hold the daemon up.
"""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import get_args

import msgspec
from sse_starlette.sse import EventSourceResponse
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from stepdiag.daq.records.status import CommandName, Download, StatusSource
from stepdiag.page.broadcast import Broadcaster
from stepdiag.page.security import REPORT_POLICY, SecurityHeaders, may_command
from stepdiag.solver.errors import UsageError
from stepdiag.texts.texts import LANGUAGES, Language, catalogue

STATIC = Path(str(files("stepdiag.page") / "static"))
LONGEST_COMMAND = 4096
"""Bytes of a command's body that are read at most."""
SEND_TIMEOUT_S = 20.0
"""A reader that takes nothing for so long is let go."""
MOST_READERS = 200
"""Streams served at once; one more is refused, so that nobody can use up the daemon's memory."""


class Order(msgspec.Struct, frozen=True):
    """The body of a command."""

    name: CommandName
    arguments: dict[str, str] = {}


class Page:
    """The answers of the page; one object a daemon."""

    def __init__(self, source: StatusSource, *, token: str, language: Language) -> None:
        self._source = source
        self._token = token
        self._language = language
        self.broadcaster = Broadcaster(source)

    async def index(self, _request: Request) -> Response:
        """Answer the page itself."""
        return FileResponse(STATIC / "index.html")

    async def about(self, _request: Request) -> Response:
        """Answer what the page needs before the stream: language, version, whether commands exist at all."""
        return JSONResponse(
            {"language": self._language, "languages": LANGUAGES, "version": version("stepdiag"), "commands": bool(self._token)}
        )

    async def texts(self, request: Request) -> Response:
        """Answer the words of one language."""
        language = next((known for known in LANGUAGES if known == request.path_params["language"]), None)
        if language is None:
            return _refusal(404, f"no texts in this language; known are {', '.join(LANGUAGES)}")
        words = {section: catalogue(section, language) for section in ("common", "page", "finding")}
        return JSONResponse(words)

    async def stream(self, _request: Request) -> Response:
        """Answer the live stream."""
        if self.broadcaster.readers >= MOST_READERS:
            return _refusal(503, f"{MOST_READERS} readers already look on")
        return EventSourceResponse(self.broadcaster.stream(), ping=0, send_timeout=SEND_TIMEOUT_S)

    async def result(self, _request: Request) -> Response:
        """Answer the last result."""
        path = self._source.result_file()
        if path is None:
            return _refusal(404, "no result yet")
        return FileResponse(path, media_type="application/json", headers={"Cache-Control": "no-store"})

    async def downloads(self, _request: Request) -> Response:
        """Answer the list of files that may be fetched."""
        fields = ("name", "kind", "size_bytes", "sha256")
        return JSONResponse([{field: getattr(one, field) for field in fields} for one in self._source.downloads()])

    async def download(self, request: Request) -> Response:
        """Answer one of the listed files; a name that is not listed does not exist."""
        wanted = request.path_params["name"]
        found = next((one for one in self._source.downloads() if one.name == wanted), None)
        if found is None or not found.path.is_file():
            return _refusal(404, "no such file in the list of downloads")
        return _file(found)

    async def access(self, request: Request) -> Response:
        """Answer whether the token that came along may command."""
        return Response(status_code=204) if may_command(request, self._token) else _refusal(403, "wrong token")

    async def command(self, request: Request) -> Response:
        """Do what was ordered: 204 done, 400 not understood, 403 not allowed, 409 refused with the reason."""
        if not may_command(request, self._token):
            return _refusal(403, "wrong token" if self._token else "read-only: no token is configured")
        body = await _limited_body(request)
        try:
            order = msgspec.json.decode(body or b"", type=Order)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as why:
            return _refusal(400, f"command not understood: {why}; known are {', '.join(get_args(CommandName))}")
        try:
            await self._source.command(order.name, order.arguments)
        except UsageError as why:
            return _refusal(409, str(why))
        return Response(status_code=204)


async def _limited_body(request: Request) -> bytes | None:
    """Return the body, or None where it is longer than a command can be."""
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > LONGEST_COMMAND:
            return None
    return body


def _refusal(status: int, why: str) -> Response:
    return JSONResponse({"error": why}, status_code=status)


def _file(found: Download) -> Response:
    if found.kind == "report" and found.path.suffix == ".html":
        headers = {"Content-Security-Policy": REPORT_POLICY, "Cache-Control": "no-store"}
        return FileResponse(found.path, filename=found.name, content_disposition_type="inline", headers=headers)
    return FileResponse(found.path, filename=found.name, media_type="application/octet-stream", headers={"Cache-Control": "no-store"})


def create_app(source: StatusSource, *, token: str = "", language: Language = "en") -> Starlette:
    """Return the page over ``source``; read-only where ``token`` is empty."""
    page = Page(source, token=token, language=language)

    @asynccontextmanager
    async def lifespan(_app: Starlette) -> AsyncIterator[None]:
        yield
        await page.broadcaster.close()

    routes = [
        Route("/", page.index),
        Route("/about.json", page.about),
        Route("/texts/{language}.json", page.texts),
        Route("/stream", page.stream),
        Route("/result.json", page.result),
        Route("/downloads.json", page.downloads),
        Route("/download/{name}", page.download),
        Route("/access", page.access, methods=["POST"]),
        Route("/command", page.command, methods=["POST"]),
        Mount("/static", StaticFiles(directory=STATIC)),
    ]
    app = Starlette(routes=routes, middleware=[Middleware(SecurityHeaders)], lifespan=lifespan)
    app.state.broadcaster = page.broadcaster
    return app
