"""The page of a fleet: the sheet of `report`, made anew at every visit, on this computer by default."""

from collections.abc import Callable

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from stepdiag.base.errors import DataError, StepdiagError
from stepdiag.fleet.report import fleet_html
from stepdiag.fleet.terminal import as_csv, as_json
from stepdiag.fleet.trend import Trend
from stepdiag.texts.texts import LANGUAGES, Language

HEADERS = {
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
}
LOOPBACK = ("127.0.0.1", "localhost", "[::1]")


def create_app(trends: Callable[[], list[Trend]], source: str, language: Language, names: tuple[str, ...] = LOOPBACK) -> Starlette:
    """Return the page; ``trends`` is asked at every visit, ``names`` are those it answers to (DNS rebinding)."""

    def answering(make: Callable[[Request, list[Trend]], Response]) -> Callable[[Request], object]:
        async def answer(request: Request) -> Response:
            host = request.headers.get("host", "")
            name = host if host.endswith("]") else host.rpartition(":")[0] or host
            if name.lower() not in names:
                return _plain("this page does not answer to that name", 421)
            try:
                found = await run_in_threadpool(trends)
            except StepdiagError as error:
                return _plain(str(error), 404 if isinstance(error, DataError) else 503)
            made = make(request, found)
            made.headers.update(HEADERS)
            return made

        return answer

    def sheet(request: Request, found: list[Trend]) -> Response:
        asked = next((each for each in LANGUAGES if each == request.query_params.get("language")), language)
        return HTMLResponse(fleet_html(found, source, asked))

    return Starlette(
        routes=[
            Route("/", answering(sheet)),
            Route("/trend.json", answering(lambda _, found: JSONResponse(as_json(found)))),
            Route("/trend.csv", answering(lambda _, found: PlainTextResponse(as_csv(found), media_type="text/csv"))),
        ]
    )


def serve(app: Starlette, host: str, port: int) -> None:
    """Serve until Ctrl-C."""
    uvicorn.run(app, host=host, port=port, log_level="warning", server_header=False)


def _plain(words: str, status: int) -> Response:
    return PlainTextResponse(words, status_code=status, headers=HEADERS)
