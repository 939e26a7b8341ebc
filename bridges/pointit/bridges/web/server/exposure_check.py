"""Check of the configured exposure: who could reach the page and log in."""

import os
from pathlib import Path

from pointit.bridges.web.config import WebConfig
from pointit.runtime.address_config import is_loopback
from pointit.runtime.errors import ConfigError

CONTAINER = "container"
"""Environment variable that marks a container; set by PointIt's image and podman."""
CONTAINER_MARKS = (Path("/.dockerenv"), Path("/run/.containerenv"))
"""Files that container engines create."""

MIN_TOKEN = 8
"""Minimum length of a token; shorter ones can be guessed."""


def check(config: WebConfig) -> None:
    """Check that the page is not reachable unencrypted from elsewhere, and that tokens are strong.

    Raises:
        ConfigError: If it is not; names the parameter and what to do.
    """
    if not is_loopback(config.host) and not (config.published_port and _is_contained()):
        raise ConfigError(
            f"host: {config.host} can be reached from other machines, and what goes there is not "
            "encrypted; leave it at 127.0.0.1 and use lan: true, which opens the page by HTTPS "
            "(or published_port in a container)"
        )
    for name, token in (("operator_token", config.operator_token), ("viewer_token", config.viewer_token)):
        if token and len(token) < MIN_TOKEN:
            raise ConfigError(f"{name}: has {len(token)} characters, use at least {MIN_TOKEN}")
    if config.operator_token and config.operator_token == config.viewer_token:
        raise ConfigError("viewer_token: equals operator_token; choose another, or leave it empty")


def address(config: WebConfig, port: int) -> tuple[str, int]:
    """Return host and port of the page's address if it listens at `port`."""
    host = config.host if is_loopback(config.host) else "127.0.0.1"
    return host, config.published_port or port


def _is_contained() -> bool:
    return bool(os.environ.get(CONTAINER)) or any(mark.exists() for mark in CONTAINER_MARKS)
