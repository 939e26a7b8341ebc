"""Entities of a Home Assistant that people can point at, by area."""

from collections.abc import Mapping
from typing import Any, NamedTuple, cast

from pointit.bridges.home_assistant.connection import HomeAssistantConnection, is_list
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


async def entities_of(connection: HomeAssistantConnection) -> list[HomeEntity]:
    """Return the entities that people can point at, by area and name, without hidden and technical ones."""
    states = await connection.states()
    registry: dict[str, dict[str, Mapping[str, Any]]] = {}
    for kind, key in (("area", "area_id"), ("device", "id"), ("entity", "entity_id")):
        try:
            listed: object = await connection.request(f"config/{kind}_registry/list")
        except RefusedError:  # not for users without rights of an administrator
            listed = []
        entries = [
            cast("Mapping[str, Any]", each)
            for each in (listed if is_list(listed) else ())
            if isinstance(each, dict)
        ]
        registry[kind] = {str(each.get(key)): each for each in entries}
    entities: list[HomeEntity] = []
    for entity, state in states.items():
        entry = registry["entity"].get(entity, {})
        if entity.partition(".")[0] not in DOMAINS or entry.get("hidden_by") or entry.get("entity_category"):
            continue
        needed = NEEDED_FEATURES.get(entity.partition(".")[0], 0)
        features = state.get("attributes", {}).get("supported_features")
        if isinstance(features, int) and features & needed != needed:
            continue
        device = registry["device"].get(entry.get("device_id") or "", {})
        area = registry["area"].get(entry.get("area_id") or device.get("area_id") or "", {})
        name = state.get("attributes", {}).get("friendly_name") or entity
        entities.append(HomeEntity(area.get("name") or "", entity, str(name), str(state.get("state"))))
    return sorted(entities, key=lambda each: (each.area == "", each.area.casefold(), each.entity))
