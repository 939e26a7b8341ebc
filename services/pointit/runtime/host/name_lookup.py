"""Lookup of host names in a thread of its own, so that a slow resolver delays nothing else."""

import asyncio
import contextlib
import ipaddress
import socket
import threading


async def look_up(host: str) -> str:
    """Return an IPv4 address of `host`, a name or an address.

    The thread ends with the resolver's answer, or with the process: unlike a thread of the loop's own, it
    delays no end of the loop.

    Raises:
        OSError: If there is none.
    """
    with contextlib.suppress(ValueError):
        return str(ipaddress.IPv4Address(host))
    loop = asyncio.get_running_loop()
    answer: asyncio.Future[str] = loop.create_future()

    def settle(address: str, error: Exception | None) -> None:
        if answer.done():  # cancelled
            return
        if error is None:
            answer.set_result(address)
        else:
            answer.set_exception(error)

    def ask() -> None:
        address, error = "", None
        try:
            address = str(socket.getaddrinfo(host, None, socket.AF_INET, socket.SOCK_DGRAM)[0][4][0])
        except OSError as raised:
            error = raised
        except UnicodeError as raised:  # a label of more than 63 characters
            error = OSError(str(raised))
        with contextlib.suppress(RuntimeError):  # the loop is gone
            loop.call_soon_threadsafe(settle, address, error)

    threading.Thread(target=ask, name=f"look up {host}", daemon=True).start()
    return await answer
