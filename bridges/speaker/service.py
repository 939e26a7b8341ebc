"""Names that are announced, spoken by the loudspeaker of this machine."""

import asyncio
from typing import ClassVar

from pydantic import Field

from pointit.bridges.speaker.speech_synthesizer import SpeechSynthesizer, require_synthesizer
from pointit.runtime.config.config import Config
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import Announced
from pointit.schemas.problems import NAMES_SPOKEN, VOICE
from pointit.schemas.text import LANGUAGE
from pointit.schemas.topics import ANNOUNCED

COUNT_PERIOD_S = 0.5
"""Period of the metric, s."""


class SpeakerConfig(Config):
    """Voice of the names."""

    language: str = Field(
        default="",
        pattern=LANGUAGE,
        description="language of the voice, such as de; espeak-ng's own if empty",
    )


class Speaker(Service[SpeakerConfig]):
    """Speaks the names of all people by `espeak-ng`, and counts those that could be heard."""

    NAME: ClassVar[str] = "speaker"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = SpeakerConfig

    def __init__(self, config: SpeakerConfig, context: Context) -> None:
        super().__init__(config, context)
        self._synthesizer = SpeechSynthesizer(
            self.clock, config.language, on_problem=lambda sentence: self.bus.warn(VOICE, sentence)
        )
        self.bus.subscribe(ANNOUNCED, self._on_announced)

    @classmethod
    def validate_config(cls, config: SpeakerConfig) -> None:
        """Check that there is a program that speaks. Raises ConfigError."""
        del config
        require_synthesizer("service speaker")

    async def run(self) -> None:
        """Check that speaking works, and speak until cancelled."""
        self._synthesizer.speak("")  # an empty text reports a missing voice or sound card at once
        try:
            while True:
                self.bus.set_metric(NAMES_SPOKEN, self._synthesizer.spoken)
                await asyncio.sleep(COUNT_PERIOD_S)
        finally:
            await self._synthesizer.close(cuts=True)

    def _on_announced(self, announced: Announced, _user: str) -> None:
        if announced.object_id:
            self._synthesizer.speak(announced.label)


SERVICE = Speaker
