"""Light for things: colours by name, and questions that a person answers by a press."""

import asyncio
import contextlib
from collections.abc import Sequence

from pointit.api.requests import HEX
from pointit.api.site import Site
from pointit.assistants.results import AnswerByLight, Item, check_present
from pointit.errors import PointItError, SchemaError
from pointit.schemas import NS_PER_S, ButtonEvent
from pointit.schemas.topics import BUTTON
from pointit.services.listener.referents import REACTION_S

COLORS = {
    "red": "#ff1e00",
    "orange": "#ff7800",
    "yellow": "#ffc814",
    "green": "#009e50",
    "blue": "#0050dc",
    "purple": "#be50aa",
    "white": "#ffffff",
    "warm white": "#ffc58f",
    "cold white": "#d6e4ff",
}
"""Colours that have a name."""
ASKING: tuple[str, ...] = ("orange", "blue", "white", "purple")
"""Colours of the candidates of a question, in turn: told apart by colour-blind people, too."""
TURN_S = 1.5
"""Time for which a candidate is lit, s. Slower than flashes that can cause seizures."""
GIVE_BACK_S = 2.0
"""Time limit of giving lamps back, s."""


def color_of(text: str) -> str | None:
    """Return `#rrggbb` of a colour, or None of `off`, which gives the lamp back to the site.

    Raises:
        SchemaError: If it is neither `#rrggbb` nor a name of `COLORS`.
    """
    name = text.strip().lower()
    if name == "off":
        return None
    if HEX.fullmatch(name):
        return name
    if name in COLORS:
        return COLORS[name]
    raise SchemaError(f"{text!r} is no colour: write #rrggbb, off, or one of {', '.join(COLORS)}")


class Lights:
    """Lamps that assistants have set, so that a question gives them back as they were."""

    def __init__(self) -> None:
        self._shown: dict[str, str] = {}
        self._asked = set[str]()
        """People who are being asked."""
        self._giving = set[asyncio.Task[None]]()
        """Lamps that are given back although the question was cancelled."""

    async def show(self, site: Site, item: Item, color: str | None) -> str:
        """Light the lamp of `item`. Return what was done.

        Raises:
            PointItError: If it has no lamp, or the site refuses.
        """
        lamp = _lamp_of(item)
        reply = await site.lamp(lamp).set(color)
        self._shown.pop(lamp, None)
        if color is not None:
            self._shown[lamp] = color
        return reply.message

    async def ask(self, site: Site, user: str, candidates: Sequence[Item], timeout_s: float) -> AnswerByLight:
        """Light the candidates in turn until `user` presses their button. Then lamps are as before.

        Raises:
            PointItError: If they are not there or are being asked, or two candidates have no own lamp.
        """
        await check_present(site, user)
        lamps = {item.name: _lamp_of(item) for item in candidates}
        if len(set(lamps.values())) < len(candidates):
            raise PointItError(
                "two candidates have the same lamp, so light cannot tell them apart: ask in words"
            )
        shown: dict[str, str] = dict(zip(lamps, ASKING, strict=False))
        if user in self._asked:
            raise PointItError(f"{user!r} is being asked by light: wait for the answer")

        # One candidate after the other, again and again. A late press is for the one before.
        presses = site.messages(BUTTON, user)
        self._asked.add(user)
        turns: list[tuple[int, str]] = []
        try:
            async with asyncio.timeout(timeout_s):
                while True:
                    for name, lamp in lamps.items():
                        await site.lamp(lamp).set(COLORS[shown[name]])
                        turns.append((site.now_ns(), name))
                        async for event in presses.during(TURN_S):
                            chosen = _candidate_lit_at(event, turns)
                            if chosen:
                                return AnswerByLight(chosen=chosen, shown=shown)
                        await self._give_back(site, lamp)
        except TimeoutError:
            return AnswerByLight(chosen="", shown=shown)
        finally:
            # In a task, so that lamps are given back even if the question is cancelled once more
            presses.close()
            giving = asyncio.create_task(self._give_all_back(site, list(lamps.values())), name="lamps back")
            self._giving.add(giving)
            giving.add_done_callback(self._giving.discard)
            giving.add_done_callback(lambda _: self._asked.discard(user))
            await asyncio.shield(giving)

    async def _give_all_back(self, site: Site, lamps: Sequence[str]) -> None:
        with contextlib.suppress(PointItError, TimeoutError):
            async with asyncio.timeout(GIVE_BACK_S):
                for lamp in lamps:
                    await self._give_back(site, lamp)

    async def _give_back(self, site: Site, lamp: str) -> None:
        await site.lamp(lamp).set(self._shown.get(lamp))


def _lamp_of(item: Item) -> str:
    if not item.lamp:
        raise PointItError(f"{item.kind} {item.name!r} has no lamp, and none is near it: ask in words")
    return item.lamp


def _candidate_lit_at(event: ButtonEvent, turns: Sequence[tuple[int, str]]) -> str:
    """Return the candidate that was lit when the person decided to press, or `""`."""
    decided_ns = event.stamp_ns - round(REACTION_S * NS_PER_S)
    lit = [name for since_ns, name in turns if since_ns <= decided_ns]
    if not lit or event.gesture != "press":
        return ""
    return lit[-1]
