"""What the person was about outlives the supervisor: its last word is kept in a file."""

import asyncio

from pointit.runtime import ConfigError
from pointit.runtime.health import Warnings
from pointit.runtime.state import StateFile
from pointit.schemas import Interaction

PURPOSE = "interaction"
"""Under this name it is kept, a file for each person."""

TOPIC = "last word"


class LastWord:
    """Keeps the newest interaction of one person, and has that of before."""

    def __init__(self, user: str, warnings: Warnings) -> None:
        self._file = StateFile(Interaction, user, PURPOSE)
        self._warnings = warnings
        self._newest: Interaction | None = None
        self._said = asyncio.Event()

    def read(self) -> Interaction | None:
        """Return the last word of the supervisor of before; none when there is none to be used."""
        try:
            return self._file.read()
        except ConfigError as error:
            self._warnings.warn(TOPIC, f"what the person was about is not taken up: {error}")
            return None

    def say(self, interaction: Interaction) -> None:
        """Take what is said now."""
        self._newest = interaction
        self._said.set()

    async def keep(self) -> None:
        """Write what is said, whenever that is new, until cancelled."""
        while True:
            await self._said.wait()
            self._said.clear()
            if self._newest is None:
                continue
            try:
                await asyncio.to_thread(self._file.write, self._newest)
            except ConfigError as error:
                self._warnings.warn(TOPIC, f"after a restart the person has to press again: {error}")
            else:
                self._warnings.clear(TOPIC)
