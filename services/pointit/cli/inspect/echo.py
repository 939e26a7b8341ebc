"""`pointit topic echo KEY`: messages as they arrive."""

import asyncio
import contextlib
import functools
from typing import Unpack

import click

from pointit.cli.common.output import json_option, to_json, to_line, write_line
from pointit.cli.common.site_link import AtSite, join_site, quiet, site_options
from pointit.cli.inspect.topic_names import Wanted, resolve
from pointit.diagnosis.writers import silence_reason
from pointit.runtime.service.shutdown import run_until_shutdown
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Message
from pointit.schemas.topics import ANY, SERVICE_ALIVE, Delivery, Topic

SILENCE_S = 2.0
"""Time without a message after which a notice is printed."""


@click.command("echo", params=site_options())
@click.argument("key")
@click.option("--count", type=click.IntRange(min=1), help="number of messages to print before exit")
@json_option
def command(key: str, *, count: int | None, as_json: bool, **at: Unpack[AtSite]) -> int:
    """Print the messages on KEY as they arrive, one per line.

    KEY is users/anna/imu, or for all users 'users/*/imu' or users/{user}/imu; 'users/anna/*' is all of
    anna's. Lines are YAML; with --json objects whose first field is the key, bytes as hexadecimal text.
    Ctrl-C ends it with exit code 0.

    Example: pointit topic echo 'users/*/cursor' --count 3
    """
    wanted = resolve(key)
    quiet()
    return run_until_shutdown(_echo(key, wanted, count, as_json=as_json, **at))


async def _echo(
    key: str, wanted: list[Wanted], count: int | None, *, as_json: bool, **at: Unpack[AtSite]
) -> int:
    loop = asyncio.get_running_loop()
    async with join_site(**at) as bus:
        printer = _Printer(count, as_json=as_json)
        present = _presence(bus)
        for topic, name in wanted:
            bus.subscribe(topic, functools.partial(printer.show, topic), name or ANY)
        printed_s: float | None = None
        while not printer.done.is_set():
            wait_s = printer.newest_s + SILENCE_S - loop.time()
            if wait_s <= 0:
                if printed_s != printer.newest_s:
                    printed_s = printer.newest_s
                    _tell_silence(key, wanted, present, any_yet=printer.shown > 0)
                wait_s = SILENCE_S
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(wait_s):
                    await printer.done.wait()
    return 0


class _Printer:
    """Prints messages until `count` is reached or the reader of the pipe is gone."""

    def __init__(self, count: int | None, *, as_json: bool) -> None:
        self._now_s = asyncio.get_running_loop().time
        self.done = asyncio.Event()
        self.shown = 0
        self.newest_s = self._now_s()
        """Time of the newest message, or of the start."""
        self._count = count
        self._as_json = as_json

    def show(self, topic: Topic[Message], message: Message, name: str) -> None:
        if self.done.is_set():
            return
        if not write_line(format_message(topic.at(name), message, as_json=self._as_json)):
            self.done.set()
            return
        self.shown += 1
        self.newest_s = self._now_s()
        if self._count is not None and self.shown >= self._count:
            self.done.set()


def format_message(key: str, message: Message, *, as_json: bool) -> str:
    """Return `message` on one line, as YAML or as a JSON object that starts with the key."""
    fields = message.model_dump()
    if as_json:
        return to_json({"key": key, **fields})
    return f"{key}: {to_line(fields)}"


def _presence(bus: ZenohBus) -> set[str]:
    present: set[str] = set()

    def on_change(instance: str, here: bool) -> None:  # noqa: FBT001 - the bus's signature
        (present.add if here else present.discard)(instance)

    bus.watch(SERVICE_ALIVE, on_change)
    return present


def _tell_silence(key: str, wanted: list[Wanted], present: set[str], *, any_yet: bool) -> None:
    """Print a notice to standard error; topics that change rarely may be silent after a message."""
    if any_yet and all(topic.delivery is not Delivery.LATEST for topic, _ in wanted):
        return
    more = " more" if any_yet else ""
    if len(wanted) == 1:
        reason = silence_reason(*wanted[0], present)
    else:
        reason = f"present: {', '.join(sorted(present)) or 'no service'}"
    click.echo(f"waiting: nothing{more} on {key} for {SILENCE_S:g} s; {reason}", err=True)
