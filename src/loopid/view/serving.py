"""Serves viser's page to itself alone: other pages of the browser see nothing, and break nothing.

A page of any site may connect to a server of this machine. Browsers say in ``Origin`` whose page
asks, and in ``Host`` by which name; both must be the server's own. Importing this needs viser.
"""

from __future__ import annotations

import asyncio
import http
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import websockets.asyncio.server as websockets
from viser import _messages

from loopid.errors import MissingExtraError
from loopid.registry import exchanged

NAMES = ("127.0.0.1", "localhost")  # of this machine
_starting = threading.Lock()  # viser has no setting for what it hands to websockets


class _Connection(websockets.ServerConnection):
    """A connection that drops messages which viser would fail at."""

    async def recv(self, decode: bool | None = None) -> Any:
        while True:
            data = await super().recv(decode)
            try:
                if isinstance(data, bytes):
                    _messages.Message.deserialize(data)
                    return data
            except Exception:  # whatever is wrong with it
                continue


class _OwnPages(websockets.serve):
    """viser's server for its own pages."""

    used = 0  # how many were started

    def __init__(
        self, handler: Any, host: str, port: int, *, process_request: Any, **options: Any
    ) -> None:
        type(self).used += 1
        places = [f"{name}:{port}" for name in NAMES]
        super().__init__(
            handler,
            host,
            port,
            process_request=_of(places, process_request),
            **options | {"create_connection": _Connection},
        )
        # Of what viser does with a message; its tasks have no receiver.
        asyncio.get_running_loop().set_exception_handler(lambda *_: None)


def _of(places: list[str], then: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """What answers a request: refuses those that another page makes, or under another name."""
    origins = [f"http://{place}" for place in places]

    def answer(connection: Any, request: Any) -> Any:
        hosts, asking = (request.headers.get_all(name) for name in ("Host", "Origin"))
        opens = request.headers.get("Upgrade", "").lower() == "websocket"
        known = all(origin in origins for origin in asking) and len(asking) >= opens
        if len(hosts) == 1 and hosts[0] in places and known:
            return then(connection, request)
        return connection.respond(http.HTTPStatus.FORBIDDEN, "Only the viewer's own page.\n")

    return answer


@contextmanager
def own_pages_only() -> Iterator[None]:
    """Let a server of viser that starts inside serve its own pages alone."""
    with _starting, exchanged(vars(websockets), serve=_OwnPages):
        before = _OwnPages.used
        yield
        if _OwnPages.used == before:
            raise MissingExtraError(
                "this version of viser does not start as known, so that other pages could see the "
                "robot: pip install 'loopid[view]' brings one that does"
            )
