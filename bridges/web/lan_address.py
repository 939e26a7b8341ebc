"""Address of this machine at which the page listens in the local network. Loads no server."""

import ipaddress

from pointit.runtime.address_config import parse_address
from pointit.runtime.errors import ConfigError


def choose_address(configured: str, addresses: list[str]) -> str:
    """Return the address to listen at: `configured`, or the first of this machine's `addresses`.

    Raises:
        ConfigError: If `configured` is none of a machine, or it is empty and there are no `addresses`.
    """
    if not configured:
        if not addresses:
            raise ConfigError(
                "this machine has no address in a local network: connect it to one, or name its "
                "address, as in --set web.lan_address=192.168.1.20"
            )
        return addresses[0]

    # One that is written down must be an address alone: browsers compare it with the certificate
    try:
        host, port = parse_address(configured)
        parsed = ipaddress.ip_address(host)
    except ValueError as error:
        raise ConfigError(
            f"lan_address: {configured!r} is not an address; write it like 192.168.1.20, or leave it empty"
        ) from error
    if port is not None:
        raise ConfigError(f"lan_address: {configured!r} has a port; write {host}, and lan_port: {port}")
    if parsed.is_unspecified or parsed.is_multicast:
        raise ConfigError(
            f"lan_address: {configured} is not the address of one machine; "
            "write one of this machine's, or leave it empty"
        )
    return str(parsed)
