"""The Model Context Protocol as its two revisions have it."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Mapping
from typing import Any

import pytest

from analyzer.assistants.protocol import MAX_LINE_BYTES, VERSIONS, Server

META = {
    "io.modelcontextprotocol/protocolVersion": "2026-07-28",
    "io.modelcontextprotocol/clientCapabilities": {},
}


LISTED = [{"name": "echo", "inputSchema": {"type": "object"}}]


class Echo:
    """A tool that returns its arguments, and one that has a mistake."""

    @property
    def listed(self) -> list[dict[str, Any]]:
        """The tools."""
        return LISTED

    def call(self, name: str, arguments: Mapping[str, Any]) -> tuple[str, bool]:
        """Answer; `TypeError` from the tool with a mistake."""
        tools: dict[str, Callable[[Any], Any]] = {"echo": json.dumps, "broken": int}
        return tools[name](arguments), False


SERVER = Server(Echo(), name="modlens", version="1", instructions="begin with overview")


def ask(method: str, params: Any = None, **more: Any) -> dict[str, Any]:
    request = {"jsonrpc": "2.0", "id": 7, "method": method, "params": params or {}, **more}
    answer = SERVER.answer(json.dumps(request).encode())
    assert answer is not None
    assert (answer["jsonrpc"], answer["id"]) == ("2.0", 7)
    return answer


@pytest.mark.parametrize(
    ("asked", "given"),
    [("2025-11-25", "2025-11-25"), ("2024-11-05", "2024-11-05"), ("1999-01-01", "2025-11-25")],
)
def test_a_client_of_the_handshake_is_served(asked: str, given: str) -> None:
    """It gets its version, or the newest that has a handshake; no result names its type."""
    result = ask("initialize", {"protocolVersion": asked, "capabilities": {}})["result"]
    assert result["protocolVersion"] == given
    assert result["capabilities"] == {"tools": {}}
    assert result["serverInfo"] == {"name": "modlens", "version": "1"}
    assert ask("ping")["result"] == {}
    assert ask("tools/list")["result"] == {"tools": LISTED}
    called = ask("tools/call", {"name": "echo", "arguments": {"a": 1}})["result"]
    assert called == {"content": [{"type": "text", "text": '{"a": 1}'}], "isError": False}


def test_a_client_without_a_handshake_is_served() -> None:
    """Each result names its type and the server; what may be cached says for how long."""
    listed = ask("tools/list", {"_meta": META})["result"]
    assert listed["resultType"] == "complete"
    assert listed["_meta"]["io.modelcontextprotocol/serverInfo"]["name"] == "modlens"
    assert (listed["ttlMs"] > 0, listed["cacheScope"]) == (True, "public")
    called = ask("tools/call", {"name": "echo", "_meta": META})["result"]
    assert (called["resultType"], called["content"][0]["text"]) == ("complete", "{}")
    assert "ttlMs" not in called


@pytest.mark.parametrize("params", [{}, {"_meta": META}])
def test_a_probe_tells_the_versions(params: dict[str, Any]) -> None:
    """An error to it would say that there is nothing but the handshake."""
    result = ask("server/discover", params)["result"]
    assert result["supportedVersions"] == list(VERSIONS)
    assert result["resultType"] == "complete"
    assert result["capabilities"] == {"tools": {}}
    assert result["instructions"] == "begin with overview"


@pytest.mark.parametrize(
    ("method", "params", "code"),
    [
        ("tools/list", {"_meta": {**META, "io.modelcontextprotocol/protocolVersion": "1"}}, -32022),
        ("resources/list", {}, -32601),
        ("tools/call", {"name": "none"}, -32602),
        ("tools/call", {"name": "echo", "arguments": []}, None),
        ("tools/call", {"name": "echo", "arguments": [1]}, -32602),
        ("tools/call", {"name": "broken"}, -32603),
        ("tools/list", [1], -32602),
    ],
)
def test_what_cannot_be_served_is_an_error(method: str, params: Any, code: int | None) -> None:
    """With the code of the specification; the next request is served all the same."""
    assert ask(method, params).get("error", {}).get("code") == code
    assert ask("ping")["result"] == {}


@pytest.mark.parametrize(
    ("line", "code"),
    [
        (b"{", -32700),
        (b"\xff\xfe", -32700),
        (b"[" * 100_000, -32700),
        (b"[]", -32600),
        (b'{"id": 1}', -32600),
        (b"x" * (3 * MAX_LINE_BYTES), -32700),
    ],
)
def test_lines_that_are_no_requests_are_answered(line: bytes, code: int) -> None:
    """And nothing of them is taken for the next request."""
    out = io.BytesIO()
    following = b'{"jsonrpc":"2.0","id":2,"method":"ping"}\n'
    SERVER.serve(io.BytesIO(line + b"\n" + following), out)
    first, second = map(json.loads, out.getvalue().splitlines())
    assert (first["error"]["code"], first["id"]) == (code, None)
    assert second == {"jsonrpc": "2.0", "id": 2, "result": {}}


def test_notifications_have_no_answer() -> None:
    """Nor have empty lines, and responses to what nobody asked."""
    quiet = [
        b'{"jsonrpc":"2.0","method":"notifications/initialized"}',
        b"",
        b'{"jsonrpc":"2.0","id":1,"result":{}}',
    ]
    assert [SERVER.answer(line) for line in quiet] == [None, None, None]
