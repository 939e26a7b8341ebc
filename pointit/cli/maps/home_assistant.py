"""Entities of Home Assistant as things of a map."""

import asyncio
import os
import unicodedata
from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from pointit.bridges.home_assistant.config import HomeAssistantConfig
from pointit.bridges.home_assistant.connection import connected
from pointit.bridges.home_assistant.entities import HomeEntity, entities_of
from pointit.cli.common.output import OutputSection, print_file, say, show
from pointit.maps.edit import Add, edited, write_new
from pointit.maps.file import parse_map_file
from pointit.maps.light_files.strip_fit import free_name
from pointit.maps.model import MAX_LABEL
from pointit.runtime.config.config import Layers
from pointit.runtime.config.environment_variables import environment_prefix
from pointit.runtime.config.nearest_name import nearest
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import read_limited, replaced_file
from pointit.schemas.printable import is_printable

SOURCE = "home-assistant"
MAX_MAP_BYTES = 16 * 2**20


def import_entities(
    *,
    url: str,
    token_file: str,
    patterns: Sequence[str],
    areas: Sequence[str],
    into: Path | None,
    output: Path | None,
) -> None:
    """List the entities by area, or write those that `patterns` and `areas` choose as things.

    Raises:
        ConfigError: If there is no Home Assistant, a pattern fits no entity, or a file cannot be used.
    """
    # As of the service, from the environment and from options
    layers = Layers()
    layers.add_environment(os.environ, environment_prefix(SOURCE))
    for option, name, value in (("--url", "url", url), ("--token-file", "token_file", token_file)):
        if value:
            layers.add({name: value}, option)
    config = layers.build(HomeAssistantConfig)
    entities = asyncio.run(_read(config))
    if not patterns and not areas:
        rows = tuple(entity._asdict() for entity in entities)
        show([OutputSection(name="entities", about=f"of {config.url}", rows=rows)], as_json=False)
        say("choose some with --entity or --area, and a map with --into or -o", err=True)
        return

    # Into a map, whose text stays, or into a new one
    chosen = chosen_entities(entities, patterns, areas)
    if into is None:
        path = output or Path("things.yaml")
        content = b""
    else:
        path = into
        content = read_limited(into, MAX_MAP_BYTES)
    text, names = with_things(content, path, chosen)
    if into is not None:
        with replaced_file(into) as part:
            part.write_bytes(text)
    elif output is not None:
        write_new(output, text)
    else:
        print_file(text.decode())
    say(f"things without a position: {', '.join(names) or 'no new ones'}", err=True)
    if names:
        say(f"place them: pointit map point USER {' '.join(names)} --into {path}", err=True)


async def _read(config: HomeAssistantConfig) -> list[HomeEntity]:
    async with connected(config) as connection:
        reading = asyncio.create_task(connection.read())
        try:
            return await entities_of(connection)
        except (TimeoutError, asyncio.CancelledError):
            raise ConfigError(f"{config.url} does not answer: restart Home Assistant") from None
        finally:
            reading.cancel()
            await asyncio.gather(reading, return_exceptions=True)


def _folded(area: str) -> str:
    """Return a name as it is compared: letters with accents come composed or, from macOS, decomposed."""
    return unicodedata.normalize("NFC", area).casefold()


def chosen_entities(
    entities: Sequence[HomeEntity], patterns: Sequence[str], areas: Sequence[str]
) -> list[HomeEntity]:
    """Return the entities that one of `patterns` fits, such as `light.*`, and those in `areas`.

    Raises:
        ConfigError: If one fits none.
    """
    chosen: dict[str, HomeEntity] = {}
    by_id = {entity.entity: entity for entity in entities}
    for pattern in patterns:
        fitting = [entity_id for entity_id in by_id if fnmatchcase(entity_id, pattern)]
        if not fitting:
            raise ConfigError(f"--entity {pattern}: fits no entity; {nearest(pattern, by_id)}")
        chosen |= {entity_id: by_id[entity_id] for entity_id in fitting}
    for area in areas:
        inside = [entity for entity in entities if _folded(entity.area) == _folded(area)]
        if not inside:
            known = {entity.area for entity in entities} - {""}
            raise ConfigError(f"--area {area}: has no entities; {nearest(area, known)}")
        chosen |= {entity.entity: entity for entity in inside}
    return list(chosen.values())


def with_things(content: bytes, path: Path, entities: Sequence[HomeEntity]) -> tuple[bytes, list[str]]:
    """Return a map with a thing for each entity that it has not yet, and the names of these things.

    Raises:
        ConfigError: If `content` is no map.
        RefusedError: If its form does not allow to add them.
    """
    things = parse_map_file(content, path).things if content else {}
    known = {thing.home_assistant for thing in things.values()}
    adds: list[Add] = []
    for entity in entities:
        if entity.entity in known:
            continue
        own_name = entity.entity.partition(".")[2][:64]
        name = free_name(own_name, things, [add.name for add in adds])
        value: dict[str, Any] = {"home_assistant": entity.entity}
        can_be_label = is_printable(entity.name) and len(entity.name) <= MAX_LABEL
        if can_be_label and entity.name != name:
            value["label"] = entity.name
        adds.append(Add(section="things", name=name, value=value))
    return edited(content, adds, path), [add.name for add in adds]
