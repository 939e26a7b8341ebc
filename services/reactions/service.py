"""Starts programs and sends webhooks when people point at things, and reports the result of each."""

import asyncio
from collections.abc import Iterable
from typing import ClassVar

from pydantic import Field

from pointit.runtime.config.config import Config
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.carrier import Carrier, Target
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import Environment
from pointit.schemas.topics import MAP
from pointit.services.reactions.targets import Reaction, reactions_in


class ReactionsConfig(Config):
    """Programs and webhooks of things."""

    on: tuple[str, ...] = Field(
        default=(), description="THING=PROGRAM ARGUMENTS... or THING=URL, or FILE.yaml with several of them"
    )


def targets_of(reactions: Iterable[Reaction]) -> dict[str, list[Target]]:
    """Return the targets of each thing."""
    targets: dict[str, list[Target]] = {}
    for reaction in reactions:
        targets.setdefault(reaction.thing, []).append(reaction.target)
    return targets


class Reactions(Service[ReactionsConfig]):
    """Carries out the acts on things that have a program or webhook."""

    NAME: ClassVar[str] = "reactions"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = ReactionsConfig
    TIME_MAY_STEP: ClassVar[bool] = True

    def __init__(self, config: ReactionsConfig, context: Context) -> None:
        """Prepare. Raises ConfigError as `validate_config`."""
        super().__init__(config, context)
        self._reactions: list[Reaction] = []
        for text in config.on:
            self._reactions.extend(reactions_in(text))
        self._carrier = Carrier(self.bus, self.clock, self.NAME)
        self._carrier.use(targets_of(self._reactions))
        self.bus.subscribe(MAP, self._on_map)

    @classmethod
    def validate_config(cls, config: ReactionsConfig) -> None:
        """Check that all programs and URLs can be used. Raises ConfigError."""
        for text in config.on:
            list(reactions_in(text))

    async def run(self) -> None:
        """Act until cancelled. Then end all programs."""
        try:
            await asyncio.Event().wait()
        finally:
            await self._carrier.close()

    def _on_map(self, room: Environment, _name: str) -> None:
        """Warn of things that the new map lacks."""
        for reaction in self._reactions:
            try:
                reaction.check(room)
                self.bus.clear("things", reaction.thing)
            except ConfigError as error:
                self.bus.warn("things", str(error), reaction.thing)


SERVICE = Reactions
"""The class of this service."""
