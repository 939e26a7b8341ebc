"""Names of things that a media player of Home Assistant speaks, of the people in turn.

No core: it waits for a media player.
"""

import asyncio
from collections.abc import Iterable, Mapping
from typing import Any

from pointit.bridges.home_assistant.config import HomeAssistantConfig
from pointit.bridges.home_assistant.home_action import UNAVAILABLE, ServiceCall
from pointit.bridges.home_assistant.home_connection import HomeConnection
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.errors import RefusedError
from pointit.schemas import Announced
from pointit.schemas.environment import Thing
from pointit.schemas.problems import NAMES_SPOKEN, VOICE

VOICES = "tts."
"""Start of the names of text-to-speech entities."""


class HomeAnnouncer:
    """Speaks names of the map, never a text of a message, to those people only to whom names are spoken."""

    def __init__(
        self, config: HomeAssistantConfig, bus: ServiceBus, states: Mapping[str, Mapping[str, Any]]
    ) -> None:
        """Speak nothing yet. `states`: the present states in Home Assistant, by entity."""
        self._config = config
        self._bus = bus
        self._states = states
        self._labels: dict[str, str] = {}
        """Name of each thing of the map."""
        self._waiting: dict[str, str] = {}
        """Newest name of each person that is not spoken yet. The first person is the next one."""
        self._has_names = asyncio.Event()
        self._spoken = 0
        """Number of names that were spoken."""

    def use(self, things: Iterable[Thing]) -> None:
        """Speak the names of these things from now on."""
        self._labels = {thing.id: thing.label or thing.id for thing in things}

    def on_announced(self, announced: Announced, user: str) -> None:
        """Speak the name of the thing that a person points at, unless they point elsewhere meanwhile."""
        label = self._labels.get(announced.object_id, "")
        if not label:
            self._waiting.pop(user, None)
        elif user in self._config.people or "*" in self._config.people:
            self._waiting[user] = label
            self._has_names.set()

    @property
    def voice(self) -> str:
        """Return the text-to-speech entity that speaks, or `""` if none is available."""
        candidates = [self._config.voice] if self._config.voice else sorted(self._states)
        for entity in candidates:
            if not entity.startswith(VOICES) or entity not in self._states:
                continue
            if self._states[entity]["state"] != UNAVAILABLE:
                return entity
        return ""

    def report_voice(self) -> None:
        """Report that there is no voice, if names shall be spoken."""
        warning = ""
        if self._config.speaker and not self.voice:
            voice = self._config.voice or "any text-to-speech entity"
            warning = (
                f"nobody hears names: {voice} is not available; "
                "look into its integration, or add one there, e.g. Piper"
            )
        self._bus.warn(VOICE, warning)

    async def speak(self, connection: HomeConnection) -> None:
        """Speak names until the connection is lost. Raises NoHomeAssistantError."""
        self._waiting.clear()
        while True:
            while not self._waiting:
                self._has_names.clear()
                await self._has_names.wait()
            user = next(iter(self._waiting))
            label = self._waiting.pop(user)

            # The voice may come and go: each name has the one that is available now
            voice = self.voice
            if voice:
                data = {"media_player_entity_id": self._config.speaker, "message": label}
                if self._config.language:
                    data["language"] = self._config.language
                try:
                    await connection.call(ServiceCall(voice, "tts", "speak", data))
                    self._bus.clear("speech")
                    self._spoken += 1
                    self._bus.set_metric(NAMES_SPOKEN, self._spoken)
                except (RefusedError, TimeoutError) as error:
                    reason = str(error) or "no answer"
                    self._bus.warn(
                        "speech",
                        f"Home Assistant did not run tts.speak on {voice} ({reason}): "
                        "correct `speaker` or `voice`",
                        voice,
                    )
            await asyncio.sleep(1.0 / self._config.rate_hz)
