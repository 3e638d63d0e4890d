"""The Model Context Protocol over two streams: a JSON object per line, one request at a time.

Revision 2026-07-28 has no handshake: each request names its version in `_meta`. Clients of
2025-11-25 and earlier begin with `initialize`. Both are served; what a request holds decides.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any, BinaryIO, Protocol

__all__ = ["VERSIONS", "Server", "Tools"]

MODERN = "2026-07-28"
VERSIONS = (MODERN, "2025-11-25", "2025-06-18", "2025-03-26", "2024-11-05")
"""The revisions that are served, the newest first; all but the first begin with `initialize`."""

MAX_LINE_BYTES = 1 << 20
"""A request is far shorter; the rest of a longer line is skipped."""

PARSE_ERROR, INVALID_REQUEST, NO_METHOD, INVALID_PARAMS = -32700, -32600, -32601, -32602
INTERNAL_ERROR, UNSUPPORTED_VERSION = -32603, -32022

_META = "io.modelcontextprotocol/"

Message = Mapping[str, Any]


class Tools(Protocol):
    """The tools that a server offers."""

    @property
    def listed(self) -> list[dict[str, Any]]:
        """Their names, descriptions and schemas, as `tools/list` returns them."""

    def call(self, name: str, arguments: Message) -> tuple[str, bool]:
        """The answer of a tool, and whether it is an error; `KeyError` without such a tool."""


class _RequestError(Exception):
    """A request that cannot be served."""

    def __init__(self, code: int, message: str, data: Any = None) -> None:
        super().__init__(message)
        self.code = code
        self.data = data


class Server:
    """Answers requests by means of `tools`; `name`, `version` and `instructions` describe it."""

    def __init__(self, tools: Tools, *, name: str, version: str, instructions: str) -> None:
        self._tools = tools
        self._info = {"name": name, "version": version}
        self._instructions = instructions
        self._methods: dict[str, Callable[[Message], dict[str, Any]]] = {
            "initialize": self._initialize,
            "server/discover": self._discover,
            "ping": lambda _: {},
            "tools/list": self._list,
            "tools/call": self._call,
        }

    def serve(self, requests: BinaryIO, responses: BinaryIO) -> None:
        """Answer the requests until their stream ends."""
        while line := requests.readline(MAX_LINE_BYTES):
            rest = line
            while not rest.endswith(b"\n") and (rest := requests.readline(MAX_LINE_BYTES)):
                line = b"(longer than a request can be)"
            answer = self.answer(line)
            if answer is not None:
                responses.write(json.dumps(answer, separators=(",", ":")).encode() + b"\n")
                responses.flush()

    def answer(self, line: bytes) -> dict[str, Any] | None:
        """The response to one line; None for a notification, a response or an empty line."""
        try:
            message = json.loads(line) if line.strip() else {"result": None}
        except (ValueError, RecursionError):
            return _failure(None, PARSE_ERROR, "not a JSON object in UTF-8, or too long")
        if not isinstance(message, dict) or not ({"method", "result", "error"} & message.keys()):
            return _failure(None, INVALID_REQUEST, "neither a request nor a notification")
        if "id" not in message or "method" not in message:
            return None
        try:
            return {"jsonrpc": "2.0", "id": message["id"], "result": self._result(message)}
        except _RequestError as error:
            return _failure(message["id"], error.code, str(error), error.data)

    def _result(self, message: Message) -> dict[str, Any]:
        method, params = message["method"], message.get("params") or {}
        if not isinstance(params, dict):
            raise _RequestError(INVALID_PARAMS, "params is not an object")
        version = _version_of(params)
        handler = self._methods.get(method) if isinstance(method, str) else None
        # What versions there are is asked before one is known.
        is_modern = version is not None or method == "server/discover"
        if version not in (None, MODERN) and method != "server/discover":
            data = {"supported": list(VERSIONS), "requested": str(version)}
            raise _RequestError(UNSUPPORTED_VERSION, "unsupported protocol version", data)
        if handler is None:
            raise _RequestError(NO_METHOD, "no such method")
        result = handler(params)
        if not is_modern:
            return result
        caching = {} if method == "tools/call" else {"ttlMs": 3_600_000, "cacheScope": "public"}
        meta = {f"{_META}serverInfo": self._info}
        return {"resultType": "complete", **result, **caching, "_meta": meta}

    def _initialize(self, params: Message) -> dict[str, Any]:
        wanted = params.get("protocolVersion")
        return {
            "protocolVersion": wanted if wanted in VERSIONS[1:] else VERSIONS[1],
            "capabilities": {"tools": {}},
            "serverInfo": self._info,
            "instructions": self._instructions,
        }

    def _discover(self, _: Message) -> dict[str, Any]:
        return {
            "supportedVersions": list(VERSIONS),
            "capabilities": {"tools": {}},
            "instructions": self._instructions,
        }

    def _list(self, _: Message) -> dict[str, Any]:
        return {"tools": self._tools.listed}

    def _call(self, params: Message) -> dict[str, Any]:
        name, arguments = params.get("name"), params.get("arguments") or {}
        if not isinstance(name, str) or not isinstance(arguments, dict):
            raise _RequestError(INVALID_PARAMS, "a call needs a name, and arguments in an object")
        try:
            text, is_error = self._tools.call(name, arguments)
        except KeyError as error:
            raise _RequestError(INVALID_PARAMS, f"unknown tool {name}") from error
        except Exception as error:  # a mistake of ours must not end the session
            raise _RequestError(INTERNAL_ERROR, f"{type(error).__name__}: {error}") from error
        return {"content": [{"type": "text", "text": text}], "isError": is_error}


def _version_of(params: Message) -> Any:
    """The protocol version that a request names; None for one of an older client."""
    meta = params.get("_meta")
    return meta.get(f"{_META}protocolVersion") if isinstance(meta, dict) else None


def _failure(identifier: Any, code: int, message: str, data: Any = None) -> dict[str, Any]:
    error = {"code": code, "message": message} | ({} if data is None else {"data": data})
    return {"jsonrpc": "2.0", "id": identifier, "error": error}
