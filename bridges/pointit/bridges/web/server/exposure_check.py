"""Who could reach the page, and get in, as it is configured: what that must not be."""

import contextlib
import ipaddress
import os
from pathlib import Path

from pointit.bridges.web.config import WebConfig
from pointit.runtime.errors import ConfigError

CONTAINER = "container"
"""The variable by which a process is told that it is in one; our image and podman set it."""
CONTAINER_MARKS = (Path("/.dockerenv"), Path("/run/.containerenv"))
"""What engines put into a container."""

LEAST_TOKEN = 8
"""Characters; a shorter one is guessed."""


def check(config: WebConfig) -> None:
    """Refuse to be seen without encryption from elsewhere, and tokens that do not keep anybody out.

    Raises:
        ConfigError: names the parameter and says what to do.
    """
    if not _is_loopback(config.host) and not (config.published_port and _is_contained()):
        raise ConfigError(
            f"host: {config.host} can be reached from other machines, and what goes there is not "
            "encrypted; leave it at 127.0.0.1 and use lan: true, which opens the page by HTTPS "
            "(or published_port in a container)"
        )
    for name, token in (("operator_token", config.operator_token), ("viewer_token", config.viewer_token)):
        if token and len(token) < LEAST_TOKEN:
            raise ConfigError(f"{name}: has {len(token)} characters, use at least {LEAST_TOKEN}")
    if config.operator_token and config.operator_token == config.viewer_token:
        raise ConfigError("viewer_token: is the operator's; choose another, or leave it empty")


def address(config: WebConfig, port: int) -> tuple[str, int]:
    """Return host and port at which the page is opened, when it listens at `port`."""
    host = config.host if _is_loopback(config.host) else "127.0.0.1"
    return host, config.published_port or port


def _is_contained() -> bool:
    """Return True if nobody reaches this process but through a container's engine, or other containers."""
    return bool(os.environ.get(CONTAINER)) or any(mark.exists() for mark in CONTAINER_MARKS)


def _is_loopback(host: str) -> bool:
    with contextlib.suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return host == "localhost"
