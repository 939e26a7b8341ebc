"""Runs actions of a Home Assistant when people point at things, and shows its states."""

import asyncio
import bisect
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from pointit.bridges.home_assistant.announcer import VOICES, HomeAnnouncer
from pointit.bridges.home_assistant.config import HomeAssistantConfig
from pointit.bridges.home_assistant.connection import LoginError, connected, require_client
from pointit.bridges.home_assistant.entity_commands import EntityCommands, replaced_act
from pointit.bridges.home_assistant.home_action import SLOW_DOMAINS, UNAVAILABLE, HomeAction
from pointit.bridges.home_assistant.home_connection import HomeConnection, NoHomeAssistantError, is_state
from pointit.bridges.home_assistant.mqtt.broker_connection import broker_connected
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
REJECTED_LOGIN = (
    "Home Assistant rejects the token: make a new long-lived access token in your profile there, under "
    "Security, and paste it here"
)
"""Problem at a card, which has a field for the token."""
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
        self._given_config = config
        """Parameters of the run: the set-up of a home may have another address."""
        self._loop = asyncio.get_running_loop()

        # Things of the map
        self._things: dict[str, tuple[Thing, HomeAction]] = {}
        self._entities: set[str] = set()
        """Entities of things, and those that speak."""

        # What is known of Home Assistant
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

        # What people do: acts, hovers, and names that are spoken
        self._acts: dict[str, Act] = {}
        """Newest act on each entity that is being carried out."""
        self._hovers: dict[str, tuple[str, float]] = {}
        """Hovered thing of each person, and the time of the message."""
        self._announcer = HomeAnnouncer(config, self.bus, self._states)
        self._commands = EntityCommands(config, self.bus, self._state_in_home, self._hovered_entities)
        self._carrier = Carrier(self.bus, self.clock, self.NAME)
        self._setup: SetupSession | None = self._make_setup(config)

        # Requests before messages: the cards of a home ask at once
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
        if not config.broker:
            config.read_token()

    def _make_setup(self, config: HomeAssistantConfig) -> "SetupSession | None":
        """Return the set-up of a home, or None if this run has none. Raises ConfigError."""
        if not config.setup:
            return None
        from pointit.bridges.home_assistant.setup.setup_session import SetupSession  # noqa: PLC0415 - see above

        return SetupSession(
            expand_home(config.setup),
            self.bus,
            state_of=self._state_in_home,
            wake=self._commands.wake,
        )

    def _state_in_home(self, entity: str) -> Mapping[str, Any]:
        """Return the state of an entity in Home Assistant, empty if it is not known."""
        return self._states.get(entity, {})

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
                    await self._serve_connection()
                except LoginError as error:
                    self._report_loss(str(error))
                    if self._setup is not None:
                        self._problem = REJECTED_LOGIN
                    if not await self._end_trial():
                        await self._wait_for_new_token()
                except (NoHomeAssistantError, ConfigError, RefusedError, TimeoutError) as error:
                    address = self.config.broker or self.config.url
                    self._report_loss(str(error) or f"{address} does not answer: restart it")
                    if not await self._end_trial():
                        await self._pause_before_retry()
        finally:
            await self._carrier.close()

    def _report_loss(self, problem: str) -> None:
        """Report that there is no connection: nothing can be switched."""
        self.bus.warn("connection", problem)
        self._problem = problem
        self._carrier.tell()

    async def _end_trial(self) -> bool:
        """Return to the address that works if another one was tried. Return False if there is none."""
        return self._setup is not None and await self._setup.end_trial(self._problem)

    async def _wait_for_new_token(self) -> None:
        """Wait for another token: with the same one Home Assistant blocks this machine in the end."""
        path = expand_home(self.config.token_file)
        rejected = await asyncio.to_thread(_content, path)
        while await asyncio.to_thread(_content, path) == rejected and not self._has_new_address:
            await self._pause_before_retry()

    async def _await_address(self) -> None:
        """Use the address that the cards have set up, and wait until there is one."""
        if self._setup is None:
            return
        self._setup.address_changed.clear()
        self.config = self._setup.address.config_of(self._given_config)
        if not self.config.url and not self.config.broker:
            self._problem = "no Home Assistant or broker is set up yet: open the page and choose one"
            self.bus.clear("connection")
            await self._setup.address_changed.wait()
            await self._await_address()

    @property
    def _has_new_address(self) -> bool:
        return self._setup is not None and self._setup.address_changed.is_set()

    async def _pause_before_retry(self) -> None:
        """Wait before the next connection, or until the cards have another address."""
        if self._setup is None:
            await asyncio.sleep(RETRY_S)
        else:
            await wait_up_to(self._setup.address_changed, RETRY_S)

    async def _serve_connection(self) -> None:
        home = broker_connected(self.config) if self.config.broker else connected(self.config)
        async with home as connection:
            reading = asyncio.create_task(connection.read(), name="messages of Home Assistant")
            tasks = {
                reading,
                asyncio.create_task(self._follow_states(connection), name="states of Home Assistant"),
                asyncio.create_task(self._announcer.speak(connection), name="names for Home Assistant"),
            }
            if self._setup is not None:
                tasks.add(asyncio.create_task(self._setup.run(connection), name="set-up of the home"))
            # The reason of the reader comes first: the others end because of it
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

    async def _follow_states(self, connection: HomeConnection) -> None:
        """Read all states, and report those of things whenever they change."""
        self._states.clear()
        self._hints.clear()

        # Changes are subscribed before the states are read, so that none is missed in between
        silent = f"{self.config.broker or self.config.url} {self.config.words.silence}"
        silence = self.bus.call_later(FIRST_REPLY_S, lambda: self.bus.warn("connection", silent))
        try:
            await connection.subscribe("state_changed", self._on_state_changed)
            self._is_starting = await connection.is_starting()
            await self._read_states(connection)
        finally:
            silence.cancel()

        # From here on things can be switched
        self._commands.open(connection)
        self.bus.clear("connection")
        self._problem = ""
        if self._setup is not None:
            await self._setup.on_accepted()
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

    async def _read_states(self, connection: HomeConnection) -> None:
        """Read the states of the entities that are used, and the names of all."""
        self._should_read = False
        states = await connection.states()
        self._names = states.keys()
        used = {entity: state for entity, state in states.items() if self._is_used(entity)}
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
        if entity in self._states:
            return True
        voices = sum(name.startswith(VOICES) for name in self._states)
        return voices < MAX_VOICES

    def _on_map(self, environment: Environment, _name: str) -> None:
        things: dict[str, tuple[Thing, HomeAction]] = {}
        targets: dict[str, list[HomeTarget]] = {}
        for thing in environment.things:
            if thing.home_assistant:
                action = HomeAction.parse(thing.home_assistant)
                things[thing.id] = (thing, action)
                targets[thing.id] = [HomeTarget(self, thing, action)]
        self._things = things

        self._announcer.use(environment.things)
        self._entities = {action.entity for _thing, action in self._things.values()}
        self._entities |= {self.config.speaker, self.config.voice} - {""}
        self._should_read = True
        self._carrier.use(targets)
        self._announce_change()

    def state_of(self, action: HomeAction) -> ThingState:
        """Return the state of the entity of a thing, or the cause for which it cannot be switched."""
        limit_s = self.config.limit_s
        if action.domain in SLOW_DOMAINS:
            limit_s = max(limit_s, SLOW_LIMIT_S)
        problem, is_starting = self._problem_of(action)
        if problem:
            return ThingState(
                id="",
                state="unavailable",
                reason=one_line(problem, MAX_REASON),
                is_starting=is_starting,
                limit_s=limit_s,
            )
        is_on = self._is_on(action)
        if is_on is None:
            return ThingState(id="", state="unknown", limit_s=limit_s)
        return ThingState(id="", state="on" if is_on else "off", limit_s=limit_s)

    def _problem_of(self, action: HomeAction) -> tuple[str, bool]:
        """Return the cause for which an entity cannot be switched, or `""`, and whether a start is the cause.

        The first cause counts: what is not allowed stays so in any state of Home Assistant, and without a
        connection no state is known.
        """
        entity = action.entity
        words = self.config.words
        if action.action and not action.is_of(self.config.actions):
            problem = f"{action.action} on {entity} is not allowed: list it in `home-assistant.actions`"
            return problem, False
        if self._problem:
            return self._problem, False
        is_missing = entity not in self._states
        if not is_missing and not self._is_unavailable(entity):
            return "", False
        if self._is_starting:
            return words.starting, True
        if is_missing:
            hint = self._hints.get(entity, "")
            shown_hint = f" ({hint})" if hint else ""
            return f"{words.name} has no {entity}{shown_hint}: correct the map", False
        return f"{entity} is unavailable {words.place}: {words.remedy}", False

    async def switch(self, thing: Thing, action: HomeAction, act: Act) -> None:
        """Run the action of a thing, and wait until its entity is as wanted. Raises ActFailedError."""
        if self._setup is not None and not act.event.takes_back:
            refusal = self._setup.refusal(act.event.user)
            if refusal:
                raise ActFailedError("refused", refusal)
            self._setup.on_act(act.event.user, action.entity)
        reported = self.state_of(action)
        entity = action.entity
        if reported.state == UNAVAILABLE:
            raise ActFailedError("unavailable", reported.reason)

        # A thing without a switch's mode is toggled if its entity can be on, and else run
        is_on = self._is_on(action)
        target_on = None
        if thing.mode == "switch":
            target_on = act.on
        elif is_on is not None and not action.action:
            target_on = not is_on

        # Nothing is to be done, unless an earlier act is about to change that
        is_done = target_on is not None and is_on is target_on
        if is_done and not action.action and entity not in self._acts:
            return
        self._acts[entity] = act
        self._announce_change()  # to an earlier act on it
        try:
            await self._commands.run(action.call(on=target_on), act.check_in_time)
            # An action of its own, such as a scene, may leave the entity as it is
            runs_action = action.action and target_on
            if target_on is not None and is_on is not None and not runs_action:
                timeout_s = reported.limit_s - RESULT_MARGIN_S
                await self._wait_until(action, act, is_on=target_on, timeout_s=timeout_s)
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
            state = "on" if is_on else "off"
            raise ActFailedError(
                "no_effect",
                f"{action.entity} did not go {state} {self.config.words.place}: is it powered, and in reach?",
            ) from None

    def _is_on(self, action: HomeAction) -> bool | None:
        return action.is_on(self._states.get(action.entity, {}).get("state"))

    def _on_hover(self, hover: Hover, user: str) -> None:
        previous, _ = self._hovers.get(user, ("", 0.0))
        self._hovers[user] = (hover.object_id, self._loop.time())
        if previous == hover.object_id:
            return
        for name in {previous, hover.object_id} & self._things.keys():
            _, action = self._things[name]
            self._commands.wake(action.entity)

    def _hovered_entities(self) -> set[str]:
        """Return the entities that people hover, or whose turn it is at the cards of a home."""
        oldest_s = self._loop.time() - MAX_HOVER_AGE_S
        names = {name for name, received_s in self._hovers.values() if received_s >= oldest_s}
        entities = {action.entity for name, (_thing, action) in self._things.items() if name in names}
        if self._setup is None:
            return entities
        return entities | self._setup.hovered

    def _on_state_changed(self, data: Mapping[str, Any]) -> None:
        entity = data.get("entity_id")
        state = data.get("new_state")
        if not isinstance(entity, str) or not self._is_used(entity):
            return
        before = self._states.pop(entity, {})
        after: Mapping[str, Any] = {}
        if is_state(state):  # else the entity was removed
            self._states[entity] = state
            after = state
        self._commands.on_state(entity, before, after)
        if self._setup is not None:
            self._setup.on_state(entity, after)

        # Attributes alone, such as a brightness, wake nobody
        if before.get("state") != after.get("state"):
            self._announce_change()

    async def _hint_for(self, entity: str) -> str:
        """Return names that are similar to that of an entity that is not there, or `""`.

        Everybody on the site can read it, so it lists no other entities of the home.
        """
        if entity not in self._hints:
            self._hints[entity] = await asyncio.to_thread(_similar_names, entity, self._names)
        return self._hints[entity]

    def _is_unavailable(self, entity: str) -> bool:
        state = self._states.get(entity, {}).get("state", UNAVAILABLE)
        return bool(state == UNAVAILABLE)

    async def _report_entities(self) -> None:
        """Report entities that do not exist or are unavailable, by name."""
        uses = [(action.entity, f"of thing {name}") for name, (_thing, action) in self._things.items()]
        for speaker in (self.config.speaker, self.config.voice):
            if speaker:
                uses.append((speaker, "that speaks"))

        missing: list[str] = []
        unavailable: list[str] = []
        for entity, use in uses:
            if self._is_starting:
                continue  # it may come
            if entity not in self._states:
                # Names beyond those that are shown need no search, which takes some ms
                hint = ""
                if len(missing) <= MAX_NAMES:
                    hint = await self._hint_for(entity)
                shown_hint = f" ({hint})" if hint else ""
                missing.append(f"{entity} {use}{shown_hint}")
            elif self._is_unavailable(entity):
                unavailable.append(f"{entity} {use}")
        self._announcer.report_voice()

        # An empty sentence clears the warning
        words = self.config.words
        names = first_of(missing, MAX_NAMES)
        remedy = "correct `home_assistant` in the map or site"
        self.bus.warn("entities", names and f"not {words.place}: {names}; {remedy}")
        names = first_of(unavailable, MAX_NAMES)
        remedy = "look into the integration there"
        if self.config.broker:
            remedy = words.remedy
        self.bus.warn("unavailable", names and f"unavailable {words.place}: {names}; {remedy}")


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
    """Return names of the same domain that are similar to `entity`, among its neighbours by the alphabet."""
    domain = entity.partition(".")[0] + "."
    same_domain = sorted(name for name in names if name.startswith(domain))
    middle = bisect.bisect(same_domain, entity)
    start = max(middle - MAX_CANDIDATES // 2, 0)
    end = middle + MAX_CANDIDATES // 2
    return did_you_mean(entity, same_domain[start:end])


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:
        return b""


SERVICE = HomeAssistant
