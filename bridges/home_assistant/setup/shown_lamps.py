"""Lamps as the cards of a home show them: what they are, and how well they are placed."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from pointit.bridges.home_assistant.setup.home_files import sigmas_of
from pointit.bridges.home_assistant.setup.progress import SetupProgress
from pointit.bridges.home_assistant.setup.stored_setup import ChosenLamp
from pointit.scan.paced_model import MAX_DIRECTION_SIGMA_RAD
from pointit.schemas import HomeLamp
from pointit.schemas.base import MAX_ID
from pointit.schemas.home import HomeQuality
from pointit.schemas.text import one_line

if TYPE_CHECKING:
    from pointit.bridges.home_assistant.entities import HomeEntity

GOOD_SIGMA_RAD = math.radians(4.5)
"""Standard deviation of the angle to a lamp, up to which its direction is good."""


def shown_lamps(
    progress: SetupProgress,
    listed: Sequence[ChosenLamp],
    entities: "Sequence[HomeEntity]",
    state_of: Callable[[str], Mapping[str, Any]],
) -> tuple[HomeLamp, ...]:
    """Return lamps as the present card shows them.

    Args:
        progress: of the set-up.
        listed: lamps that the card lists.
        entities: as they were listed last.
        state_of: returns the newest state of an entity, or an empty one.
    """
    state = progress.state
    chosen = {lamp.id for lamp in state.lamps}
    listed_states = {entity.entity: entity.state for entity in entities}
    sigmas = sigmas_of(state.placed)
    unsure = {placed.lamp for placed in state.placed if placed.is_unsure}
    lamps: list[HomeLamp] = []
    for lamp in listed:
        entity_state = state_of(lamp.id)
        text = str(entity_state.get("state", listed_states.get(lamp.id, "")))
        pressed_from = {press.place for press in state.presses if press.lamp == lamp.id}
        lamps.append(
            HomeLamp(
                id=lamp.id,
                label=lamp.label,
                area=lamp.area,
                state=one_line(text, MAX_ID),
                is_chosen=lamp.id in chosen,
                is_new=bool(state.offered) and lamp.id not in state.offered,
                is_placed=lamp.id in sigmas,
                places=len(pressed_from),
                direction_sigma_rad=sigmas.get(lamp.id),
                reason=progress.reason_of(lamp.id),
                quality=quality_of(sigmas.get(lamp.id), is_unsure=lamp.id in unsure),
                kind=lamp.kind,
                is_met=lamp.id in state.met,
            )
        )
    return tuple(lamps)


def quality_of(sigma_rad: float | None, *, is_unsure: bool) -> HomeQuality:
    """Return how well the direction of a lamp is known. `""`: it was placed for a trial, or not."""
    if not sigma_rad:
        return ""
    if is_unsure or sigma_rad > MAX_DIRECTION_SIGMA_RAD:
        return "again"
    return "good" if sigma_rad <= GOOD_SIGMA_RAD else "fair"
