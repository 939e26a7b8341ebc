"""IPv4 addresses of this machine's network interfaces, as reported by Linux."""

import socket
import struct
import sys

_GET_ADDRESS = 0x8915
"""SIOCGIFADDR of Linux (netdevice(7)): address of an interface."""
_GET_FLAGS = 0x8913
"""SIOCGIFFLAGS: flags of an interface."""
_REQUEST = struct.Struct("16s24s")
"""`struct ifreq`: name, then the answer."""
_UP_AND_RUNNING = 0x41
"""IFF_UP and IFF_RUNNING: switched on, and with a link."""


def interface_addresses() -> list[str]:
    """Return the IPv4 address of each interface that is up and has a link, in the system's order.

    An interface has one here, its first. Systems other than Linux have other calls: the list is empty there.
    """
    if sys.platform != "linux":
        return []
    addresses: list[str] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        for _, name in socket.if_nameindex():
            address = _address_of(probe, name)
            if address and address not in addresses:
                addresses.append(address)
    return addresses


def _address_of(probe: socket.socket, interface: str) -> str:
    """Return the address of an interface, or `""` if it has none or is off."""
    import fcntl  # noqa: PLC0415 - Unix has it, Windows has not

    request = _REQUEST.pack(interface.encode(), b"")
    try:
        flags_answer = fcntl.ioctl(probe, _GET_FLAGS, request)
        address_answer = fcntl.ioctl(probe, _GET_ADDRESS, request)
    except OSError:  # it has no IPv4 address, or has just gone
        return ""
    (flags,) = struct.unpack_from("H", flags_answer, 16)
    if flags & _UP_AND_RUNNING != _UP_AND_RUNNING:
        return ""
    # behind the name stands a `sockaddr_in`: family and port of 2 bytes each, then the address
    return socket.inet_ntoa(address_answer[20:24])
