"""Runs actions of a Home Assistant when people point at things, and shows its states."""

import asyncio
import bisect
import contextlib
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from pointit.bridges.home_assistant.announcer import VOICES, HomeAnnouncer
from pointit.bridges.home_assistant.config import HomeAssistantConfig
from pointit.bridges.home_assistant.connection import (
    HomeAssistantConnection,
    LoginError,
    NoHomeAssistantError,
    connected,
    is_state,
    require_client,
)
from pointit.bridges.home_assistant.entity_commands import EntityCommands
from pointit.bridges.home_assistant.home_action import UNAVAILABLE, HomeAction
from pointit.runtime.config.nearest_name import did_you_mean
from pointit.runtime.errors import ConfigError, RefusedError, RequestError
from pointit.runtime.host.state_file import expand_home
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import Environment, Hover, Selection, SelectionEvent, SetThing
from pointit.schemas.environment import Thing
from pointit.schemas.selection import REPEATED_REASON
from pointit.schemas.topics import ANNOUNCED, HOVER, MAP, SELECTION, SELECTION_EVENTS, SET_THING

USER = "home-assistant"
"""Name by which it switches things."""
FIRST_REPLY_S = 3.0
"""Time after the login within which Home Assistant states everything, s."""
RETRY_S = 2.0
"""Pause before the next connection, s."""
CHECK_PERIOD_S = 0.5
SETTLE_S = 3.0
"""Time for an entity to reach the state of its thing, s. Then the thing gets the state of the entity."""
MAX_HOVER_AGE_S = 1.0
"""Time without a message after which nobody hovers, s. There are 5 a second at least."""
MIN_PERIOD_S = 0.05
"""Time between two answers to changes in Home Assistant, s: a lamp may flap."""
MAX_NAMES = 10
"""Number of entities that a warning names."""
MAX_CANDIDATES = 300
"""Number of names that are compared with one that is not there: its neighbours by the alphabet."""
MAX_VOICES = 100
"""Number of text-to-speech entities whose states are known."""


class HomeAssistant(Service[HomeAssistantConfig]):
    """Switches the entities of things that people point at, and the things when their entities change."""

    NAME: ClassVar[str] = "home-assistant"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = HomeAssistantConfig
    TIME_MAY_STEP: ClassVar[bool] = True

    def __init__(self, config: HomeAssistantConfig, context: Context) -> None:
        """Prepare; nothing is connected yet. Raises ConfigError as `validate_config`."""
        super().__init__(config, context)
        self.validate_config(config)
        self._loop = asyncio.get_running_loop()
        self._things: dict[str, tuple[Thing, HomeAction]] = {}
        self._entities: set[str] = set()
        """Entities of things, and those that speak."""
        self._states: dict[str, Mapping[str, Any]] = {}
        """States in Home Assistant of the entities that are used, by entity."""
        self._names: Collection[str] = ()
        """Names of all entities, when they were read."""
        self._new_names: dict[str, str] = {}
        """New names of entities that were renamed."""
        self._hints: dict[str, str] = {}
        """Names that are similar to one that is not there."""
        self._should_read = False
        """There are things whose entities have not been read."""
        self._has_changed = asyncio.Event()
        self._changed: dict[str, bool] = {}
        """Things whose entities have changed, True if these had no state before."""
        self._selected: set[str] | None = None
        self._hovers: dict[str, tuple[str, float]] = {}
        """Hovered thing of each person, and the time of the message."""
        self._targets: dict[str, tuple[bool, float]] = {}
        """State that each switched entity shall reach, and until when."""
        self._announcer = HomeAnnouncer(config, self.bus, self._states)
        self._commands = EntityCommands(
            config, self.bus, lambda entity: self._states.get(entity, {}), self._hovered_entities
        )
        self.bus.subscribe(MAP, self._on_map)
        self.bus.subscribe(SELECTION, self._on_selection)
        self.bus.subscribe(SELECTION_EVENTS, self._on_event)
        if config.hover:
            self.bus.subscribe(HOVER, self._on_hover)
        if config.speaker:
            self.bus.subscribe(ANNOUNCED, self._announcer.on_announced)

    @classmethod
    def validate_config(cls, config: HomeAssistantConfig) -> None:
        """Check that a Home Assistant and a token are named. Raises ConfigError."""
        require_client()
        config.check()
        config.read_token()

    async def run(self) -> None:
        """Stay connected until cancelled."""
        while True:
            try:
                await self._serve()
            except LoginError as error:
                self.bus.warn("connection", str(error))
                await self._wait_for_new_token()
            except (NoHomeAssistantError, ConfigError, RefusedError, TimeoutError) as error:
                self.bus.warn("connection", str(error) or f"{self.config.url} does not answer: restart it")
                await asyncio.sleep(RETRY_S)

    async def _wait_for_new_token(self) -> None:
        """Wait for another token: with the same one Home Assistant blocks this machine in the end."""
        path = expand_home(self.config.token_file)
        rejected = await asyncio.to_thread(_content, path)
        while await asyncio.to_thread(_content, path) == rejected:  # noqa: ASYNC110 - a file
            await asyncio.sleep(RETRY_S)

    async def _serve(self) -> None:
        async with connected(self.config) as connection:
            reading = asyncio.create_task(connection.read(), name="messages of Home Assistant")
            tasks = {
                reading,
                asyncio.create_task(self._follow(connection), name="states of Home Assistant"),
                asyncio.create_task(self._announcer.speak(connection), name="names for Home Assistant"),
            }
            try:
                done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
                await (reading if reading in done else done.pop())
            finally:
                for task in tasks - {reading}:
                    task.cancel()
                try:
                    await self._commands.close(connection, is_lost=reading.done())
                finally:  # also if this is cancelled once more
                    reading.cancel()
                    await asyncio.gather(*tasks, return_exceptions=True)
                    self._targets.clear()

    async def _follow(self, connection: HomeAssistantConnection) -> None:
        """Read all states, then give things the states of their entities, except while these change."""
        self._states.clear()
        self._hints.clear()
        silent = f"{self.config.url} accepts the token and then says nothing: restart Home Assistant"
        silence = self.bus.call_later(FIRST_REPLY_S, lambda: self.bus.warn("connection", silent))
        try:
            await connection.subscribe("state_changed", self._on_state_changed)
            with contextlib.suppress(RefusedError):  # of an old version
                await connection.subscribe("entity_registry_updated", self._on_registry)
            await self._read_states(connection)
        finally:
            silence.cancel()
        self._commands.open(connection, self._states)
        self.bus.clear("connection")
        differs_since: dict[str, float] = {}
        known: set[str] = set()
        while True:
            if self._should_read:
                await self._read_states(connection)
            changed, self._changed = self._changed, {}
            for name, is_restored in changed.items():
                if name in self._differing():
                    await self._set_thing(name, is_restored=is_restored)
            now_s, differing = self._loop.time(), self._differing()
            # what differs at first has been so before the connection: it does not settle
            begin_s = {name: now_s if name in known else now_s - SETTLE_S for name in differing}
            differs_since = {name: differs_since.get(name, begin_s[name]) for name in differing}
            for name in differing:
                if now_s - differs_since[name] >= SETTLE_S:
                    differs_since[name] = now_s
                    await self._set_thing(name, is_restored=True)
            if self._selected is not None:
                known |= self._things.keys()
            self._commands.check()
            await self._report_entities()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(CHECK_PERIOD_S):
                    await self._has_changed.wait()
            await asyncio.sleep(MIN_PERIOD_S)
            self._has_changed.clear()

    async def _read_states(self, connection: HomeAssistantConnection) -> None:
        """Read the states of the entities that are used, and the names of all."""
        self._should_read = False
        states = await connection.states()
        self._names = states.keys()
        used = {name: each for name, each in states.items() if self._is_used(name)}
        self._states |= used | self._states  # events since the request are newer

    def _is_used(self, entity: str) -> bool:
        """Return True if the state of an entity matters here."""
        if entity in self._entities or entity in self._commands.dimmed:
            return True
        if not entity.startswith(VOICES):
            return False
        return entity in self._states or sum(each.startswith(VOICES) for each in self._states) < MAX_VOICES

    def _differing(self) -> list[str]:
        """Return the switches that are not in the state of their entity, which is not about to change."""
        return [
            name
            for name, (thing, action) in self._things.items()
            if thing.mode == "switch"
            and self._selected is not None
            and self._target(action.entity) is None
            and (is_on := self._is_on(action)) is not None
            and is_on != (name in self._selected)
        ]

    def _target(self, entity: str) -> bool | None:
        """Return the state that an entity was switched to a moment ago, or None."""
        is_on, until_s = self._targets.get(entity, (None, 0.0))
        return is_on if until_s > self._loop.time() else None

    def _is_on(self, action: HomeAction) -> bool | None:
        return action.is_on(self._states.get(action.entity, {}).get("state"))

    async def _set_thing(self, name: str, *, is_restored: bool) -> None:
        """Give the thing `name` the state of its entity. If it is not there yet, a later call does."""
        on = self._is_on(self._things[name][1]) if name in self._things else None
        if on is not None:
            with contextlib.suppress(RequestError):
                await self.bus.call(SET_THING, SetThing(thing=name, on=on, is_restored=is_restored), USER)

    def _on_map(self, environment: Environment, _name: str) -> None:
        self._things = {
            thing.id: (thing, HomeAction.parse(thing.home_assistant))
            for thing in environment.things
            if thing.home_assistant
        }
        self._announcer.use(environment.things)
        self._entities = {action.entity for _thing, action in self._things.values()}
        self._entities |= {self.config.speaker, self.config.voice} - {""}
        self._should_read = True
        self._has_changed.set()

    def _on_selection(self, selection: Selection, _name: str) -> None:
        self._selected = {each.id for each in selection.objects}

    def _on_event(self, event: SelectionEvent, _name: str) -> None:
        thing, action = self._things.get(event.object_id, (None, None))
        is_old = event.user == USER or event.reason.endswith(REPEATED_REASON)
        if thing is None or action is None or is_old or not event.is_reaction(thing.mode):
            return
        # what is pointed at without a connection would happen long after
        if not self._commands.is_connected or self._is_unavailable(action.entity):
            return
        target = self._target(action.entity)
        is_on = self._is_on(action) if target is None else target
        on: bool | None = None  # run it, or toggle what has an unknown state
        if thing.mode == "switch":
            on = event.is_on
            if is_on is on and not action.action:
                return
        elif is_on is not None and not action.action:
            on = not is_on
        if on is not None:
            self._targets[action.entity] = (on, self._loop.time() + SETTLE_S)
        self._commands.send(action.call(on=on), f"`home_assistant` of thing {thing.id} in the map")

    def _on_hover(self, hover: Hover, user: str) -> None:
        before = self._hovers.get(user, ("", 0.0))[0]
        self._hovers[user] = (hover.object_id, self._loop.time())
        for name in {before, hover.object_id} & self._things.keys() if before != hover.object_id else ():
            self._commands.wake(self._things[name][1].entity)

    def _hovered_entities(self) -> set[str]:
        oldest_s = self._loop.time() - MAX_HOVER_AGE_S
        names = {name for name, received_s in self._hovers.values() if received_s >= oldest_s}
        return {action.entity for name, (_thing, action) in self._things.items() if name in names}

    def _on_state_changed(self, data: Mapping[str, Any]) -> None:
        entity, state = data.get("entity_id"), data.get("new_state")
        if not isinstance(entity, str) or not self._is_used(entity):
            return
        before = self._states.pop(entity, {})
        if is_state(state):
            self._states[entity] = state
        self._commands.on_state(entity, before, self._states.get(entity, {}))
        if before.get("state") == self._states.get(entity, {}).get("state"):
            return
        for name, (_thing, action) in self._things.items():
            if action.entity == entity:
                was_on, is_on = action.is_on(before.get("state")), self._is_on(action)
                if is_on is not None and self._target(entity) is is_on:
                    self._targets.pop(entity)  # reached
                if was_on is not is_on:
                    self._changed[name] = was_on is None
        self._has_changed.set()

    def _on_registry(self, data: Mapping[str, Any]) -> None:
        before, after = data.get("old_entity_id"), data.get("entity_id")
        if before in self._entities and isinstance(before, str) and isinstance(after, str):
            self._new_names[before] = after
            self._has_changed.set()

    async def _hint(self, entity: str) -> str:
        """Return the new name of an entity that is not there, or similar names, or `""`.

        Everybody on the site can read it, so it lists no other entities of the home.
        """
        if entity in self._new_names:
            return f"now {self._new_names[entity]}"
        if entity not in self._hints:
            self._hints[entity] = await asyncio.to_thread(_similar_names, entity, self._names)
        return self._hints[entity]

    def _is_unavailable(self, entity: str) -> bool:
        return bool(self._states.get(entity, {}).get("state", UNAVAILABLE) == UNAVAILABLE)

    async def _report_entities(self) -> None:
        """Report entities that do not exist or are unavailable, by name."""
        uses = [(action.entity, f"of thing {name}") for name, (_thing, action) in self._things.items()]
        uses += [(each, "that speaks") for each in (self.config.speaker, self.config.voice) if each]
        missing: list[str] = []
        unavailable: list[str] = []
        for entity, use in uses:
            if entity not in self._states:
                hint = "" if len(missing) > MAX_NAMES else await self._hint(entity)
                missing.append(f"{entity} {use}" + (f" ({hint})" if hint else ""))
            elif self._is_unavailable(entity):
                unavailable.append(f"{entity} {use}")
        self._announcer.report_voice()
        names = _listed(missing)
        remedy = "correct `home_assistant` in the map or site"
        self.bus.warn("entities", names and f"not in Home Assistant: {names}; {remedy}")
        names = _listed(unavailable)
        remedy = "look into the integration there"
        self.bus.warn("unavailable", names and f"unavailable in Home Assistant: {names}; {remedy}")


def _similar_names(entity: str, names: Collection[str]) -> str:
    domain = entity.partition(".")[0] + "."
    alike = sorted(each for each in names if each.startswith(domain))
    middle = bisect.bisect(alike, entity)
    return did_you_mean(entity, alike[max(middle - MAX_CANDIDATES // 2, 0) : middle + MAX_CANDIDATES // 2])


def _listed(entries: Sequence[str]) -> str:
    more = f" and {len(entries) - MAX_NAMES} more" if len(entries) > MAX_NAMES else ""
    return ", ".join(entries[:MAX_NAMES]) + more


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:
        return b""


SERVICE = HomeAssistant
