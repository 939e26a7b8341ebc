"""Lamps that a card lists: those with an id that a message can have, and no more than fit into one. Pure."""

from collections.abc import Iterable, Sequence

from pointit.bridges.home_assistant.entities import HomeEntity
from pointit.schemas import encode
from pointit.schemas.base import MAX_ID
from pointit.schemas.home import MAX_SENTENCE, HomeLamp, HomeSetup
from pointit.schemas.text import one_line

MAX_ADVICE = 20
MAX_OFFERED = 4000
"""Maximum number of lamps that can be chosen from: `setup.json` has the ids of all of them."""
REST_BYTES = 256 * 1024
"""Room in a message for all but its lamps: 64 chosen ones with their reasons, and advice."""


def listable_entities(entities: Iterable[HomeEntity]) -> list[HomeEntity]:
    """Return the first `MAX_OFFERED` of `entities`, without those whose ids are too long for a message."""
    listable = [entity for entity in entities if len(entity.entity) <= MAX_ID]
    return listable[:MAX_OFFERED]


def fitting_lamps(lamps: Sequence[HomeLamp]) -> list[HomeLamp]:
    """Return the lamps of a card that fit into its message: the chosen ones, and as many others as can be."""
    room = HomeSetup.max_bytes - REST_BYTES
    fits: set[str] = set()
    for lamp in sorted(lamps, key=lambda lamp: not lamp.is_chosen):
        room -= len(encode(lamp))
        if room < 0:
            break
        fits.add(lamp.id)
    return [lamp for lamp in lamps if lamp.id in fits]


def unlisted_note(count: int) -> str:
    """Return a sentence on `count` lamps that are not listed."""
    return (
        f"{count} more lamps are not listed, as their ids are too long or there are too many: disable those "
        "that nobody points at in Home Assistant"
    )


def limited_advice(advice: Sequence[str]) -> tuple[str, ...]:
    """Return at most `MAX_ADVICE` sentences, each within its limit. The last one counts the rest."""
    shown = list(advice)
    if len(shown) > MAX_ADVICE:
        left_out = len(shown) - MAX_ADVICE + 1
        shown[MAX_ADVICE - 1 :] = [f"there are {left_out} more such sentences: deal with these first"]
    return tuple(one_line(sentence, MAX_SENTENCE) for sentence in shown)
