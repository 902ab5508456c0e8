"""The page of a fleet: the sheet of `report`, computed again after each change of the store. Only
this computer can open the page, unless the command names a host.

A browser sends the token once, in the address that the command prints, and then a cookie. A program
sends the token with each request.
"""

from collections.abc import Callable, Hashable, Sequence
from functools import cache
from threading import Lock

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import (
    HTMLResponse,
    JSONResponse,
    PlainTextResponse,
    RedirectResponse,
    Response,
)
from starlette.routing import Route

from stepdiag.base.errors import DataError, StepdiagError
from stepdiag.base.messages import Message, in_every_language, message
from stepdiag.fleet.report import fleet_html
from stepdiag.fleet.series import LeftOut
from stepdiag.fleet.terminal import as_csv, as_json
from stepdiag.fleet.trend import Trend
from stepdiag.page.security import Access
from stepdiag.texts.texts import LANGUAGES, Language

Found = tuple[Sequence[Trend], Sequence[LeftOut]]
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
}
LOOPBACK = ("127.0.0.1", "localhost", "[::1]")


class Sheets:
    """The sheets of the page, computed once for all visitors until the store changes."""

    def __init__(
        self, state: Callable[[], Hashable], trends: Callable[[], Found], source: str
    ) -> None:
        """``state`` returns a value that differs after every change of the store; ``trends`` reads
        the store."""
        self._state, self._trends, self._source = state, trends, source
        self._lock = Lock()
        self._of: Hashable = None
        self._found: Found = ((), ())
        self._sheet: Callable[[Language], str] = lambda _: ""

    def found(self) -> Found:
        with self._lock:
            state = self._state()
            if state != self._of:
                found = self._trends()
                self._of, self._found = state, found
                self._sheet = cache(
                    lambda language: fleet_html(found[0], self._source, language, found[1])
                )
            return self._found

    def sheet(self, language: Language) -> str:
        self.found()
        with self._lock:
            return self._sheet(language)


def create_app(
    sheets: Sheets, language: Language, token: str, names: tuple[str, ...] = LOOPBACK
) -> Starlette:
    """Return the application of the page for holders of the token. ``names`` are the permitted host
    names; any other name is refused because of DNS rebinding."""
    access = Access(token, lambda _address, _count: None)

    def answering(make: Callable[[Request], Response]) -> Callable[[Request], object]:
        async def answer(request: Request) -> Response:
            host = request.headers.get("host", "")
            name = host if host.endswith("]") else host.rpartition(":")[0] or host
            if name.lower() not in names:
                return _plain(message("other-host-name"), 421)
            if "token" in request.query_params:
                return await _let_in(request, access)
            if not await access.reads(request):
                return _plain(message("token-in-address"), 401)
            try:
                made = await run_in_threadpool(make, request)
            except StepdiagError as error:
                return _plain(error.message, 404 if isinstance(error, DataError) else 503)
            made.headers.update(HEADERS)
            return made

        return answer

    def sheet(request: Request) -> Response:
        asked = next(
            (each for each in LANGUAGES if each == request.query_params.get("language")),
            language,
        )
        return HTMLResponse(sheets.sheet(asked))

    return Starlette(
        routes=[
            Route("/", answering(sheet)),
            Route("/trend.json", answering(lambda _: JSONResponse(as_json(*sheets.found())))),
            Route(
                "/trend.csv",
                answering(
                    lambda _: PlainTextResponse(
                        as_csv(sheets.found()[0]), media_type="text/csv"
                    )
                ),
            ),
        ]
    )


def serve(app: Starlette, host: str, port: int) -> None:
    uvicorn.run(app, host=host, port=port, log_level="warning", server_header=False)


async def _let_in(request: Request, access: Access) -> Response:
    """Return the redirection for a browser with the right token: to the same page without the token
    in the address, with a cookie."""
    if not await access.is_token(request, request.query_params["token"]):
        return _plain(message("wrong-token"), 401)
    answer = RedirectResponse(
        str(request.url.remove_query_params("token")), status_code=303, headers=HEADERS
    )
    access.remember(request, answer)
    return answer


def _plain(words: Message, status: int) -> Response:
    return PlainTextResponse(
        "\n".join(in_every_language(words).values()), status_code=status, headers=HEADERS
    )
