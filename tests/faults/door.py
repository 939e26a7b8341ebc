# pyright: reportUnknownMemberType=false
# (the stubs of zenoh leave return types out)
"""Whether a router's door stays shut to somebody; both functions block."""

import pytest
import zenoh

from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.session import configuration

KNOCK_MS = 300
"""For how long somebody tries at a time whom the router tells of; who is let in, is so within 10 ms."""
SHUT_MS = 2000
"""For how long where nothing but a door that stays shut tells that somebody is kept out."""


def is_not_let_in(config: zenoh.Config, for_ms: int = KNOCK_MS) -> None:
    """Try to come in with `config`, whose patience is changed; fail if that succeeds.

    It does not succeed either where the machine is too slow: see that the router tells of it, or `keeps_out`.
    """
    config.insert_json5("connect/timeout_ms", str(for_ms))
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)


def keeps_out(who: Link, rightful: Link) -> None:
    """Fail if the door opens to `who`, or if it does not open to the `rightful` in the same time."""
    config = configuration(rightful)
    config.insert_json5("connect/timeout_ms", str(SHUT_MS))
    zenoh.open(config).close()
    is_not_let_in(configuration(who), SHUT_MS)
