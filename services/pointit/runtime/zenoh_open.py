# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# (the stubs of zenoh leave return types out)
"""Opening a Zenoh session in a thread of its own, with the threads that Zenoh then works with."""

import os

import zenoh

from pointit.runtime.daemon_thread import in_daemon_thread

RUNTIME = "(rx: (worker_threads: 1))"
"""One thread receives, not two: each message would wake both, and both need Python's lock."""


async def opened(config: zenoh.Config) -> zenoh.Session:
    """Return an open session; may be cancelled at any time: one that opens all the same is closed again.

    `ZENOH_RUNTIME` in the environment goes before our choice of threads; Zenoh reads it when it first opens
    a session in a process.

    Raises:
        zenoh.ZError: it cannot be opened.
    """
    os.environ.setdefault("ZENOH_RUNTIME", RUNTIME)
    return await in_daemon_thread(
        lambda: zenoh.open(config), "zenoh-open", discard=lambda session: session.close()
    )
