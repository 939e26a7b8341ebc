"""`pointit person press USER`: a person's button, for devices without one."""

import asyncio
import contextlib
from typing import Literal, cast

import click

from pointit.cli.common.output import json_option, print_json, say
from pointit.cli.common.site_link import PATIENCE_S, join_site, quiet, site_options
from pointit.diagnosis.writers import instance_of, split_instance
from pointit.runtime.bus.contract import Bus
from pointit.runtime.clock import SiteClock
from pointit.runtime.errors import NoAnswerError
from pointit.runtime.service.shutdown import run_until_shutdown
from pointit.schemas import ButtonEvent, Feedback, Interaction
from pointit.schemas.topics import BUTTON, FEEDBACK, INTERACTION, SERVICE_ALIVE, check_name

Gesture = Literal["press", "double", "hold"]

CUE_FIRST_S = 0.2
"""Time an Interaction may arrive after its cue; a refusal may have only a cue."""


@click.command("press", params=site_options())
@click.argument("user")
@click.option(
    "--gesture",
    type=click.Choice(["press", "double", "hold"]),
    default="press",
    show_default=True,
    help="press: start or stop; double: point at one lamp to correct the pose; hold: localize again",
)
@json_option
def command(user: str, *, gesture: str, as_json: bool, site: str, connect: tuple[str, ...]) -> int:
    """Press the button of the person USER, and print the resulting state and the next step.

    The exit code is 1 if that person has no supervisor.

    Example: pointit person press anna --gesture double
    """
    check_name(user, "user")
    quiet()
    return run_until_shutdown(
        _press(user, cast("Gesture", gesture), as_json=as_json, site=site, connect=connect)
    )


async def _press(user: str, gesture: Gesture, *, as_json: bool, site: str, connect: tuple[str, ...]) -> int:
    async with join_site(site, connect) as bus:
        if denied := await bus.denial_reason("writes", BUTTON, user):
            raise NoAnswerError(denied)
        answer = await press(bus, user, gesture)
    if as_json:
        print_json({"user": user, **answer.model_dump(include={"state", "reason", "next_step"})})
    else:
        say(f"{user}: {answer.state}. {answer.reason} {answer.next_step}".replace("  ", " "))
    return 0


async def press(bus: Bus, user: str, gesture: Gesture, patience_s: float = PATIENCE_S) -> Interaction:
    """Return the interaction after the gesture, changed or not.

    Raises:
        NoAnswerError: If `user` has no supervisor, or it does not reply within `patience_s`.
    """
    person = _Person(bus, user)
    clock = SiteClock(bus)
    button = bus.publisher(BUTTON, user)
    before = await person.first(patience_s)
    button.put(ButtonEvent(stamp_ns=clock.now_ns(), seq=1, gesture=gesture, source="keyboard"))
    after = await person.next(patience_s)
    if after is None and not (gesture == "double" and before.state == "idle"):
        raise NoAnswerError(
            f"{person.supervisor} did not answer within {patience_s:g} s; see `pointit doctor`"
        )
    return after or before


class _Person:
    """Follows one person's interaction."""

    def __init__(self, bus: Bus, user: str) -> None:
        self.supervisor = instance_of("supervisor", user)
        self._user = user
        self._present: set[str] = set()
        self._newest: Interaction | None = None
        self._is_cued = False
        self._changed = asyncio.Event()
        bus.watch(SERVICE_ALIVE, self._on_presence)
        bus.subscribe(INTERACTION, self._on_interaction, user)
        bus.subscribe(FEEDBACK, self._on_cue, user)

    async def first(self, patience_s: float) -> Interaction:
        """Return the interaction as soon as it and the supervisor are known."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(patience_s):
                while self._newest is None or self.supervisor not in self._present:
                    await self._change()
        if self._newest is None or self.supervisor not in self._present:
            raise NoAnswerError(f"{self._user} has no supervisor: {self._advice()}")
        return self._newest

    async def next(self, patience_s: float) -> Interaction | None:
        """Return the interaction after the next Interaction or cue, or None if neither arrives."""
        before, self._is_cued = self._newest, False
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(patience_s):
                while self._newest is before and not self._is_cued:
                    await self._change()
        if self._newest is before and self._is_cued:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._change(), CUE_FIRST_S)
        return None if self._newest is before and not self._is_cued else self._newest

    async def _change(self) -> None:
        self._changed.clear()
        await self._changed.wait()

    def _advice(self) -> str:
        people = sorted(
            user for service, user in map(split_instance, self._present) if service == "supervisor"
        )
        if self.supervisor in self._present:
            return f"{self.supervisor} is present but says nothing, see `pointit doctor`"
        there = f"there is {', '.join(people)}" if people else "there are no other people either"
        return f"{there}; add them with `pointit person add {self._user}`"

    def _on_presence(self, instance: str, here: bool) -> None:  # noqa: FBT001 - the bus's signature
        (self._present.add if here else self._present.discard)(instance)
        self._changed.set()

    def _on_interaction(self, interaction: Interaction, _user: str) -> None:
        self._newest = interaction
        self._changed.set()

    def _on_cue(self, cue: Feedback, _user: str) -> None:
        self._is_cued = self._is_cued or (cue.cue not in ("selected", "deselected") and cue.turn_rad is None)
        self._changed.set()
