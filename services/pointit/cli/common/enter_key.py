"""Waiting for a press of Enter."""

import asyncio

import click

from pointit.cli.common.keyboard import has_keyboard, keys
from pointit.cli.common.lazy import UnknownNameError


def check_keyboard(otherwise: str) -> None:
    """Check that Enter can be pressed.

    Raises:
        UnknownNameError: If there is no keyboard; `otherwise` is the option that needs none.
    """
    if not has_keyboard():
        raise UnknownNameError(f"there is no keyboard to press Enter on; use {otherwise}")


async def wait_for_enter(text: str, otherwise: str) -> None:
    """Print `text` and wait for Enter or Space.

    Raises:
        UnknownNameError: If there is no keyboard; `otherwise` is the option that needs none.
    """
    check_keyboard(otherwise)
    click.echo(text, err=True)
    pressed = asyncio.Event()
    with keys(pressed.set):
        await pressed.wait()
