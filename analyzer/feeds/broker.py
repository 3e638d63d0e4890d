"""Where an MQTT broker is, how to log in to it, and how its certificate is checked.

A password belongs in a file or in the environment: a URL is in the list of processes, where
everybody on the machine can read it. No message prints one.
"""

from __future__ import annotations

import os
import ssl
from dataclasses import dataclass, field
from pathlib import Path

import _modlens
from dissectors.errors import SourceError, UsageError

__all__ = ["PASSWORD_VARIABLE", "Broker", "parse_broker", "tls_context"]

PASSWORD_VARIABLE = "MODLENS_MQTT_PASSWORD"
"""The environment variable with the password, where no file and no URL has one."""


@dataclass(frozen=True, slots=True)
class Broker:
    """A broker: host, port, credentials (None without), the prefix of all topics, TLS or not.

    `ca` is a file with the certificates of the authorities to trust (None: those of the system);
    `certificate` and `key` are files with the client's own. `password_in_url` says that a password
    was given where others can read it, used or not.
    """

    host: str
    port: int
    user: str | None
    password: str | None = field(repr=False)
    prefix: str
    tls: bool = False
    ca: str | None = None
    certificate: str | None = None
    key: str | None = None
    password_in_url: bool = False

    def __str__(self) -> str:
        return f"mqtt{'s' * self.tls}://{self.host}:{self.port}/{self.prefix}"


def parse_broker(
    url: str,
    *,
    password_file: str | None = None,
    ca: str | None = None,
    certificate: str | None = None,
    key: str | None = None,
) -> Broker:
    """Parse `mqtt[s]://[user[:password]@]host[:port][/prefix]`.

    The password is that of the file, else of the environment, else of the URL. `UsageError` for
    another text or a prefix that is no topic, `SourceError` if the file cannot be read.

    >>> parse_broker("mqtt://192.168.1.9/plant").prefix
    'plant'
    >>> print(parse_broker("mqtts://me:secret@broker.example"))
    mqtts://broker.example:8883/modlens
    """
    try:
        tls, host, port, user, password, prefix, exposed = _modlens.parse_broker(
            url, _password(password_file)
        )
    except ValueError as error:
        raise UsageError(f"--mqtt: {error}") from error
    if not tls and (ca or certificate or key):
        raise UsageError("--mqtt-ca, --mqtt-cert and --mqtt-key need TLS: write mqtts://host")
    if key is not None and certificate is None:
        raise UsageError("--mqtt-key needs --mqtt-cert: the certificate that the key belongs to")
    return Broker(host, port, user, password, prefix, tls, ca, certificate, key, exposed)


def _password(path: str | None) -> str | None:
    if path is None:
        return os.environ.get(PASSWORD_VARIABLE)
    try:
        return Path(path).read_text("utf-8").rstrip("\r\n")
    except OSError as error:
        raise SourceError(f"--mqtt-password-file {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise SourceError(f"--mqtt-password-file {path}: not text in UTF-8") from error


def tls_context(broker: Broker) -> ssl.SSLContext:
    """The settings of TLS: certificate and name of the broker are verified, always.

    `SourceError` names the file that cannot be used.
    """
    try:
        context = ssl.create_default_context(cafile=broker.ca)
    except (OSError, ssl.SSLError) as error:
        raise SourceError(f"--mqtt-ca {broker.ca}: {_reason(error)}") from error
    if broker.certificate is not None:
        try:
            context.load_cert_chain(broker.certificate, broker.key, password=_no_password)
        except (OSError, ssl.SSLError, ValueError) as error:
            which = (
                broker.certificate
                if broker.key is None
                else f"{broker.certificate} with {broker.key}"
            )
            raise SourceError(f"--mqtt-cert {which}: {_reason(error)}") from error
    return context


def _no_password() -> str:
    """Refuse a key that is encrypted; without this, OpenSSL would ask on the terminal."""
    raise ValueError("the key is encrypted; store it without a password, readable by you alone")


def _reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error)
