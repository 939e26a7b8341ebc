# pyright: reportUnknownMemberType=false
# (the stubs of zenoh leave return types out)
"""Checks that a router rejects a connection. Both functions block."""

import pytest
import zenoh

from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.session import configuration

KNOCK_MS = 300
"""Duration of one attempt that the router reports. Accepted ones succeed within 10 ms."""
SHUT_MS = 2000
"""Duration of an attempt whose rejection shows only by its failure."""


def is_not_let_in(config: zenoh.Config, for_ms: int = KNOCK_MS) -> None:
    """Try to connect with `config`, whose patience is changed. Fail if that succeeds.

    It also fails on a machine that is too slow, so check the router's report too, or use `keeps_out`.
    """
    config.insert_json5("connect/timeout_ms", str(for_ms))
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)


def keeps_out(who: Link, rightful: Link) -> None:
    """Fail if `who` can connect, or if the `rightful` cannot in the same time."""
    config = configuration(rightful)
    config.insert_json5("connect/timeout_ms", str(SHUT_MS))
    zenoh.open(config).close()
    is_not_let_in(configuration(who), SHUT_MS)
