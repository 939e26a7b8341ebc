"""Addresses in the network: as people write them, and the base of parameters with one."""

import ipaddress
import re
from collections.abc import Mapping
from typing import Any, cast

from pydantic import model_validator
from pydantic_core import PydanticCustomError

from pointit.runtime.config.config import Config
from pointit.runtime.config.validation_message import DESCRIBED

MAX_PORT = 65535
_BRACKETED = re.compile(r"\[([^\[\]]*)\](?::(.*))?")
_NO_NAME = re.compile(r"[\s\0/@?#%\\\[\]]|^\.|\.\.|[^.]{64}")
_NUMBER = re.compile(r"[0-9]+|0[xX][0-9a-fA-F]*")


class MissingInterfaceError(ValueError):
    """A link-local address without this machine's interface, with the remedy."""


def parse_address(text: str) -> tuple[str, int | None]:
    """Return host and port of `HOST` or `HOST:PORT`; the port is None if there is none.

    An IPv6 address stands in brackets if a port follows it. The returned host has none.

    Raises:
        ValueError: If it is neither, or its numbers are no address or no port.
    """
    stripped = text.strip()
    if match := _BRACKETED.fullmatch(stripped):
        host = _numeric_host(ipaddress.IPv6Address, match[1], text)
        port = match[2]
    elif stripped.count(":") > 1:
        host = _numeric_host(ipaddress.IPv6Address, stripped, text)
        port = None
    else:
        host, colon, after = stripped.partition(":")
        port = after if colon else None
        if not host or _NO_NAME.search(host):
            raise _error(text)
        if _NUMBER.fullmatch(host.removesuffix(".").rpartition(".")[2]):
            # a resolver reads 192.168.1 as 192.168.0.1, and 010 as 8
            host = _numeric_host(ipaddress.IPv4Address, host, text)
    if port is None:
        return host, None
    if not (port.isascii() and port.isdecimal()):
        raise _error(text)
    if int(port) > MAX_PORT:
        raise ValueError(f"port {port} is above {MAX_PORT}: correct it")
    return host, int(port)


def _numeric_host(kind: type[ipaddress.IPv4Address | ipaddress.IPv6Address], host: str, text: str) -> str:
    try:
        address = kind(host)
    except ValueError as error:
        raise _error(text) from error
    if isinstance(address, ipaddress.IPv6Address):
        needs_interface = address.is_link_local and not address.scope_id
        if needs_interface:
            raise MissingInterfaceError(
                f"{host} is in more than one network: add this machine's interface, as in {host}%eth0"
            )
    return str(address)


def _error(text: str) -> ValueError:
    return ValueError(f"{text!r} is not an address: write HOST or HOST:PORT, for IPv6 ::1 or [::1]:PORT")


class AddressConfig(Config):
    """Base of parameters that have a `host` and a `port`: `host` may be `HOST:PORT`, which sets both."""

    @model_validator(mode="before")
    @classmethod
    def _split_host(cls, values: object) -> object:
        if not isinstance(values, Mapping):
            return values
        fields = cast("Mapping[str, Any]", values)
        text = fields.get("host")
        if not isinstance(text, str) or not text:
            return fields
        try:
            host, port = parse_address(text)
        except ValueError as error:
            raise described_error(f"host: {error}") from error
        if port is None:
            return {**fields, "host": host}
        other_port = str(fields.get("port") or port)
        if other_port.strip() != str(port):
            raise described_error(f"host: {text} and port {fields['port']} differ: remove one of the ports")
        return {**fields, "host": host, "port": port}


def with_plain_scope(netloc: str) -> str:
    """Return host and port of a URL, its interface as `%eth0` in place of `%25eth0` (RFC 6874)."""
    return netloc.replace("%25", "%", 1) if netloc.rpartition("@")[2].startswith("[") else netloc


def format_address(host: str, port: int) -> str:
    """Return `HOST:PORT`, with brackets around an IPv6 address."""
    if ":" in host:
        return f"[{host}]:{port}"
    return f"{host}:{port}"


def described_error(text: str) -> PydanticCustomError:
    """Return an error of which the message is `text` alone, without the value."""
    return PydanticCustomError(DESCRIBED, "{text}", {"text": text})


def is_loopback(address: str) -> bool:
    """Return True if `address`, as of `parse_address`, is reachable from this machine only."""
    try:
        host = parse_address(address)[0].lower().removesuffix(".")
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
