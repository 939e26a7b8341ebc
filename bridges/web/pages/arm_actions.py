"""Actions of a page for one person: their arm, which a mouse, headset or phone moves, button and words.

- `press`, `{"gesture": "press" | "double" | "hold", "held_s": 0.2}`: press the person's button, which went
  down that long ago.
- `step`, `{"by": -1 | 1, "to": "beside" | "row" | "here"}`: from the announced thing to the one left or right
  of it, or in the row above or below; or to the nearest. `here` has its place in the row spoken.
- `take`, `{"by": "mouse" | "headset"}`: move the person's arm by this page's mouse or its headset; an idle
  person begins to point. `give`: give it back, whichever page moves it.
- `tremor`, `{"rms_deg": number}`: tremor of that arm.
- `centre`: the person's arm points at the middle of the room right now.
- `report_voice`, `{"spoken": 1, "problem": "" | "none" | "language" | "silent"}`: names that the page has
  spoken to the person since the last report, and why nothing is heard; the reply has it in words.
- `speak`, `{"words": [{"text", "start_s", "end_s", "confidence"}]}`: what the person said. Times are ages of
  onset and end when it is sent, s, so that no clock has to agree.

No core: it publishes for a person.
"""

import time
from typing import Any, Literal

from pydantic import Field

from pointit.bridges.web.model.people import VoiceProblem
from pointit.bridges.web.pages.action import (
    CONTROL,
    WRIST,
    Action,
    ActionContext,
    ActionParameters,
    JsonObject,
    NoParameters,
    PageSender,
)
from pointit.bridges.web.wrists.wrist_control import MAX_TREMOR_DEG, Hold
from pointit.runtime.errors import RefusedError
from pointit.schemas import SetYawOrigin, topics
from pointit.schemas.base import Fraction
from pointit.schemas.person import MAX_WORDS
from pointit.schemas.system import instance_of

IMU_BRIDGE = "imu-bridge"
"""Service that turns messages of a mouse or phone into wrist samples."""

MAX_HELD_S = 2.0
"""Greatest time since the button went down, s: headsets send a press when it comes up."""

MAX_WORD_AGE_S = 60.0
"""Largest age of a word, s."""


class ArmPress(ActionParameters):
    """Parameters of a press."""

    gesture: Literal["press", "double", "hold"] = "press"
    held_s: float = Field(
        default=0.0, ge=0.0, le=MAX_HELD_S, description="time since the button went down, s"
    )


def _source_of(context: ActionContext, sender: PageSender) -> str:
    """Return the name of the device in messages."""
    is_headset = context.wrists.holder(sender.user) == (sender.page, "headset")
    return "headset" if is_headset else "page"


async def _press(context: ActionContext, sender: PageSender, press: ArmPress) -> JsonObject:
    source = _source_of(context, sender)
    context.people.press(sender.user, press.gesture, source=source, held_s=press.held_s)
    return {"message": f"{sender.user}'s button was pressed"}


class StepBeside(ActionParameters):
    """Direction of a step, as in `Step`."""

    by: Literal[-1, 1]
    to: Literal["beside", "row", "here"] = "beside"


async def _step(context: ActionContext, sender: PageSender, step: StepBeside) -> JsonObject:
    context.people.step(sender.user, step.by, step.to, source=_source_of(context, sender))
    return {"message": ""}


class TakeArm(ActionParameters):
    """Device of the page that is to move the arm; a phone's page has only the phone."""

    by: Literal["mouse", "headset"] = "mouse"


async def _take(context: ActionContext, sender: PageSender, take: TakeArm) -> JsonObject:
    user = sender.user
    if instance_of(IMU_BRIDGE, user) not in context.present():
        raise RefusedError(
            f"no service turns the page's messages into wrist samples: start it with "
            f"`pointit service run {IMU_BRIDGE} --user {user} --source page`"
        )

    # A page of a wrist is a phone or a headset, and cannot choose
    is_phone = sender.page == context.pairing.paired(user, time.monotonic())
    if sender.role == "wrist" and is_phone is (take.by == "headset"):
        device = "phone" if is_phone else "headset"
        raise RefusedError(f"this page moves {user}'s arm as a {device} only")
    mover: Hold = "phone" if is_phone else take.by

    # The arm is moved before the press, whose source is the new mover
    loser = context.wrists.acquire(user, sender.page, mover)
    context.notify_loser(user, loser, sender.page)
    if context.people.states.get(user) == "idle":
        context.people.press(user, source=_source_of(context, sender))
    context.changed()
    return {"message": f"{user}'s arm follows this {mover}"}


async def _give(context: ActionContext, sender: PageSender, _: NoParameters) -> JsonObject:
    user = sender.user
    if sender.role == "wrist":
        context.wrists.release_from(user, sender.page)
    else:
        loser = context.wrists.release(user)
        context.notify_loser(user, loser, sender.page, is_own=True)
    context.changed()
    return {"message": f"{user}'s arm is their own again"}


class ArmTremor(ActionParameters):
    """Parameters of a tremor."""

    rms_deg: float = Field(ge=0, le=MAX_TREMOR_DEG)


async def _set_tremor(context: ActionContext, sender: PageSender, tremor: ArmTremor) -> JsonObject:
    if not context.wrists.set_tremor(sender.user, sender.page, tremor.rms_deg):
        raise RefusedError(f"this page does not move {sender.user}'s arm: take it first")
    return {"message": f"{sender.user}'s arm trembles by {tremor.rms_deg:g}° rms"}


async def _centre(context: ActionContext, sender: PageSender, _: NoParameters) -> JsonObject:
    page, mover = context.wrists.holder(sender.user)
    if mover == "headset":
        raise RefusedError(f"a headset knows where {sender.user} points: align it again if that is wrong")
    if sender.role == "wrist" and page != sender.page:
        raise RefusedError(f"this page does not move {sender.user}'s arm: take it first")
    query = SetYawOrigin(yaw_rad=context.wrists.ahead(sender.user))
    reply = await context.bus.call(topics.SET_YAW_ORIGIN, query, sender.user)
    context.phones.centred(sender.user)
    return reply.model_dump(mode="json")


class SpokenWord(ActionParameters):
    """A word that the browser of the person recognised."""

    text: str = Field(min_length=1, max_length=64)
    start_s: float = Field(ge=0, le=MAX_WORD_AGE_S, description="age of its onset")
    end_s: float = Field(ge=0, le=MAX_WORD_AGE_S)
    confidence: Fraction | None = None


class Speak(ActionParameters):
    """An utterance of the person."""

    words: tuple[SpokenWord, ...] = Field(min_length=1, max_length=MAX_WORDS)


async def _speak(context: ActionContext, sender: PageSender, speak: Speak) -> JsonObject:
    words = [word.model_dump() for word in speak.words]
    context.people.speak(sender.user, words)
    return {"message": ""}


class ReportVoice(ActionParameters):
    """Names that the browser has spoken to the person, and why it speaks none."""

    spoken: int = Field(ge=0, le=100)
    problem: VoiceProblem


async def _report_voice(context: ActionContext, sender: PageSender, report: ReportVoice) -> JsonObject:
    sentence = context.people.on_voice(sender.page, sender.user, report.spoken, report.problem)
    return {"message": sentence}


ARM_ACTIONS: tuple[Action[Any], ...] = (
    Action("press", "person", ArmPress, WRIST, _press),
    Action("step", "person", StepBeside, WRIST, _step),
    Action("take", "person", TakeArm, WRIST, _take),
    Action("give", "person", NoParameters, WRIST, _give),
    Action("tremor", "person", ArmTremor, CONTROL, _set_tremor),
    Action("centre", "person", NoParameters, WRIST, _centre),
    Action("report_voice", "person", ReportVoice, WRIST, _report_voice),
    Action("speak", "person", Speak, WRIST, _speak),
)
