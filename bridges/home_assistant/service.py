"""Runs actions of a Home Assistant when people point at things, and shows its states."""

import asyncio
import bisect
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

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
from pointit.bridges.home_assistant.entity_commands import EntityCommands, replaced_act
from pointit.bridges.home_assistant.home_action import SLOW_DOMAINS, UNAVAILABLE, HomeAction
from pointit.runtime.clock import wait_up_to
from pointit.runtime.config.nearest_name import did_you_mean
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.host.state_file import expand_home
from pointit.runtime.service.carrier import Act, ActFailedError, Carrier
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import Environment, HomeSetup, Hover, SetUpHome, ThingState
from pointit.schemas.environment import Thing
from pointit.schemas.text import first_of, one_line
from pointit.schemas.topics import ANNOUNCED, HOVER, MAP, SET_UP_HOME

if TYPE_CHECKING:  # loads the fit of a map, which few runs need
    from pointit.bridges.home_assistant.setup.setup_session import SetupSession

FIRST_REPLY_S = 3.0
"""Time after the login within which Home Assistant states everything, s."""
RETRY_S = 2.0
"""Pause before the next connection, s."""
CHECK_PERIOD_S = 0.5
SLOW_LIMIT_S = 60.0
"""Time for an entity of a slow domain to follow, s."""
RESULT_MARGIN_S = 0.5
"""Time between the cause of a failure and the limit of its act, s."""
MAX_REASON = 500
MAX_HOVER_AGE_S = 1.0
"""Time without a message after which nobody hovers, s. There are 5 a second at least."""
MIN_PERIOD_S = 0.2
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
        self._hints: dict[str, str] = {}
        """Names that are similar to one that is not there."""
        self._should_read = False
        """There are things whose entities have not been read."""
        self._change = asyncio.Event()
        """Set by the next change in Home Assistant. Each change has its own."""
        self._problem = "Home Assistant is not connected yet: wait"
        """Cause for which nothing can be switched, or `""`."""
        self._is_starting = False
        """Home Assistant has not loaded everything yet: entities may be missing until it has."""
        self._acts: dict[str, Act] = {}
        """Newest act on each entity that is being carried out."""
        self._hovers: dict[str, tuple[str, float]] = {}
        """Hovered thing of each person, and the time of the message."""
        self._announcer = HomeAnnouncer(config, self.bus, self._states)
        self._commands = EntityCommands(
            config, self.bus, lambda entity: self._states.get(entity, {}), self._hovered_entities
        )
        self._carrier = Carrier(self.bus, self.clock, self.NAME)
        self._setup: SetupSession | None = self._make_setup(config)
        self.bus.serve(SET_UP_HOME, self._on_set_up)
        self.bus.subscribe(MAP, self._on_map)
        if config.hover:
            self.bus.subscribe(HOVER, self._on_hover)
        if config.speaker:
            self.bus.subscribe(ANNOUNCED, self._announcer.on_announced)

    @classmethod
    def validate_config(cls, config: HomeAssistantConfig) -> None:
        """Check that a Home Assistant and a token are named. Raises ConfigError."""
        require_client()
        if config.setup:  # its cards ask for both
            return
        config.check()
        config.read_token()

    def _make_setup(self, config: HomeAssistantConfig) -> "SetupSession | None":
        """Return the set-up of a home, or None if this run has none. Raises ConfigError."""
        if not config.setup:
            return None
        from pointit.bridges.home_assistant.setup.setup_session import SetupSession  # noqa: PLC0415 - see above

        return SetupSession(
            expand_home(config.setup),
            self.bus,
            state_of=lambda entity: self._states.get(entity, {}),
            wake=self._commands.wake,
        )

    async def _on_set_up(self, query: SetUpHome, _name: str) -> HomeSetup:
        """Answer a card of the set-up. Raises RefusedError."""
        if self._setup is None:
            raise RefusedError("this run sets up no home: start `pointit home`")
        reply = await self._setup.act(query, self._problem)
        if not self._setup.entities <= self._states.keys():
            self._should_read = True
            self._announce_change()
        return reply

    async def run(self) -> None:
        """Stay connected until cancelled."""
        try:
            while True:
                await self._await_address()
                try:
                    await self._serve()
                except LoginError as error:
                    self._lose(str(error))
                    await self._wait_for_new_token()
                except (NoHomeAssistantError, ConfigError, RefusedError, TimeoutError) as error:
                    self._lose(str(error) or f"{self.config.url} does not answer: restart it")
                    await self._pause()
        finally:
            await self._carrier.close()

    def _lose(self, problem: str) -> None:
        """Report that there is no connection: nothing can be switched."""
        self.bus.warn("connection", problem)
        self._problem = problem
        self._carrier.tell()

    async def _wait_for_new_token(self) -> None:
        """Wait for another token: with the same one Home Assistant blocks this machine in the end."""
        path = expand_home(self.config.token_file)
        rejected = await asyncio.to_thread(_content, path)
        while await asyncio.to_thread(_content, path) == rejected and not self._has_new_address:
            await self._pause()

    async def _await_address(self) -> None:
        """Use the address that the cards have set up, and wait until there is one."""
        if self._setup is None:
            return
        self._setup.address_changed.clear()
        self.config = self._setup.config_of(self.config)
        if not self.config.url:
            self._problem = "no Home Assistant is set up yet: open the page and choose one"
            self.bus.clear("connection")
            await self._setup.address_changed.wait()
            await self._await_address()

    @property
    def _has_new_address(self) -> bool:
        return self._setup is not None and self._setup.address_changed.is_set()

    async def _pause(self) -> None:
        """Wait before the next connection, or until the cards have another address."""
        if self._setup is None:
            await asyncio.sleep(RETRY_S)
        else:
            await wait_up_to(self._setup.address_changed, RETRY_S)

    async def _serve(self) -> None:
        async with connected(self.config) as connection:
            reading = asyncio.create_task(connection.read(), name="messages of Home Assistant")
            tasks = {
                reading,
                asyncio.create_task(self._follow(connection), name="states of Home Assistant"),
                asyncio.create_task(self._announcer.speak(connection), name="names for Home Assistant"),
            }
            if self._setup is not None:
                tasks.add(asyncio.create_task(self._setup.run(connection), name="set-up of the home"))
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

    async def _follow(self, connection: HomeAssistantConnection) -> None:
        """Read all states, and tell those of things whenever they change."""
        self._states.clear()
        self._hints.clear()
        silent = f"{self.config.url} accepts the token and then says nothing: restart Home Assistant"
        silence = self.bus.call_later(FIRST_REPLY_S, lambda: self.bus.warn("connection", silent))
        try:
            await connection.subscribe("state_changed", self._on_state_changed)
            self._is_starting = await connection.is_starting()
            await self._read_states(connection)
        finally:
            silence.cancel()
        self._commands.open(connection)
        self.bus.clear("connection")
        self._problem = ""
        while True:
            change = self._change  # those that come from now on have another turn
            if self._is_starting:
                self._is_starting = await connection.is_starting()
                self._should_read = True
            if self._should_read:
                await self._read_states(connection)
            self._commands.check()
            await self._report_entities()
            self._carrier.tell()
            await wait_up_to(change, CHECK_PERIOD_S)
            self._carrier.tell()
            await asyncio.sleep(MIN_PERIOD_S)

    def _announce_change(self) -> None:
        """Wake what waits for a change."""
        change = self._change
        self._change = asyncio.Event()
        change.set()

    async def _read_states(self, connection: HomeAssistantConnection) -> None:
        """Read the states of the entities that are used, and the names of all."""
        self._should_read = False
        states = await connection.states()
        self._names = states.keys()
        used = {name: each for name, each in states.items() if self._is_used(name)}
        for entity in used.keys() - self._states.keys():
            self._commands.on_first_state(entity, used[entity])
            if self._setup is not None:
                self._setup.on_first_state(entity, used[entity])
        self._states |= used | self._states  # events since the request are newer

    def _is_used(self, entity: str) -> bool:
        """Return True if the state of an entity matters here."""
        if entity in self._entities or entity in self._commands.dimmed:
            return True
        if self._setup is not None and entity in self._setup.entities:
            return True
        if not entity.startswith(VOICES):
            return False
        return entity in self._states or sum(each.startswith(VOICES) for each in self._states) < MAX_VOICES

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
        self._carrier.use({name: [HomeTarget(self, *each)] for name, each in self._things.items()})
        self._announce_change()

    def state_of(self, action: HomeAction) -> ThingState:
        """Return the state of the entity of a thing, or the cause for which it cannot be switched."""
        entity = action.entity
        limit_s = max(self.config.limit_s, SLOW_LIMIT_S if action.domain in SLOW_DOMAINS else 0.0)
        problem = self._problem
        is_allowed = not action.action or action.is_of(self.config.actions)
        is_missing = entity not in self._states or self._is_unavailable(entity)
        is_starting = is_allowed and not problem and self._is_starting and is_missing
        if not is_allowed:
            problem = f"{action.action} on {entity} is not allowed: list it in `home-assistant.actions`"
        elif is_starting:
            problem = "Home Assistant is still starting: wait"
        elif not problem and entity not in self._states:
            hint = self._hints.get(entity, "")
            problem = f"Home Assistant has no {entity}" + (f" ({hint})" if hint else "") + ": correct the map"
        elif not problem and self._is_unavailable(entity):
            problem = f"{entity} is unavailable in Home Assistant: look into its integration there"
        if problem:
            return ThingState(
                id="",
                state="unavailable",
                reason=one_line(problem, MAX_REASON),
                is_starting=is_starting,
                limit_s=limit_s,
            )
        is_on = self._is_on(action)
        state = "unknown" if is_on is None else "on" if is_on else "off"
        return ThingState(id="", state=state, limit_s=limit_s)

    async def switch(self, thing: Thing, action: HomeAction, act: Act) -> None:
        """Run the action of a thing, and wait until its entity is as wanted. Raises ActFailedError."""
        reported = self.state_of(action)
        entity = action.entity
        if reported.state == UNAVAILABLE:
            raise ActFailedError("unavailable", reported.reason)
        is_on = self._is_on(action)
        wanted = None
        if thing.mode == "switch":
            wanted = act.on
        elif is_on is not None and not action.action:
            wanted = not is_on
        if is_on is wanted and wanted is not None and not action.action and entity not in self._acts:
            return
        self._acts[entity] = act
        self._announce_change()  # to an earlier act on it
        try:
            await self._commands.run(action.call(on=wanted), act.check_in_time)
            if wanted is not None and is_on is not None and not (action.action and wanted):
                await self._wait_until(
                    action, act, is_on=wanted, timeout_s=reported.limit_s - RESULT_MARGIN_S
                )
        finally:
            if self._acts.get(entity) is act:
                del self._acts[entity]

    async def _wait_until(self, action: HomeAction, act: Act, *, is_on: bool, timeout_s: float) -> None:
        """Wait until an entity is on or off: that a call succeeds proves nothing. Raises ActFailedError."""
        try:
            async with asyncio.timeout(timeout_s):
                while self._is_on(action) is not is_on:
                    if self._acts.get(action.entity) is not act:
                        raise replaced_act(action.entity)
                    await self._change.wait()
        except TimeoutError:
            raise ActFailedError(
                "no_effect",
                f"{action.entity} did not go {'on' if is_on else 'off'} in Home Assistant: "
                "is it powered, and in reach?",
            ) from None

    def _is_on(self, action: HomeAction) -> bool | None:
        return action.is_on(self._states.get(action.entity, {}).get("state"))

    def _on_hover(self, hover: Hover, user: str) -> None:
        before = self._hovers.get(user, ("", 0.0))[0]
        self._hovers[user] = (hover.object_id, self._loop.time())
        for name in {before, hover.object_id} & self._things.keys() if before != hover.object_id else ():
            self._commands.wake(self._things[name][1].entity)

    def _hovered_entities(self) -> set[str]:
        oldest_s = self._loop.time() - MAX_HOVER_AGE_S
        names = {name for name, received_s in self._hovers.values() if received_s >= oldest_s}
        entities = {action.entity for name, (_thing, action) in self._things.items() if name in names}
        return entities if self._setup is None else entities | self._setup.hovered

    def _on_state_changed(self, data: Mapping[str, Any]) -> None:
        entity = data.get("entity_id")
        state = data.get("new_state")
        if not isinstance(entity, str) or not self._is_used(entity):
            return
        before = self._states.pop(entity, {})
        if is_state(state):
            self._states[entity] = state
        self._commands.on_state(entity, before, self._states.get(entity, {}))
        if self._setup is not None:
            self._setup.on_state(entity, self._states.get(entity, {}))
        if before.get("state") == self._states.get(entity, {}).get("state"):
            return
        self._announce_change()

    async def _hint(self, entity: str) -> str:
        """Return names that are similar to that of an entity that is not there, or `""`.

        Everybody on the site can read it, so it lists no other entities of the home.
        """
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
            if self._is_starting:
                continue  # it may come
            if entity not in self._states:
                hint = "" if len(missing) > MAX_NAMES else await self._hint(entity)
                missing.append(f"{entity} {use}" + (f" ({hint})" if hint else ""))
            elif self._is_unavailable(entity):
                unavailable.append(f"{entity} {use}")
        self._announcer.report_voice()
        names = first_of(missing, MAX_NAMES)
        remedy = "correct `home_assistant` in the map or site"
        self.bus.warn("entities", names and f"not in Home Assistant: {names}; {remedy}")
        names = first_of(unavailable, MAX_NAMES)
        remedy = "look into the integration there"
        self.bus.warn("unavailable", names and f"unavailable in Home Assistant: {names}; {remedy}")


class HomeTarget:
    """Entity of a thing, as the target of acts."""

    def __init__(self, home: HomeAssistant, thing: Thing, action: HomeAction) -> None:
        """Switch by `home` what `action` names."""
        self._home = home
        self._thing = thing
        self._action = action

    @property
    def state(self) -> ThingState:
        """Return the state that the entity reports."""
        return self._home.state_of(self._action)

    async def carry_out(self, act: Act, /) -> None:
        """Switch or run it. Raises ActFailedError if it does not follow."""
        await self._home.switch(self._thing, self._action, act)


def _similar_names(entity: str, names: Collection[str]) -> str:
    domain = entity.partition(".")[0] + "."
    alike = sorted(each for each in names if each.startswith(domain))
    middle = bisect.bisect(alike, entity)
    return did_you_mean(entity, alike[max(middle - MAX_CANDIDATES // 2, 0) : middle + MAX_CANDIDATES // 2])


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:
        return b""


SERVICE = HomeAssistant
