"""Two pages of a study: their content, and the handling of their messages."""

import asyncio
from collections import deque
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Literal, get_args

from pydantic import Field, ValidationError

from pointit.runtime.config.config import Config
from pointit.schemas.text import describe_mistake
from pointit.study.questionnaire import Scale
from pointit.study.session import StoppedError
from pointit.study.study_step import Picture, StudyStep
from pointit.study.view import BREAK, StudyCommand, StudyStatus

Page = Literal["participant", "experimenter"]
CommandName = Literal["repeat", "skip", "pause", "stop"]
MAX_REASON = 200
"""Maximum length of the reason of a skipped trial."""
MAX_ANSWERS = 1000
WAITING = {"show": "wait", "title": "One moment, please", "text": ""}
POINTING = {"show": "wait", "title": "Point", "text": "Look at the room."}
TITLES: dict[str, Mapping[str, object]] = {
    "pointing": POINTING,
    "pause": POINTING,
    "paused": {"show": "wait", "title": "Paused", "text": "Please wait."},
}
"""Content of the participant's page by `Status.state`."""


class ParticipantMessage(Config):
    """A message of the participant's page."""

    id: int = Field(description="number of the text or questionnaire that is answered")
    agrees: bool | None = Field(default=None, description="answer to a consent; nothing else is one")
    answers: tuple[int, ...] = Field(default=(), max_length=MAX_ANSWERS)


class ExperimenterMessage(Config):
    """A message of the experimenter's page."""

    command: CommandName
    reason: str = Field(default="", max_length=MAX_REASON)


class PageView:
    """A `StudyView` of any number of pages: all of one kind show the same, and the first answer counts."""

    def __init__(self, study: str, participant: str, pictures: Mapping[str, Picture] | None = None) -> None:
        """Create without pages; `pictures` by `Step.image`."""
        self._pictures: dict[str, Picture] = {**(pictures or {})}
        self._who = {"study": study, "who": participant}
        self._shown: Mapping[str, object] = WAITING
        self._status: StudyStatus | None = None
        self._commands = deque[StudyCommand]()
        self._number = 0
        self._scale: Scale | None = None
        self._message: asyncio.Future[ParticipantMessage] | None = None
        self.pages: dict[Page, int] = {"participant": 0, "experimenter": 0}
        """Number of open pages."""
        self.changed = asyncio.Event()
        """Set at the next change of any content, then replaced."""
        self.is_over = False

    @property
    def pictures(self) -> list[Picture]:
        """Pictures of all steps; a page asks for them by their index."""
        return list(self._pictures.values())

    async def tell(self, *steps: StudyStep, go: str) -> bool:
        """Show `steps` until the participant does `go`. Raises: StoppedError: If the experimenter stops."""
        images = list(self._pictures)
        shown_steps: list[dict[str, Any]] = []
        for step in steps:
            image = images.index(step.image) if step.image else None
            shown_steps.append({"text": step.text, "alt": step.alt, "image": image})
        message = await self._ask({"show": "text", "steps": shown_steps, "go": go})
        return go != "agree" or message.agrees is True

    async def ask(self, scale: Scale, block: str = "") -> list[int]:
        """Show a questionnaire until all its items are answered. Raises as `tell` does."""
        self._scale = scale
        text = f"These questions are on {block}, which you have just done." if block else ""
        shown = {"show": "scale", "title": "Please answer", "text": text, **scale.model_dump(mode="json")}
        return list((await self._ask(shown)).answers)

    def status(self, status: StudyStatus, /) -> None:
        """Show where the study stands."""
        if status == self._status:
            return
        self._status = status
        state = status.state
        if state.startswith(BREAK):
            self._shown = {"show": "wait", "title": "Break", "text": state.removeprefix(BREAK)}
        else:
            self._shown = TITLES.get(state, {"show": "wait", "title": "Wait", "text": state})
        if status.say:
            self._shown = {**self._shown, "text": status.say}
        self.change()

    def command(self) -> StudyCommand | None:
        """Return the next command of the experimenter."""
        return self._commands.popleft() if self._commands else None

    def end(self, text: str) -> None:
        """Show `text` as the last content of all pages."""
        self._shown = {"show": "end", "title": "Thank you", "text": text}
        self.is_over = True
        self.change()

    def change(self) -> None:
        """Wake all who wait for `changed`."""
        self.changed.set()
        self.changed = asyncio.Event()

    def content(self, page: Page) -> dict[str, Any]:
        """Return the content of a page, in types of JSON."""
        shown = dict(self._shown)
        if self._status is not None:
            shown |= {"trial": self._status.trial, "trials": self._status.trials}
        if page == "participant":
            return shown
        return {
            **self._who,
            "shown": shown,
            "pages": self.pages["participant"],
            "can": self._possible_commands,
            "status": None if self._status is None else asdict(self._status),
        }

    @property
    def _possible_commands(self) -> tuple[str, ...]:
        """Commands of the experimenter that have an effect now."""
        if self.is_over:
            return ()
        if self._is_asking:
            return ("stop",)
        return get_args(CommandName)

    def hear(self, page: Page, text: str) -> str:
        """Obey a message of a page; return what is wrong with it, or `""`."""
        try:
            if page == "participant":
                return self._on_answer(ParticipantMessage.model_validate_json(text, strict=True))
            return self._on_order(ExperimenterMessage.model_validate_json(text, strict=True))
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False)[0]
            field = ".".join(map(str, first["loc"]))
            return f"{field or 'message'}: {describe_mistake(first)}"

    @property
    def _is_asking(self) -> bool:
        return self._message is not None and not self._message.done()

    async def _ask(self, shown: Mapping[str, object]) -> ParticipantMessage:
        self._number += 1
        self._shown = {"id": self._number, **shown}
        self._message = asyncio.get_running_loop().create_future()
        self.change()
        try:
            return await self._message
        finally:
            self._message = None
            self._scale = None
            self._shown = WAITING
            self._status = None
            self.change()

    def _on_answer(self, message: ParticipantMessage) -> str:
        if self._message is None or self._message.done():
            return ""  # another page was faster
        if message.id != self._number:
            return ""  # it answers what was shown before
        if self._shown.get("go") == "agree" and message.agrees is None:
            return "agrees: write true or false; without it there is no consent"
        if self._scale is not None:
            problem = _problem(self._scale, message.answers)
            if problem:
                return problem
        self._message.set_result(message)
        return ""

    def _on_order(self, order: ExperimenterMessage) -> str:
        if order.command not in self.content("experimenter")["can"]:
            return f"{order.command}: the participant reads or answers; wait, or stop"
        if order.command == "skip" and not order.reason.strip():
            return "reason: write why the trial is skipped"
        if self._is_asking and self._message is not None:
            self._message.set_exception(
                StoppedError(f"{self._who['who']} is stopped; the same command goes on")
            )
        else:
            self._commands.append(StudyCommand(order.command, " ".join(order.reason.split())))
        return ""


def _problem(scale: Scale, answers: tuple[int, ...]) -> str:
    low, high = scale.points
    if len(answers) != len(scale.items):
        return f"answers: {len(answers)} of {len(scale.items)} are there"
    possible = range(low, high + 1, scale.step)
    if any(value not in possible for value in answers):
        return f"answers: use values from {low} to {high} in steps of {scale.step}"
    return ""
