"""A study in the terminal: texts and questions to the participant; a line and keys for the experimenter."""

import asyncio
from collections import deque

import click

from pointit.study.questionnaires import Scale
from pointit.study.step import Step
from pointit.study.view import StudyCommand, StudyStatus

KEYS = {"r": StudyCommand("repeat"), "p": StudyCommand("pause"), "q": StudyCommand("stop")}
HELP = "r repeat  s skip  p pause  q stop"


class TerminalView:
    """Shows one line that changes, and reads keys. Pass `on_bytes` to the keyboard."""

    def __init__(self) -> None:
        """Create without commands."""
        self._commands = deque[StudyCommand]()
        self._typed: str | None = None
        """Text that is being typed, or None while keys are commands."""
        self._entered = asyncio.Event()
        self._asks_reason = False
        self._shown = ""
        self._is_paused = False

    def on_bytes(self, data: bytes) -> None:
        """Process pressed keys."""
        for key in data.decode(errors="ignore"):
            self._on_key(key)

    async def tell(self, *steps: Step, go: str) -> bool:
        """Show `steps` until Enter, of pictures their names; `agree` wants an answer."""
        lines = [line for step in steps for line in (step.text, step.image and f"[picture {step.image}]")]
        text = "\n".join(filter(None, lines))
        asks = "agree? y or n, then Enter: " if go == "agree" else f"Enter to {go} "
        while True:
            answer = (await self._read(f"{text}\n{asks}")).strip().lower()
            if go != "agree" or answer in ("y", "yes"):
                return True
            if answer in ("n", "no"):
                return False

    async def ask(self, scale: Scale, block: str = "") -> list[int]:
        """Ask all items of `scale`, each until the answer is one of its values."""
        if block:
            click.echo(f"Questions on {block}:")
        low, high = scale.points
        answers: list[int] = []
        for item in scale.items:
            asks = f"{item}\n{low} = {scale.ends[0]}, {high} = {scale.ends[1]}: "
            values = {str(value): value for value in range(low, high + 1, scale.step)}
            while (answer := (await self._read(asks)).strip()) not in values:
                steps = f" in steps of {scale.step}" if scale.step != 1 else ""
                click.echo(f"write a whole number from {low} to {high}{steps}")
            answers.append(values[answer])
        return answers

    def status(self, status: StudyStatus) -> None:
        """Show where the study stands, in one line."""
        self._is_paused = status.state == "paused"
        if self._typed is not None:
            return
        target = f" at {status.target}" if status.target else ""
        line = (
            f"{status.participant}  trial {status.trial}, {status.left} left  {status.condition}  "
            f"{status.state}{target}  [{HELP}]"
        )
        if line != self._shown:
            self._shown = line
            self._write(f"\r\x1b[K{line}")

    def command(self) -> StudyCommand | None:
        """Return the next command of the experimenter."""
        return self._commands.popleft() if self._commands else None

    def _on_key(self, key: str) -> None:
        if self._typed is None:
            if key == "s":
                if not self._is_paused:  # the trial does not go on while the reason is typed
                    self._commands.append(StudyCommand("pause"))
                self._typed, self._asks_reason = "", True
                self._write("\r\x1b[Kskip this trial; why? ")
            elif key in KEYS:
                self._commands.append(KEYS[key])
        elif key in "\r\n":
            self._write("\n")
            if self._asks_reason:
                self._commands.append(StudyCommand("skip", self._typed.strip()))
                self._typed, self._asks_reason = None, False
            else:
                self._entered.set()
        elif key in "\x7f\b":
            self._typed = self._typed[:-1]
            self._write("\b \b")
        elif key.isprintable():
            self._typed += key
            self._write(key)

    async def _read(self, text: str) -> str:
        self._write(f"\r\x1b[K{text}")
        self._typed, self._asks_reason = "", False
        self._entered.clear()
        await self._entered.wait()
        typed, self._typed = self._typed or "", None
        return typed

    def _write(self, text: str) -> None:
        click.echo(text, nl=False)
