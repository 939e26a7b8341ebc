"""Base of parameters with an address in the network, and the check for loopback."""

import ipaddress
from collections.abc import Mapping
from typing import Any, cast

from pydantic import model_validator
from pydantic_core import PydanticCustomError

from pointit.runtime.config.config import Config
from pointit.runtime.config.network_address import parse_address
from pointit.runtime.config.validation_message import DESCRIBED


class AddressConfig(Config):
    """Base of parameters that have a `host` and a `port`: `host` may be `HOST:PORT`, which sets both."""

    @model_validator(mode="before")
    @classmethod
    def _split_host(cls, values: object) -> object:
        if not isinstance(values, Mapping):
            return values
        fields = cast("Mapping[str, Any]", values)
        if not isinstance(text := fields.get("host"), str) or not text:
            return fields
        try:
            host, port = parse_address(text)
        except ValueError as error:
            raise described_error(f"host: {error}") from error
        if port is None:
            return {**fields, "host": host}
        if str(fields.get("port") or port).strip() != str(port):
            raise described_error(f"host: {text} and port {fields['port']} differ: remove one of the ports")
        return {**fields, "host": host, "port": port}


def format_address(host: str, port: int) -> str:
    """Return `HOST:PORT`, with brackets around an IPv6 address."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


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
