"""The page that decodes in a browser: the same rows as the command, and no connection."""

from __future__ import annotations

import gzip
import json
import socket
import tarfile
import zipfile
from pathlib import Path

import pytest

import modlens as api
from analyzer.page import CORE
from tests.conftest import CAPTURES, Modlens
from tests.support.browser import Browser
from tests.support.page import RECORDINGS, TABLES, TROUBLE, of_command, saved, show

MAX_CORE_BYTES = 1_120_000
MAX_PAGE_BYTES = 2_500_000


def test_the_page_is_small(written: Path) -> None:
    """A page that is mailed; ruff's grew by half in nine months without anybody noticing."""
    assert CORE.stat().st_size <= MAX_CORE_BYTES
    assert written.stat().st_size <= MAX_PAGE_BYTES


def test_the_rows_are_those_of_the_command(opened: Browser, tmp_path: Path) -> None:
    """All recordings, all tables, cell by cell."""
    for path in RECORDINGS:
        show(opened, path)
        for table, text in of_command(path, TABLES, tmp_path).items():
            assert saved(opened, table) == text, (path, table)
    assert set(opened.requests()) == {opened.run("return location.href")}


def test_no_connection_is_possible(opened: Browser) -> None:
    """Neither the page nor a worker of it reaches a server: nothing can be uploaded."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"http://127.0.0.1:{server.getsockname()[1]}/"
        for way in (
            "fetch(arguments[0])",
            "new Promise((done, fail) => { const it = new Image(); it.onload = done;"
            " it.onerror = () => fail(new Error('refused')); it.src = arguments[0]; })",
            "new Promise((done, fail) => { const it = new Worker(URL.createObjectURL(new Blob(["
            "`fetch('${arguments[0]}').then(() => postMessage(1), () => postMessage(0))`])));"
            " it.onmessage = ({ data }) => data ? done('sent') : fail(new Error('refused')); })",
            "new Promise((done, fail) => {"
            " const it = new WebSocket(arguments[0].replace('http', 'ws')); it.onopen = done;"
            " it.onerror = () => fail(new Error('refused')); })",
        ):
            assert str(opened.ask(way, url)).startswith("error: "), way
        opened.run("navigator.sendBeacon(arguments[0], 'x')", url)
        server.settimeout(1)
        with pytest.raises(TimeoutError):
            server.accept()


def test_the_verdict_is_the_doctors(opened: Browser, modlens: Modlens) -> None:
    path = CAPTURES / "pymodbus_disturbed" / "recording.jsonl"
    show(opened, path)
    doctor = json.loads(modlens("doctor", path, "--to", "json").out)
    assert doctor["sentence"] in opened.run("return document.getElementById('verdict').innerText")
    assert len(
        opened.run("return [...document.querySelectorAll('.card')].map((it) => it.innerText)")
    ) == len(doctor["diagnoses"])


def test_filters_choose_rows(opened: Browser) -> None:
    path = CAPTURES / "pymodbus_disturbed" / "recording.jsonl"
    show(opened, path)
    opened.run("document.getElementById('failed').click()")
    failed = [
        row
        for row in api.decode(path).transactions
        if row.status in ("no_response", "bad_request", "bad_response")
    ]
    opened.wait(f"document.getElementById('shown').textContent === '{len(failed)} rows'")
    opened.wait(f"document.querySelectorAll('.grid-lines .grid-row').length === {len(failed)}")


def test_a_row_opens_with_its_bytes_and_meanings(opened: Browser) -> None:
    show(opened, CAPTURES / "pymodbus_disturbed" / "recording.jsonl")
    opened.run("document.querySelectorAll('.grid-lines .grid-row')[1].click()")
    opened.wait("document.documentElement.dataset.detail === '1'")
    text = opened.run("return document.getElementById('detail').innerText")
    assert "the checksum does not match the bytes" in text
    assert "01 04 00 64" in text


def test_an_example_of_a_cause_is_a_row(opened: Browser) -> None:
    show(opened, CAPTURES / "pymodbus_disturbed" / "recording.jsonl")
    number = opened.run(
        "const link = document.querySelector('#verdict a[href^=\"#txn-\"]');"
        "link.click(); return link.textContent"
    )
    opened.wait(f"document.getElementById('detail').innerText.startsWith('Transaction {number}')")


def test_a_table_is_walked_through_by_keys(opened: Browser, tmp_path: Path) -> None:
    """Three hundred thousand rows: the last one is reached, and rows stand where they belong."""
    exchange = bytes.fromhex("010300000001840a0103020007f986")
    path = tmp_path / "long.bin"
    path.write_bytes(exchange * 300_000)
    show(opened, path)
    grid = "document.querySelector('.grid')"
    opened.run(f"{grid}.dispatchEvent(new KeyboardEvent('keydown', {{ key: 'End' }}))")
    numbers = "[...document.querySelectorAll('[data-row]')].map((it) => it.firstChild.textContent)"
    opened.wait(f"{numbers}.includes('300000')")
    opened.run(f"{grid}.dispatchEvent(new KeyboardEvent('keydown', {{ key: 'Home' }}))")
    opened.wait(f"{numbers}[0] === '1'")
    opened.run(f"{grid}.scrollTop = {grid}.scrollHeight / 2")
    opened.wait(f"Math.abs({numbers}[0] - 150000) < 100")


@pytest.mark.parametrize("packing", ["gzip", "zip", "tar.gz"])
def test_packed_recordings_are_unpacked(packing: str, opened: Browser, tmp_path: Path) -> None:
    path = CAPTURES / "pymodbus_two_units" / "recording.jsonl"
    if packing == "gzip":
        packed = tmp_path / "recording.jsonl.gz"
        packed.write_bytes(gzip.compress(path.read_bytes()))
    elif packing == "zip":
        packed = tmp_path / "all.zip"
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.write(path, "recording.jsonl")
    else:
        packed = tmp_path / "all.tar.gz"
        with tarfile.open(packed, "w:gz") as archive:
            archive.add(path, "recording.jsonl")
    show(opened, packed)
    expected = of_command(path, ["transactions"], tmp_path)["transactions"]
    assert saved(opened, "transactions") == expected


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "cp1251", "gbk"])
def test_texts_in_other_encodings(encoding: str, opened: Browser, tmp_path: Path) -> None:
    word = "ответ" if encoding == "cp1251" else "接收"
    path = tmp_path / "log.txt"
    text = f"Tx: 01 03 00 00 00 01 84 0a\n{word} Rx: 01 03 02 00 07 f9 86\n" * 3
    path.write_bytes(text.encode(encoding))
    show(opened, path)
    expected = of_command(path, ["transactions"], tmp_path)["transactions"]
    assert saved(opened, "transactions") == expected


def test_what_cannot_be_read_is_said(opened: Browser, tmp_path: Path) -> None:
    path = tmp_path / "letter.txt"
    path.write_text("Dear colleagues,\nthe meeting is at noon.\n")
    show(opened, path, "refused")
    assert "text in an unknown format" in opened.run(
        "return document.getElementById('trouble').textContent"
    )
    (tmp_path / "empty.bin").write_bytes(b"")
    show(opened, tmp_path / "empty.bin", "refused")
    (tmp_path / "all.xz").write_bytes(b"\xfd7zXZ\0")
    show(opened, tmp_path / "all.xz", "refused")
    assert "unpack it first" in opened.run(TROUBLE)


def test_a_capture_is_saved_for_wireshark(
    opened: Browser, modlens: Modlens, tmp_path: Path
) -> None:
    """The pcapng that the page saves gives the frames of the recording."""
    path = CAPTURES / "pymodbus_disturbed" / "recording.jsonl"
    show(opened, path)
    found = opened.ask(
        "Page.request('decode', { blob: Page.recording.blob,"
        " settings: { name: 'recording.jsonl', purpose: 'capture' } })"
        ".then(async ({ pieces }) => [...new Uint8Array(await pieces.arrayBuffer())])"
    )
    (tmp_path / "page.pcapng").write_bytes(bytes(found))
    modlens("export", path, "-o", str(tmp_path / "command.pcapng"))
    written, expected = (
        [row.hex for row in api.decode(tmp_path / name).frames]
        for name in ("page.pcapng", "command.pcapng")
    )
    assert written
    assert written == expected


def test_pasted_text_is_decoded(opened: Browser) -> None:
    opened.run(
        "document.getElementById('text').value = arguments[0];"
        "document.getElementById('decode-text').click()",
        "Tx: 01 03 00 00 00 01 84 0A\nRx: 01 03 02 00 07 F9 86\n",
    )
    opened.wait("document.documentElement.dataset.state === 'shown'")
    assert saved(opened, "transactions").count("\n") == 2


def test_titles_are_above_their_columns(opened: Browser) -> None:
    """Bold characters are wider, which must not move them."""
    show(opened, CAPTURES / "pymodbus_disturbed" / "recording.jsonl")
    places = (
        "return [...document.querySelector(selector).children]"
        ".map((it) => Math.round(it.getBoundingClientRect().left))"
    )
    titles = opened.run(f"const selector = '.grid-head'; {places}")
    cells = opened.run(f"const selector = '.grid-lines .grid-row'; {places}")
    assert titles == cells
