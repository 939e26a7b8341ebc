"""Addresses of this machine in its networks, by which others reach it."""

import ipaddress
import socket

_TOWARDS = ("192.0.2.1", "10.255.255.254", "172.31.255.254", "192.168.255.254", "169.254.255.254")
"""Destinations of route look-ups, the default route first: 192.0.2.1 is of no machine (RFC 5737)."""


def found_addresses() -> list[str]:
    """Return this machine's IPv4 addresses in networks it has routes to, that of the default route first.

    A UDP socket is connected, which sends nothing: it only makes the system choose an interface.
    """
    found: list[str] = []
    for towards in _TOWARDS:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.connect((towards, 9))
            except OSError:
                continue
            address: str = probe.getsockname()[0]
        if address not in found and is_reachable(address):
            found.append(address)
    return found


def own_address(otherwise: str) -> str:
    """Return the first of `found_addresses`, or `otherwise` if there is none."""
    return next(iter(found_addresses()), otherwise)


def is_reachable(address: str) -> bool:
    """Return True if other machines could reach `address`."""
    parsed = ipaddress.ip_address(address)
    return not (parsed.is_loopback or parsed.is_unspecified or parsed.is_multicast)
