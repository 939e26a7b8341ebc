"""Base of parameters with an address in the network."""

from collections.abc import Mapping
from typing import Any, cast

from pydantic import model_validator

from pointit.runtime.config.config import Config
from pointit.runtime.config.network_address import parse_address
from pointit.runtime.config.validation_message import described_error


class AddressConfig(Config):
    """Base of parameters that have a `host` and a `port`: `host` may be `HOST:PORT`, which sets both."""

    @model_validator(mode="before")
    @classmethod
    def _split_host(cls, values: object) -> object:
        fields = cast("Mapping[str, Any]", values if isinstance(values, Mapping) else {})
        if not isinstance(text := fields.get("host"), str) or not text:
            return values
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
