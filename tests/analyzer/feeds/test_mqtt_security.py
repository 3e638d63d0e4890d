"""An MQTT broker as operators run it: TLS, certificates, passwords, and one that is not there."""

from __future__ import annotations

import gc
import os
import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("paho.mqtt.client")

from analyzer import SourceError, UsageError
from analyzer.feeds.broker import PASSWORD_VARIABLE, parse_broker
from analyzer.feeds.mqtt import Mqtt
from tests.analyzer.feeds.test_mqtt import Mosquitto, pass_through, settle
from tests.conftest import ROOT, Modlens, command, environment, need_program
from tests.support.ptybus import PtyBus

PASSWORD = "s3cret of the plant"


def openssl(folder: Path, *words: str) -> None:
    """Run openssl; its certificates are made for this test alone."""
    program = need_program("openssl")
    subprocess.run([program, *words], cwd=folder, check=True, capture_output=True)


def certificates(folder: Path) -> None:
    """An authority, a broker's certificate for localhost, and one for the tap."""
    openssl(
        folder, "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=plant",
        "-keyout", "ca.key", "-out", "ca.pem",
    )  # fmt: skip
    for name, subject, san in (
        ("broker", "/CN=localhost", "DNS:localhost"),
        ("tap", "/CN=tap", "DNS:tap"),
    ):
        (folder / f"{name}.ext").write_text(f"subjectAltName={san}\n")
        openssl(
            folder, "req", "-newkey", "rsa:2048", "-nodes", "-subj", subject,
            "-keyout", f"{name}.key", "-out", f"{name}.csr",
        )  # fmt: skip
        openssl(
            folder, "x509", "-req", "-in", f"{name}.csr", "-CA", "ca.pem", "-CAkey", "ca.key",
            "-CAcreateserial", "-days", "2", "-extfile", f"{name}.ext", "-out", f"{name}.pem",
        )  # fmt: skip


@pytest.fixture(name="secured")
def _secured(tmp_path: Path) -> Iterator[Mosquitto]:
    """A broker that speaks TLS, asks for a certificate, and knows one user."""
    certificates(tmp_path)
    passwords = tmp_path / "passwords"
    passwords.touch(mode=0o600)
    program = need_program("mosquitto_passwd")
    subprocess.run([program, "-b", str(passwords), "tap", PASSWORD], check=True)
    server = Mosquitto(tmp_path)
    (tmp_path / "mosquitto.conf").write_text(
        f"user root\nlistener {server.port} 127.0.0.1\nallow_anonymous false\npersistence false\n"
        f"password_file {passwords}\ncafile {tmp_path}/ca.pem\ncertfile {tmp_path}/broker.pem\n"
        f"keyfile {tmp_path}/broker.key\nrequire_certificate true\n"
    )
    (tmp_path / "password").write_text(f"{PASSWORD}\n")
    server.start()
    yield server
    server.stop()


def options(folder: Path) -> dict[str, str]:
    """What the tap needs to log in."""
    return {
        "ca": str(folder / "ca.pem"),
        "certificate": str(folder / "tap.pem"),
        "key": str(folder / "tap.key"),
        "password_file": str(folder / "password"),
    }


def test_a_broker_with_tls_gets_everything(secured: Mosquitto, tmp_path: Path) -> None:
    where = parse_broker(f"mqtts://tap@localhost:{secured.port}/plant", **options(tmp_path))
    feed = Mqtt(where)
    assert feed.state == "connected"
    pass_through(feed, "....")
    settle(feed)
    feed.close()
    assert feed.delivered >= 4
    assert not feed.failed


# The client library leaves the socket of a failed handshake to the garbage collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize(
    ("host", "changed", "reason"),
    [
        ("localhost", {"ca": None}, "certificate verify failed"),
        ("127.0.0.1", {}, "certificate verify failed"),  # a certificate of another name
        ("localhost", {"password_file": "wrong"}, "not authorized"),
    ],
    ids=["an authority nobody trusts", "another host's certificate", "a wrong password"],
)
def test_a_connection_that_is_refused_is_reported_at_once(
    host: str, changed: dict[str, str | None], reason: str, secured: Mosquitto, tmp_path: Path
) -> None:
    """With its reason, and without the password."""
    (tmp_path / "wrong").write_text("wrong")
    words = options(tmp_path) | {
        key: value if value is None else str(tmp_path / value) for key, value in changed.items()
    }
    said: list[str] = []
    feed = Mqtt(
        parse_broker(f"mqtts://tap@{host}:{secured.port}", **words),
        notify=said.append,
    )
    pass_through(feed, "..")
    feed.close()
    assert reason in said[0].lower()
    assert re.search(r"0 of \d+ messages delivered, \d+ lost$", feed.outcome())
    assert feed.failed
    assert not any(PASSWORD in text for text in said)
    del feed
    gc.collect()


def test_where_a_password_comes_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file, else the environment, else the URL; never in what is printed of a broker."""
    monkeypatch.setenv(PASSWORD_VARIABLE, "of the environment")
    (tmp_path / "password").write_text("of the file\r\n")
    url = "mqtt://tap:of%20the%20URL@broker"
    path = str(tmp_path / "password")
    assert parse_broker(url, password_file=path).password == "of the file"
    assert parse_broker(url).password == "of the environment"
    monkeypatch.delenv(PASSWORD_VARIABLE)
    assert parse_broker(url).password == "of the URL"
    assert "of the URL" not in f"{parse_broker(url)} {parse_broker(url)!r}"
    assert parse_broker(url, password_file=path).password_in_url
    assert not parse_broker("mqtt://tap@broker", password_file=path).password_in_url


@pytest.mark.skipif(sys.platform != "linux", reason="the port is a pty")
def test_a_password_that_everybody_can_read_is_warned_of() -> None:
    """Once, with what to do instead, and without the password."""
    far, near = os.openpty()
    port = (os.ttyname(near), "--line", "19200-8E1", "--duration", "0.2s")
    words = command("tap", *port, "--mqtt", "mqtt://tap:secret@127.0.0.1:9")
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    os.close(far)
    os.close(near)
    said = " ".join(done.stderr.split())
    assert said.count("read the password in the list of processes") == 1
    assert f"--mqtt-password-file or {PASSWORD_VARIABLE}" in said
    assert "secret" not in said


@pytest.mark.parametrize(
    ("url", "words", "message"),
    [
        ("http://broker", {}, "not the address"),
        ("mqtt://tap:secret@broker:port", {}, "not the address"),
        ("mqtt://broker/a/%23", {}, "wildcard"),
        ("mqtt://broker/a/+/b", {}, "wildcard"),
        ("mqtt://broker/$SYS", {}, "for the broker"),
        ("mqtt://broker/a//b", {}, "empty level"),
        ("mqtt://broker", {"ca": "ca.pem"}, "need TLS"),
        ("mqtts://broker", {"key": "tap.key"}, "needs --mqtt-cert"),
    ],
)
def test_what_is_no_broker(url: str, words: dict[str, str], message: str) -> None:
    with pytest.raises(UsageError, match=message) as caught:
        parse_broker(url, **words)
    assert "secret" not in str(caught.value)


def test_files_that_cannot_be_used_are_named(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="no-such-file"):
        parse_broker("mqtt://tap@broker", password_file=str(tmp_path / "no-such-file"))
    (tmp_path / "empty.pem").touch()
    where = parse_broker("mqtts://broker")
    for changed in (
        replace(where, ca=str(tmp_path / "empty.pem")),
        replace(where, ca=str(tmp_path / "missing.pem")),
        replace(where, certificate=str(tmp_path / "missing.pem")),
    ):
        with pytest.raises(SourceError, match=r"(empty|missing)\.pem"):
            Mqtt(changed)


def free_port() -> int:
    """A port on which nobody listens."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


@pytest.mark.parametrize(
    ("host", "reason"), [("127.0.0.1", "refused"), ("no.such.host.invalid", "no connection")]
)
def test_a_broker_that_is_not_there(host: str, reason: str) -> None:
    """Said at the start and at the end; the status of a tap that delivered nothing is 3."""
    with PtyBus(["master", "unit", "tap"]) as bus:
        words = [sys.executable, "-m", "analyzer", "tap", bus.path("tap"), "--line", "19200-8N1"]
        words += ["--mqtt", f"mqtt://{host}:{free_port()}", "--count", "1"]
        with subprocess.Popen(
            words, cwd=ROOT, env=environment(), stderr=subprocess.PIPE, stdout=subprocess.PIPE
        ) as child:
            end = time.monotonic() + 20
            while child.poll() is None and time.monotonic() < end:
                bus.inject(bytes.fromhex("0103006b00037417"), "master")
                time.sleep(0.03)
                bus.inject(bytes.fromhex("010306022b00000064057a"), "unit")
                time.sleep(0.2)
            out, err = child.communicate(timeout=20)
    text = err.decode()
    assert child.returncode == 3, text
    assert reason in text.lower()
    assert "nothing was delivered" in text
    # One sentence says what became of the transaction, and no other claims that it was written.
    assert re.search(r"mqtt://\S+: 1 transaction; 0 of \d messages delivered, \d lost", text), text
    assert "written" not in text
    assert b"555 0 100" in out


@pytest.mark.parametrize("words", [["--home-assistant"], ["--mqtt-spool", "x"]])
def test_options_of_a_feed_that_is_not_asked_for(words: list[str], modlens: Modlens) -> None:
    done = modlens("tap", "/dev/null", *words)
    assert done.status == 2
    assert "needs --mqtt URL" in done.err
