"""Speaks the understood sentence with a synthetic voice."""

import asyncio
import shutil

from pointit.errors import ConfigError
from pointit.runtime.clock import Clock
from pointit.schemas import NS_PER_S, Speech, Understood

PROGRAM = "espeak-ng"
LONGEST = 200
"""Number of characters that are said."""
ECHO_NS = NS_PER_S // 4
"""Time after the voice in which a microphone may still hear it, ns."""


class SpeechSynthesizer:
    """Says one sentence at a time; a newer one ends it."""

    def __init__(self, clock: Clock, option: str = "--speak") -> None:
        """Find the program.

        Args:
            clock: clock of the words that are heard.
            option: option that needs it.

        Raises:
            ConfigError: If it is not installed.
        """
        if shutil.which(PROGRAM) is None:
            raise ConfigError(f"{option} needs `{PROGRAM}`: install it, such as `apt-get install {PROGRAM}`")
        self._clock = clock
        self._saying: asyncio.Task[None] | None = None
        self._from_ns = self._until_ns = 0

    def say(self, understood: Understood) -> None:
        """Say the message; of a question only what is asked, since its answer is awaited."""
        text = understood.message
        if understood.result == "asked":
            text = f"{text.partition('?')[0]}?"
        if text:
            self.speak(text)

    def speak(self, text: str) -> None:
        """Speak `text`. It cuts off what is being spoken."""
        if self._saying is not None:
            self._saying.cancel()
        if self._until_ns < 2**62:  # else it goes on speaking
            self._from_ns, self._until_ns = self._clock.now_ns(), 2**62
        self._saying = asyncio.get_running_loop().create_task(self._run(text[:LONGEST]))

    def is_echo(self, speech: Speech) -> bool:
        """Return True if the words were heard while it spoke: they may be its own."""
        is_during = self._from_ns <= speech.stamp_ns and self._until_ns + ECHO_NS >= speech.words[0].start_ns
        return bool(self._from_ns) and is_during

    async def close(self) -> None:
        """Wait until the sentence is spoken."""
        if self._saying is not None:
            await asyncio.wait({self._saying})

    async def _run(self, text: str) -> None:
        """Run the program. The text comes by standard input, so that none is an option."""
        silent, pipe = asyncio.subprocess.DEVNULL, asyncio.subprocess.PIPE
        process = await asyncio.create_subprocess_exec(
            PROGRAM, "--stdin", stdin=pipe, stdout=silent, stderr=silent
        )
        try:
            await process.communicate(text.encode())
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()
            if self._saying is asyncio.current_task():  # no newer sentence is said
                self._until_ns = self._clock.now_ns()
