"""Parameters of a connection to an MQTT broker."""

from collections.abc import Mapping
from typing import Any, Self, cast
from urllib.parse import SplitResult, unquote, urlsplit

from pydantic import Field, PrivateAttr, field_validator, model_validator

from pointit.runtime.address_config import (
    MissingInterfaceError,
    described_error,
    parse_address,
    with_plain_scope,
)
from pointit.runtime.config.config import Config

PORT = 1883
TLS_PORT = 8883
SCHEMES = {"mqtt": False, "tcp": False, "mqtts": True, "ssl": True, "tls": True}
"""True for schemes of encrypted connections."""
WEBSOCKET_SCHEMES = ("ws://", "wss://")
FORM = "write HOST, HOST:PORT or mqtts://USER@HOST; the password is in MQTT_PASSWORD"


class BrokerConfig(Config):
    """A broker, and how to log in to it."""

    broker: str = Field(
        default="", description="HOST or HOST:PORT of the broker; mqtts://USER@HOST sets `tls` and `username`"
    )
    tls: bool = Field(default=False, description="encrypt the connection; the default port is 8883 then")
    ca_file: str = Field(
        default="",
        description="file with the authority of the broker's certificate; if empty, the variable "
        "MQTT_CA_FILE has it, or it is one that the system trusts",
    )
    username: str = Field(default="", description="user name at the broker, if it asks for one")
    password_file: str = Field(
        default="", description="file with the password; the variable MQTT_PASSWORD has it if empty"
    )

    _uses_variable: bool = PrivateAttr(default=True)

    @property
    def uses_variable(self) -> bool:
        """Return True if the variable MQTT_PASSWORD is for this broker.

        It is for those that the person who started the process has named, not for one that came since by a
        message of the site.
        """
        return self._uses_variable

    def without_variable(self) -> Self:
        """Return a copy whose broker is never sent the variable MQTT_PASSWORD."""
        copy = self.model_copy()
        copy._uses_variable = False  # noqa: SLF001 - its own
        return copy

    @model_validator(mode="before")
    @classmethod
    def _split_url(cls, values: object) -> object:
        """Put the parts of a URL into the fields that they are of."""
        if not isinstance(values, Mapping):
            return values
        fields = dict(cast("Mapping[str, Any]", values))
        url = fields.get("broker")
        if isinstance(url, str) and "://" in url:
            parts = _url_parts(url)
            fields["broker"] = with_plain_scope(parts.netloc).rpartition("@")[2]
            if SCHEMES[parts.scheme]:
                fields["tls"] = True
            user = unquote(parts.username or "")
            if user and fields.setdefault("username", user) != user:
                raise described_error("broker: it and `username` name different users: leave one of both out")
        return fields

    @field_validator("broker")
    @classmethod
    def _is_address(cls, broker: str) -> str:
        try:
            port = parse_address(broker)[1] if broker else None
        except MissingInterfaceError as error:
            raise described_error(str(error)) from error
        except ValueError as error:
            # what is in front of an @ may be a password
            shown = broker.rpartition("@")[2]
            raise described_error(f"{FORM} (got {shown!r})") from error
        if port == 0:
            raise described_error(f"{broker}: no broker is at port 0: write its port, or the host alone")
        return broker

    @model_validator(mode="after")
    def _encrypts_for_its_authority(self) -> Self:
        if self.ca_file and not self.tls:
            raise described_error(
                "`ca_file` is for encrypted connections: set `tls`, or write mqtts:// in front of the broker"
            )
        return self

    def address(self) -> tuple[str, int]:
        """Return the host and the port of the broker."""
        host, port = parse_address(self.broker)
        if port is None:
            port = TLS_PORT if self.tls else PORT
        return host, port


def is_broker_url(url: str) -> bool:
    """Return True if the text of an address names a broker, not a web server."""
    scheme, separator, _ = url.strip().lower().partition("://")
    return bool(separator) and scheme in SCHEMES


def _url_parts(url: str) -> SplitResult:
    """Return the parts of the URL of a broker. Errors do not quote it: it may have a password."""
    error = described_error(f"broker: {FORM}")
    if url.lower().startswith(WEBSOCKET_SCHEMES):
        raise described_error(
            f"broker: PointIt speaks MQTT by TCP, not by websockets: name the listener for that, usually "
            f"port {PORT}, or {TLS_PORT} with mqtts://"
        )
    try:
        parts = urlsplit(url)
    except ValueError:
        raise error from None  # its text has the URL
    if parts.scheme not in SCHEMES or not parts.hostname:
        raise error
    if parts.password is not None or parts.path.strip("/"):
        raise error
    if parts.query or parts.fragment:
        raise error
    return parts
