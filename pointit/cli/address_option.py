"""Value of an option that is a network address."""

import click

from pointit.runtime.address_config import parse_address


def host_port(_ctx: click.Context, _parameter: click.Parameter, text: str | None) -> tuple[str, int] | None:
    """Return host and port of `text`, an IPv6 address in brackets, or None without a text.

    Raises:
        click.BadParameter: If it is anything else.
    """
    if text is None:
        return None
    try:
        host, port = parse_address(text)
    except ValueError as error:
        raise click.BadParameter(str(error)) from error
    if port is None:
        raise click.BadParameter(f"{text!r} has no port; write an address such as 127.0.0.1:9464")
    return host, port
