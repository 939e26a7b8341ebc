"""Entities of a Home Assistant that people can point at, by area.

No core: it logs what it leaves out.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple, cast

from pointit.bridges.home_assistant.home_connection import HomeConnection, is_list
from pointit.runtime.errors import RefusedError

DOMAINS = ("light", "switch", "cover", "fan", "media_player", "scene", "script", "input_boolean")
"""Domains of entities that people point at."""
NEEDED_FEATURES = {"cover": 1 | 2, "media_player": 128 | 256}
"""Bits of `supported_features` of entities that can be switched on and off, such as opened and closed."""


class HomeEntity(NamedTuple):
    """An entity of Home Assistant as its user knows it."""

    area: str
    entity: str
    name: str
    state: str
    device_class: str = ""
    icon: str = ""


async def entities_of(connection: HomeConnection) -> list[HomeEntity]:
    """Return the entities that people can point at, by area and name, without hidden and technical ones."""
    states = await connection.states()
    areas = await _registry(connection, "area", "area_id")
    devices = await _registry(connection, "device", "id")
    entries = await _registry(connection, "entity", "entity_id")

    entities: list[HomeEntity] = []
    for entity, state in states.items():
        domain, _, _ = entity.partition(".")
        entry = entries.get(entity, {})
        if domain not in DOMAINS or not _can_be_switched(state, domain):
            continue
        if entry.get("hidden_by") or entry.get("entity_category"):
            continue

        # An entity may have an area of its own, or that of its device
        device = devices.get(entry.get("device_id") or "", {})
        area_id = entry.get("area_id") or device.get("area_id") or ""
        area = areas.get(area_id, {}).get("name") or ""
        attributes = state.get("attributes", {})
        name = attributes.get("friendly_name") or entity
        entities.append(
            HomeEntity(
                area,
                entity,
                str(name),
                str(state.get("state")),
                device_class=str(attributes.get("device_class") or ""),
                icon=str(attributes.get("icon") or ""),
            )
        )
    return sorted(entities, key=_order)


async def _registry(connection: HomeConnection, kind: str, id_key: str) -> dict[str, Mapping[str, Any]]:
    """Return the entries of a registry of Home Assistant by id, none without the right to read it."""
    try:
        reply: object = await connection.request(f"config/{kind}_registry/list")
    except RefusedError:  # not for users without rights of an administrator
        return {}
    entries: dict[str, Mapping[str, Any]] = {}
    for value in reply if is_list(reply) else ():
        if isinstance(value, dict):
            entry = cast("Mapping[str, Any]", value)
            entries[str(entry.get(id_key))] = entry
    return entries


def _can_be_switched(state: Mapping[str, Any], domain: str) -> bool:
    """Return True unless the entity says that it lacks features that are needed."""
    needed = NEEDED_FEATURES.get(domain, 0)
    features = state.get("attributes", {}).get("supported_features")
    return not isinstance(features, int) or features & needed == needed


def _order(entity: HomeEntity) -> tuple[bool, str, str]:
    return (entity.area == "", entity.area.casefold(), entity.entity)
