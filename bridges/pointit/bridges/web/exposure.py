"""Who could reach the page, and get in, as it is configured: what that must not be."""

import contextlib
import ipaddress

from pointit.bridges.web.config import WebConfig
from pointit.runtime.errors import ConfigError

LEAST_TOKEN = 8
"""Characters; a shorter one is guessed."""


def check(config: WebConfig) -> None:
    """Refuse to be seen without encryption from elsewhere, and tokens that do not keep anybody out.

    Raises:
        ConfigError: names the parameter and says what to do.
    """
    if not _is_loopback(config.host):
        raise ConfigError(
            f"host: {config.host} can be reached from other machines, and what goes there is not "
            "encrypted; leave it at 127.0.0.1 and use lan: true, which opens the page by HTTPS"
        )
    for name, token in (("operator_token", config.operator_token), ("viewer_token", config.viewer_token)):
        if token and len(token) < LEAST_TOKEN:
            raise ConfigError(f"{name}: has {len(token)} characters, use at least {LEAST_TOKEN}")
    if config.operator_token and config.operator_token == config.viewer_token:
        raise ConfigError("viewer_token: is the operator's; choose another, or leave it empty")


def _is_loopback(host: str) -> bool:
    with contextlib.suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return host == "localhost"
