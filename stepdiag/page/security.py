"""Protection of the page: the rights of a browser, and the rights of a user to give commands."""

import asyncio
import hmac
import ipaddress
import secrets
from collections import OrderedDict
from collections.abc import Callable, Collection
from urllib.parse import unquote

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import HTTPConnection, Request
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from stepdiag.base.messages import Words, in_every_language, message

CONTENT_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content policy of the page: no inline content, and no content from other servers."""
REPORT_POLICY = (
    "sandbox allow-scripts allow-downloads allow-modals; default-src 'none'; img-src data:; "
    "script-src 'unsafe-inline'; style-src 'unsafe-inline'"
)
"""Content policy of a report: its scripts can turn its drawings, but cannot reach the page or the
daemon."""
HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=(), usb=(), serial=()",
}
SEND_S = 20.0
"""Time in s after which a reader that receives nothing is disconnected."""
COOKIE = "stepdiag-files"
MOST_SESSIONS = 100
MOST_ADDRESSES = 1000
"""Largest number of addresses whose wrong tokens are counted; the oldest addresses are removed
first."""
GUESSES = 10
"""Number of wrong tokens from one address after which the machine's page shows a warning, and again
after 10, 100, ... times this number."""
DELAY_S, LONGEST_DELAY_S = 0.5, 5.0
"""Delay in s of the answer to a wrong token: initial and largest; the delay grows with each wrong
token."""


class Guard:
    """Refuses requests that another site caused, adds the content policies to every answer, and
    disconnects clients that do not receive their answer.

    A site whose name resolves to this computer (DNS rebinding) sends its own name in ``Host``. So
    the name must be a loopback name, the called address, or one of ``names``. A POST must come from
    the page itself, which its ``Origin`` shows: every browser adds this header.
    """

    def __init__(self, app: ASGIApp, names: Collection[str]) -> None:
        self._app = app
        self._names = {name.lower() for name in names}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return

        async def completed(event: Message) -> None:
            if event["type"] == "http.response.start":
                headers = MutableHeaders(scope=event)
                headers.setdefault("Content-Security-Policy", CONTENT_POLICY)
                headers.setdefault("Cache-Control", "no-cache")
                for name, value in HEADERS.items():
                    headers[name] = value
            async with asyncio.timeout(SEND_S):
                await send(event)

        refusal = self._refusal(scope)
        await (refusal or self._app)(scope, receive, completed)

    def _refusal(self, scope: Scope) -> Response | None:
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        called = scope.get("server") or ("", 0)
        if not is_known_host(host, str(called[0]), self._names):
            return refused(421, message("page-other-name"))
        origin = headers.get("origin")
        if scope["method"] not in ("GET", "HEAD") and origin not in (
            f"http://{host}",
            f"https://{host}",
        ):
            return refused(403, message("page-other-origin", host=host))
        return None


def is_known_host(host: str, called: str, names: Collection[str]) -> bool:
    """Return whether the name in a ``Host`` header is a name of this computer; ``called`` is the
    address at which the connection arrived."""
    name = (
        host.rpartition(":")[0]
        if host.rpartition(":")[2].isdigit() and host.rpartition(":")[1]
        else host
    )
    name = name.strip("[]").lower().rstrip(".")
    if name == "localhost" or name in names:
        return True
    try:
        address = ipaddress.ip_address(name)
    except ValueError:
        return False
    return address.is_loopback or name == called or str(address) == called


class Guesses:
    """The counts of wrong tokens by the address of their sender. The function ``on_guesses``
    receives an address and its count when the count reaches 10, 100, 1000 and so on."""

    def __init__(self, on_guesses: Callable[[str, int], None]) -> None:
        self._on_guesses = on_guesses
        self._failures: OrderedDict[str, int] = OrderedDict()
        self.delay_s = DELAY_S

    def wrong(self, address: str) -> float:
        """Add one wrong token to the count of an address; return the delay of the answer in s."""
        count = self._failures.pop(address, 0) + 1
        self._failures[address] = count
        if len(self._failures) > MOST_ADDRESSES:
            self._failures.popitem(last=False)
        if count >= GUESSES and str(count).strip("0") == "1":
            self._on_guesses(address, count)
        return min(self.delay_s * count, LONGEST_DELAY_S)

    def right(self, address: str) -> None:
        """Reset the count of an address after a right token: the earlier wrong tokens were typing
        errors."""
        self._failures.pop(address, None)


class Access:
    """The rights of the users with the token. A browser that has sent the token once may also read
    files, by a cookie that differs from the token."""

    def __init__(self, token: str, on_guesses: Callable[[str, int], None]) -> None:
        self._token = token
        self.guesses = Guesses(on_guesses)
        self._sessions: OrderedDict[str, None] = OrderedDict()

    @property
    def needed(self) -> bool:
        """Whether a token is configured; without a token no command is accepted."""
        return bool(self._token)

    async def commands(self, request: Request) -> bool:
        """Return whether a token is configured and a request contains this token. The token is
        percent-encoded, because a header contains only ASCII."""
        scheme, _, given = request.headers.get("authorization", "").partition(" ")
        return (
            bool(self._token)
            and scheme.lower() == "bearer"
            and await self.is_token(request, unquote(given))
        )

    async def is_token(self, request: Request, given: str) -> bool:
        """Return whether a token is right, in constant time; a wrong token is counted and answered
        late."""
        address = address_of(request)
        if hmac.compare_digest(given.encode("utf-8", "replace"), self._token.encode()):
            self.guesses.right(address)
            return True
        await asyncio.sleep(self.guesses.wrong(address))
        return False

    async def reads(self, request: Request) -> bool:
        """Return whether the sender of a request may download files: everyone if no token is
        configured."""
        return (
            not self._token
            or request.cookies.get(COOKIE) in self._sessions
            or await self.commands(request)
        )

    def remember(self, request: Request, answer: Response) -> None:
        session = secrets.token_urlsafe(32)
        self._sessions[session] = None
        if len(self._sessions) > MOST_SESSIONS:
            self._sessions.popitem(last=False)
        answer.set_cookie(
            COOKIE,
            session,
            httponly=True,
            samesite="strict",
            secure=request.url.scheme == "https",
        )


def address_of(request: HTTPConnection) -> str:
    return request.client.host if request.client is not None else ""


def refused(status: int, why: Words) -> Response:
    """Return a refusal as a response: ``error`` for a program, ``words`` for the user in every
    language."""
    return JSONResponse(
        {"error": str(why), "words": in_every_language(why)}, status_code=status
    )
