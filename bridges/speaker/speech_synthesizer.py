"""A synthetic voice: it says one sentence at a time, and detects that it is not heard.

No core: it waits for a program that speaks.
"""

import asyncio
import contextlib
import os
import re
import shutil
import signal
from asyncio.subprocess import DEVNULL, PIPE
from collections.abc import Callable

from pointit.runtime.clock import Clock
from pointit.runtime.errors import ConfigError
from pointit.schemas import NS_PER_S, Speech, Understood
from pointit.schemas.text import system_reason

PROGRAM = "espeak-ng"
VOICE_REMEDY = f"choose another language (`{PROGRAM} --voices`)"
SOUND_REMEDY = "does this machine have a sound card that its user may use (group audio)?"
LONGEST = 200
"""Maximum number of characters of a sentence. The rest is not said."""
MIN_SPOKEN_NS = 300_000_000
"""Time after which a name that is cut off counts as heard, ns."""
ECHO_NS = NS_PER_S // 4
"""Time after the voice in which a microphone may still hear it, ns."""
SPEAKING_NS = 2**62
"""End of a sentence that is being spoken, ns: later than any time."""


def require_synthesizer(user: str) -> None:
    """Raise ConfigError, which names `user`, if the program that speaks is not installed."""
    if shutil.which(PROGRAM) is None:
        raise ConfigError(f"{user} needs `{PROGRAM}`: install it, such as `apt-get install {PROGRAM}`")


class SpeechSynthesizer:
    """Says one sentence at a time. A newer one ends it."""

    def __init__(
        self, clock: Clock, language: str = "", *, on_problem: Callable[[str], None] | None = None
    ) -> None:
        """Create.

        Args:
            clock: clock of the words that are heard.
            language: such as `de`. `""`: the program's own.
            on_problem: called with the reason why nothing is heard, and `""` once something is.

        Raises:
            ConfigError: If the program is not installed.
        """
        require_synthesizer("--speak")
        self.spoken = 0
        """Number of sentences that were spoken, or cut off."""
        self._language = ("-v", language.lower()) if language else ()
        self._on_problem = on_problem
        self._problem = ""
        self._clock = clock
        self._newest_task: asyncio.Task[None] | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        """Sentences that are spoken, or being cut off."""
        self._from_ns = 0
        self._until_ns = 0

    def say(self, understood: Understood) -> None:
        """Say the message. Of a question only what is asked, since its answer is expected."""
        text = understood.message
        if understood.result == "asked":
            question, _, _ = text.partition("?")
            text = f"{question}?"
        if text:
            self.speak(text)

    def speak(self, text: str) -> None:
        """Speak `text`. It cuts off what is being spoken."""
        if self._newest_task is not None:
            self._newest_task.cancel()
        if self._until_ns < SPEAKING_NS:  # else it goes on speaking
            self._from_ns = self._clock.now_ns()
            self._until_ns = SPEAKING_NS
        task = asyncio.get_running_loop().create_task(self._run(text[:LONGEST]))
        self._newest_task = task
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _report_output(self, output: str) -> None:
        """Report the problem in the output of the program, which ends with 0 although it could not speak."""
        problem = ""
        error = re.search(r"^error:\s*(.*?)\.?$", output, re.IGNORECASE | re.MULTILINE)
        if error and error[1]:
            fault = error[1]
            remedy = VOICE_REMEDY if "voice" in fault else SOUND_REMEDY
            problem = f"nothing is heard: {PROGRAM} says {fault!r}; {remedy}"
        if problem != self._problem and self._on_problem is not None:
            self._on_problem(problem)
        self._problem = problem

    def is_echo(self, speech: Speech) -> bool:
        """Return True if the words were heard while it spoke: they may be its own."""
        is_during = self._from_ns <= speech.stamp_ns and self._until_ns + ECHO_NS >= speech.words[0].start_ns
        return bool(self._from_ns) and is_during

    async def close(self, *, cuts: bool = False) -> None:
        """Wait until the sentence is spoken, or cut it off."""
        if self._newest_task is not None and cuts:
            self._newest_task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _run(self, text: str) -> None:
        """Run the program. The text comes by standard input, so that none is an option."""
        began_ns = self._clock.now_ns()
        is_whole = False

        # A session of its own, so that all that it starts can be ended together
        options = {"stdin": PIPE, "stdout": DEVNULL, "stderr": PIPE, "start_new_session": True}
        starting = asyncio.ensure_future(
            asyncio.create_subprocess_exec(PROGRAM, *self._language, "--stdin", **options)
        )
        try:
            # without `shield` a program whose start is cut off could not be found and ended
            process = await asyncio.shield(starting)
            _, output = await process.communicate(text.encode())
            is_whole = True
            self._report_output(output.decode(errors="replace"))
        except OSError as error:
            reason = system_reason(error)
            self._report_output(f"error: {reason}")
        finally:
            is_audible = is_whole or self._clock.now_ns() - began_ns >= MIN_SPOKEN_NS
            if text and is_audible and not self._problem:
                self.spoken += 1

            # Cut off, or not started: end the program
            if not is_whole:
                with contextlib.suppress(OSError):  # it could not be started, or has ended
                    process = await starting
                    os.killpg(process.pid, signal.SIGKILL)  # what it has started holds its output, too
                    await process.wait()
            if self._newest_task is asyncio.current_task():  # no newer sentence is said
                self._until_ns = self._clock.now_ns()
