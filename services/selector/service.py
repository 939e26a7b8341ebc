"""Subscribes to cursors, objects, departures, buttons and the map; publishes hovers and the selection."""

import functools
import logging
from operator import attrgetter
from typing import ClassVar

from pointit.runtime.clock import sleep
from pointit.runtime.host.state_file import site_folder
from pointit.runtime.service.people_share import PeopleShare
from pointit.runtime.service.plugin_guard import watch_for_stalls
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import (
    Announced,
    ButtonEvent,
    Cursor,
    Environment,
    Feedback,
    Hover,
    Step,
    TrackedObjects,
    topics,
)
from pointit.schemas.selection import ThingStates
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.journal import Journal
from pointit.services.selector.methods.pointer import apply_method
from pointit.services.selector.roles import ShardRole, SiteRole
from pointit.services.selector.selection_methods import METHODS, PersonMethod
from pointit.services.selector.selection_publisher import OutgoingMessage

log = logging.getLogger(__name__)

CHECK_PERIOD_S = 0.5
"""Period of checks for what ends without a message, s."""


class Selector(Service[SelectorConfig]):
    """Turns cursors that stay on objects into selections.

    The instance without a name decides for all people of a site, and points for those whom no shard serves.
    A shard, `selector.NAME` with `people`, points for these and claims objects for them.
    """

    NAME: ClassVar[str] = "selector"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = SelectorConfig
    SEVERAL: ClassVar[bool] = True
    SHARDS: ClassVar[bool] = True
    TIME_MAY_STEP: ClassVar[bool] = True

    @classmethod
    def discard_saved_state(cls, site: str, now_ns: int) -> None:
        """Close all selections in the journal of `site`. The audit stays."""
        folder = site_folder(site, cls.NAME)
        if folder.is_dir():
            journal = Journal(folder, restore_within_s=0.0)
            journal.begin(now_ns)
            if journal.problem:
                log.error("%s", journal.problem)
            journal.close()

    def __init__(self, config: SelectorConfig, context: Context) -> None:
        super().__init__(config, context)
        self._in_use = config
        self._is_over = False
        """True when the journal is closed: what it cannot store is not published."""
        self._logged_problem = ""
        """Last problem of the method that was logged."""

        # Publishers, one for each person
        self._hovers = functools.cache(functools.partial(self.bus.publisher, topics.HOVER))
        self._cues = functools.cache(functools.partial(self.bus.publisher, topics.FEEDBACK))
        self._announced = functools.cache(functools.partial(self.bus.publisher, topics.ANNOUNCED))

        # The state from before a restart, restored before the first message is received
        role = ShardRole if config.people else SiteRole
        self._role = role(
            config, self.bus, self.clock, make=self._make_method, put=self._put, use=self._change_method
        )
        self._engine = self._role.engine
        self._role.begin()

        # The room and its objects
        self.bus.subscribe(topics.MAP, self._on_map)
        self.bus.subscribe(topics.OBJECTS, self._on_objects)
        self.bus.subscribe(topics.THING_STATES, self._on_states)
        self.bus.watch(topics.CARRIER_ALIVE, self._on_carrier)
        self._role.subscribe()

        # The people whom this instance serves
        self._share = PeopleShare(self.bus, self.NAME, config.people, name=self.name, lost=self._on_shard)
        # a cursor without a point only resets the hover, which is never too late
        self._share.subscribe(topics.CURSOR, self._on_cursor, drops_late=attrgetter("point_m"))
        self._share.subscribe(topics.BUTTON, self._on_button)
        self._share.subscribe(topics.STEP, self._on_step)
        self.bus.watch(topics.USER_ALIVE, self._on_presence)

    async def run(self) -> None:
        """Check periodically for what ends without a message, and maintain the journal.

        Close it at the end.
        """
        try:
            await self._share.announce()
            while True:
                self._engine.speed = self.clock.speed
                await sleep(self.clock, CHECK_PERIOD_S)
                now_ns = self.clock.now_ns()
                self._put(self._engine.tick(now_ns))
                self._check_trackers(now_ns)
                self._check_method()
                self._role.check(now_ns)
        finally:
            self._is_over = True
            self._role.close()

    def _on_map(self, environment: Environment, _name: str) -> None:
        self._put(self._engine.on_map(environment))
        self._role.on_map(self.clock.now_ns())

    def _on_objects(self, objects: TrackedObjects, tracker: str) -> None:
        self._put(self._engine.on_objects(tracker, objects))

    def _on_states(self, states: ThingStates, carrier: str) -> None:
        self._put(self._engine.on_states(carrier, states, self.clock.now_ns()))

    def _on_carrier(self, carrier: str, *, present: bool) -> None:
        self._put(self._engine.on_carrier(carrier, present, self.clock.now_ns()))

    def _on_cursor(self, cursor: Cursor, user: str) -> None:
        outputs = self._engine.on_cursor(user, cursor)
        if outputs:
            self._put(outputs)

    def _on_button(self, button: ButtonEvent, user: str) -> None:
        self._put(self._engine.on_button(user, button))

    def _on_step(self, step: Step, user: str) -> None:
        self._put(self._engine.on_step(user, step))

    def _on_presence(self, user: str, *, present: bool) -> None:
        self._put(self._engine.set_present(user, present, self.clock.now_ns()))

    def _on_shard(self, user: str) -> None:
        if isinstance(self._role, SiteRole):
            self._role.engine.on_shard(user)

    def _change_method(self, method: str | None, dwell_s: float | None) -> SelectorConfig:
        """Change the method or its time. Return the parameters in use.

        Raises:
            ValueError: If it is impossible. The message gives the reason.
            ConfigError: If the method is not installed or cannot be imported.
        """
        config = apply_method(self.config, self._in_use, method, dwell_s)
        if config != self._in_use:
            self._in_use = config
            self._engine.use(config)
        return config

    def _make_method(self, config: SelectorConfig, user: str) -> PersonMethod:
        watch_for_stalls(METHODS.module(config.method), METHODS.label(config.method), self.bus)
        surroundings = self.surroundings(METHODS.kind, config.method, user)
        return METHODS.get(config.method).make(config.section(config.method), surroundings)

    def _check_method(self) -> None:
        """Warn if the method fails for a person, and publish its own dwell time."""
        fault = self._engine.fault()
        name = self._in_use.method
        default = apply_method(self.config, self._in_use, name, None)
        self.bus.set_metric("default dwell", default.dwell_s, "s")
        problem = ""
        if fault:
            problem = f"{METHODS.label(name)} failed ({fault}): choose another one, or update it"
        if problem and problem != self._logged_problem:
            log.error("%s", problem)
        self._logged_problem = problem
        self.bus.warn("method", problem)

    def _put(self, outputs: list[OutgoingMessage]) -> list[OutgoingMessage]:
        """Publish `outputs`, after the journal has committed them, and return them."""
        if self._is_over:
            return []
        is_hover = len(outputs) == 1 and isinstance(outputs[0].message, Hover)
        if not is_hover:  # the journal stores nothing of a hover
            self._role.commit(outputs)
        for user, message in outputs:
            if isinstance(message, Hover):
                self._hovers(user).put(message)
            elif isinstance(message, Feedback):
                self._cues(user).put(message)
            elif isinstance(message, Announced):
                self._announced(user).put(message)
            else:
                self._role.publish(user, message)
        return outputs

    def _check_trackers(self, now_ns: int) -> None:
        silent = ", ".join(sorted(self._engine.stale_trackers(now_ns)))
        problem = ""
        if silent:
            problem = (
                f"no objects from {silent}, so theirs cannot be hovered: "
                "is it running, and is its clock right?"
            )
        self.bus.warn("objects", problem)


SERVICE = Selector
