"""A visit to a page without a browser and without a socket."""

import asyncio
from typing import Any


def visit(app: Any, path: str, host: str, *, token: str = "") -> tuple[int, bytes]:
    """Return status and body of a visit by a program with this token, as a server would ask the
    page for it."""
    sent: list[dict[str, Any]] = []

    async def receive() -> dict[str, Any]:
        await asyncio.sleep(
            0
        )  # a page that waits here for the visitor's end lets its answer be written
        return {"type": "http.request", "body": b"", "more_body": False}

    async def send(message: dict[str, Any]) -> None:
        sent.append(message)

    scope = {
        "type": "http",
        "method": "GET",
        "path": path,
        "raw_path": path.encode(),
        "query_string": b"",
        "root_path": "",
    }
    headers = [
        (b"host", host.encode()),
        *([(b"authorization", f"Bearer {token}".encode())] if token else []),
    ]
    scope |= {"headers": headers, "scheme": "http", "http_version": "1.1"}
    scope |= {"server": ("127.0.0.1", 1), "client": ("127.0.0.1", 2)}
    asyncio.run(app(scope, receive, send))
    return sent[0]["status"], b"".join(message.get("body", b"") for message in sent[1:])
