"""The page as an application: live stream, texts, downloads, and commands of permitted users.

The application runs in a separate process (`stepdiag.page.process`); `RemoteDaemon` is its only
connection to the daemon.
"""

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable, Sequence
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Protocol, get_args

import msgspec
from sse_starlette.sse import EventSourceResponse
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import Receive, Scope, Send

from stepdiag.base.errors import DeviceError, StepdiagError, system_words
from stepdiag.base.messages import Words, message
from stepdiag.daq.records.status import CommandName, Download
from stepdiag.daq.records.survey_folder import CONCLUSION
from stepdiag.exporters.files.sets import zip_of
from stepdiag.page.broadcast import Broadcaster
from stepdiag.page.downloads import downloads_of
from stepdiag.page.messages import PageSettings, Picture
from stepdiag.page.security import REPORT_POLICY, SEND_S, Access, Guard, address_of, refused
from stepdiag.texts.texts import LANGUAGES, catalogue

STATIC = Path(str(files("stepdiag.page") / "static"))
LONGEST_COMMAND = 3000
"""Largest number of bytes read from the body of a command; the pipe to the daemon accepts this
number at once."""
BODY_S = 5.0
"""Longest time in s for the body of a request."""
MOST_READERS = 200
"""Largest number of live streams at a time; one address can have half of them. A stream is counted
before it is accepted."""


class Ordered(msgspec.Struct, frozen=True):
    name: CommandName
    arguments: dict[str, str] = {}


class Daemon(Protocol):
    """The interface of the daemon for the page (`stepdiag.page.remote.RemoteDaemon`)."""

    def watch(self, *, on: bool) -> None:
        """Start or stop the snapshots of the daemon."""

    async def picture(self) -> Picture:
        """Return the present snapshot. Raises DeviceError for a silent daemon."""

    async def order(
        self, name: CommandName, arguments: dict[str, str], address: str
    ) -> Words:
        """Request a command; return the reason of a refusal, empty after success. Raises
        DeviceError for a silent daemon."""

    def say_guesses(self, address: str, count: int) -> None:
        """Report a number of wrong tokens from an address."""

    def say_fault(self, why: object) -> None:
        """Report a fault of this program."""


class Page:
    def __init__(self, daemon: Daemon, settings: PageSettings) -> None:
        self._daemon = daemon
        self._settings = settings
        self._readers: Counter[str] = Counter()
        self.access = Access(settings.token, daemon.say_guesses)
        self.broadcaster = Broadcaster(lambda on: daemon.watch(on=on))
        self.still_open: Sequence[str] = ()
        """Rights that the kernel could not remove from this process (`stepdiag.walls.confine`)."""

    async def index(self, _request: Request) -> Response:
        return FileResponse(STATIC / "index.html")

    async def about(self, _request: Request) -> Response:
        """Respond with the language, the version, whether a token is configured (the page requires
        a token for commands), and the rights that the kernel could not remove from this process."""
        return JSONResponse(
            {
                "language": self._settings.language,
                "languages": LANGUAGES,
                "version": version("stepdiag"),
                "commands": self.access.needed,
                "open": list(self.still_open),
            }
        )

    async def texts(self, request: Request) -> Response:
        language = next(
            (known for known in LANGUAGES if known == request.path_params["language"]), None
        )
        if language is None:
            return refused(404, message("page-no-language", known=LANGUAGES))
        words = {section: catalogue(section, language) for section in ("common", "page")}
        return JSONResponse(words)

    async def stream(self, request: Request) -> Response:
        address = address_of(request)
        if (
            self._readers.total() >= MOST_READERS
            or self._readers[address] >= MOST_READERS // 2
        ):
            return refused(503, message("page-readers", count=self._readers.total()))
        return _CountedStream(self.broadcaster, self._readers, address)

    async def result(self, request: Request) -> Response:
        if not await self.access.reads(request):
            return _locked()
        path = (await self._daemon.picture()).result
        if not path or not await run_in_threadpool(Path(path).is_file):
            return refused(404, message("page-no-result"))
        return FileResponse(
            path, media_type="application/json", headers={"Cache-Control": "no-store"}
        )

    async def conclusion(self, _request: Request) -> Response:
        """Respond with the conclusion of the survey. Every visitor may read the conclusion; the
        files require the token."""
        found = next((one for one in await self._listed() if one.name == CONCLUSION), None)
        if found is None:
            return refused(404, message("page-no-conclusion"))
        return FileResponse(
            found.path, media_type="application/json", headers={"Cache-Control": "no-store"}
        )

    async def downloads(self, request: Request) -> Response:
        if not await self.access.reads(request):
            return _locked()
        fields = ("name", "kind", "size_bytes", "sha256", "group")
        return JSONResponse(
            [{field: getattr(one, field) for field in fields} for one in await self._listed()]
        )

    async def download(self, request: Request) -> Response:
        """Respond with a file from the list of downloads; any other name gives 404."""
        if not await self.access.reads(request):
            return _locked()
        wanted = request.path_params["name"]
        found = next((one for one in await self._listed() if one.name == wanted), None)
        if found is not None and found.kind in ("bundle", "restore"):
            return await run_in_threadpool(_packed, found)
        if found is None or not found.path.is_file():
            return refused(404, message("page-no-file"))
        return _file(found)

    async def open(self, request: Request) -> Response:
        """Respond whether the token of the request permits commands; after a right token the
        browser may download files."""
        if not await self.access.commands(request):
            return refused(403, message("page-wrong-token"))
        answer = Response(status_code=204)
        self.access.remember(request, answer)
        return answer

    async def command(self, request: Request) -> Response:
        """Execute a command. The status is 204 after execution, 400 for an invalid command, 403 for
        a missing right, 409 with the reason for a refusal."""
        if not await self.access.commands(request):
            return refused(
                403,
                message("page-wrong-token")
                if self.access.needed
                else message("page-read-only"),
            )
        body = await _limited_body(request)
        try:
            order = msgspec.json.decode(body or b"", type=Ordered)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as why:
            return refused(
                400, message("page-no-command", why=str(why), known=get_args(CommandName))
            )
        refusal = await self._daemon.order(order.name, order.arguments, address_of(request))
        return refused(409, refusal) if refusal else Response(status_code=204)

    async def _listed(self) -> tuple[Download, ...]:
        return await run_in_threadpool(
            downloads_of, Path((await self._daemon.picture()).folder)
        )


class _CountedStream(Response):
    def __init__(self, broadcaster: Broadcaster, readers: Counter[str], address: str) -> None:
        self._readers = readers
        self._address = address
        self._stream = EventSourceResponse(broadcaster.stream(), ping=0, send_timeout=SEND_S)
        readers[address] += 1

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            await self._stream(scope, receive, send)
        finally:
            self._readers[self._address] -= 1
            self._readers += Counter()  # removes the addresses with a count of zero


async def _limited_body(request: Request) -> bytes | None:
    """Return the body of a request, or None for a body that is longer than any command or takes too
    long."""
    body = b""
    try:
        async with asyncio.timeout(BODY_S):
            async for chunk in request.stream():
                body += chunk
                if len(body) > LONGEST_COMMAND:
                    return None
    except TimeoutError:
        return None
    return body


def _locked() -> Response:
    return refused(403, message("page-files"))


def _on_fault(daemon: Daemon) -> Callable[[Request, Exception], Awaitable[Response]]:
    async def answer(_request: Request, why: Exception) -> Response:
        daemon.say_fault(why)
        return refused(500, message("page-fault"))

    return answer


async def _silent(_request: Request, why: Exception) -> Response:
    return refused(503, why.message if isinstance(why, StepdiagError) else str(why))


def _packed(found: Download) -> Response:
    try:
        data = zip_of(found.path, restore=found.kind == "restore")
    except StepdiagError as why:
        # The answer contains only the file name, because visitors must not see the folders.
        named = message(
            "refusal", where=found.path.name, expected=why.expected, found=why.found
        )
        return refused(409, named)
    except (
        OSError
    ) as why:  # while the file was packed, the file was moved away, or its disk was removed
        return refused(409, message("labelled", name=found.path.name, what=system_words(why)))
    headers = {
        "Content-Disposition": f'attachment; filename="{found.name}"',
        "Cache-Control": "no-store",
    }
    return Response(data, media_type="application/zip", headers=headers)


def _file(found: Download) -> Response:
    if found.kind == "report" and found.path.suffix == ".html":
        headers = {"Content-Security-Policy": REPORT_POLICY, "Cache-Control": "no-store"}
        return FileResponse(
            found.path,
            filename=found.name,
            content_disposition_type="inline",
            headers=headers,
        )
    return FileResponse(
        found.path,
        filename=found.name,
        media_type="application/octet-stream",
        headers={"Cache-Control": "no-store"},
    )


def create_app(page: Page, daemon: Daemon, settings: PageSettings) -> Starlette:
    """Return the application of the page; without a configured token it accepts no command."""
    routes = [
        Route("/", page.index),
        Route("/about.json", page.about),
        Route("/texts/{language}.json", page.texts),
        Route("/stream", page.stream),
        Route("/result.json", page.result),
        Route("/conclusion.json", page.conclusion),
        Route("/downloads.json", page.downloads),
        Route("/download/{name}", page.download),
        Route("/access", page.open, methods=["POST"]),
        Route("/command", page.command, methods=["POST"]),
        Mount("/static", StaticFiles(directory=STATIC)),
    ]
    guard = Middleware(Guard, names=settings.names)
    handlers = {DeviceError: _silent, Exception: _on_fault(daemon)}
    return Starlette(routes=routes, middleware=[guard], exception_handlers=handlers)
