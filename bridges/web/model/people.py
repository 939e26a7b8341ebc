"""People present, and what this server publishes for them: presses, words, wrist samples, poses.

No core: it publishes for people and keeps time.
"""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from pointit.bridges.web.wrists.wrist_control import WristControl
from pointit.runtime.bus.contract import Publisher
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.clock import Clock
from pointit.runtime.errors import RefusedError
from pointit.schemas import NS_PER_S, ButtonEvent, Speech, Step, UserPose, Word, WristSample
from pointit.schemas.person import Gesture
from pointit.schemas.problems import NAMES_SPOKEN, VOICE
from pointit.schemas.topics import BUTTON, POSE, SPEECH, STEP, WRIST

VoiceProblem = Literal["", "none", "language", "silent"]

BROWSER = "browser"
"""Name of the recogniser of people's browsers in messages."""
VOICE_PROBLEMS: Mapping[VoiceProblem, str] = {
    "none": "the browser has no voices; open the page in another browser, or use --announce speaker",
    "language": "the browser has no voice of the language; choose another one in its settings",
    "silent": "the browser speaks nothing; click the page or press a key, and see whether its sound is on",
}
"""Reasons why a page's names are not heard, and the remedies."""

WRIST_PERIOD_S = 1.0 / 60.0
"""Period of the samples of wrists that a page moves, s of wall time."""


class Writers(NamedTuple):
    """Publishers of one person."""

    button: Publisher[ButtonEvent]
    step: Publisher[Step]
    wrist: Publisher[WristSample]
    speech: Publisher[Speech]


class PagePeople:
    """Publishes buttons, wrists and words of people who are present."""

    def __init__(self, bus: ServiceBus, clock: Clock) -> None:
        self._bus = bus
        self._clock = clock
        self._writers: dict[str, Writers] = {}
        self._presses = self._steps = self._spoken = 0
        self._voices: dict[str, tuple[str, VoiceProblem]] = {}
        """By page: its person, and why they hear nothing."""
        self._poses: dict[str, Publisher[UserPose]] = {}
        """Poses of people who wear a headset."""
        self.states: dict[str, str] = {}
        """State of the interaction by user, where known."""

    @property
    def names(self) -> list[str]:
        """Return the users who are present."""
        return sorted(self._writers)

    def on_join(self, user: str) -> None:
        """Add `user`."""
        if user not in self._writers:
            publisher = self._bus.publisher
            self._writers[user] = Writers(
                publisher(BUTTON, user),
                publisher(STEP, user),
                publisher(WRIST, user),
                publisher(SPEECH, user),
            )

    def on_leave(self, user: str) -> None:
        """Remove `user`."""
        self.states.pop(user, None)
        pages = [page for page, (listener, _) in self._voices.items() if listener == user]
        for page in pages:
            self.forget_voice(page)
        pose_publisher = self._poses.pop(user, None)
        if pose_publisher is not None:
            pose_publisher.close_nowait()
        for writer in self._writers.pop(user, ()):
            writer.close_nowait()

    def check(self, user: str) -> None:
        """Check that `user` is present.

        Raises:
            RefusedError: If they are not; names those present.
        """
        if user not in self._writers:
            present = ", ".join(self.names) or "nobody"
            raise RefusedError(f"{user} is not there; there: {present}")

    def press(
        self, user: str, gesture: Gesture = "press", *, source: str = "page", held_s: float = 0.0
    ) -> None:
        """Press the button of `user`, who must be present. It went down `held_s` of wall time ago."""
        self._presses += 1
        held_ns = round(held_s * self._clock.speed * NS_PER_S)
        down_ns = max(0, self._clock.now_ns() - held_ns)
        event = ButtonEvent(stamp_ns=down_ns, seq=self._presses, gesture=gesture, source=source)
        self._writers[user].button.put(event)

    def step(
        self, user: str, by: Literal[-1, 1], to: Literal["beside", "row", "here"], *, source: str = "page"
    ) -> None:
        """Move `user`, who must be present, from the announced thing to another, or to the nearest."""
        self._steps += 1
        now_ns = self._clock.now_ns()
        step = Step(stamp_ns=now_ns, seq=self._steps, by=by, to=to, source=source)
        self._writers[user].step.put(step)

    def on_voice(self, page: str, user: str, spoken: int, problem: VoiceProblem) -> str:
        """Count names that `page` has spoken to `user`. Return why they hear nothing, or `""`."""
        self._spoken += spoken
        self._bus.set_metric(NAMES_SPOKEN, self._spoken)
        self._voices[page] = user, problem
        return self._report_voice(user)

    def forget_voice(self, page: str) -> None:
        """Forget the voice of a page that has ended."""
        if page in self._voices:
            user, _ = self._voices.pop(page)
            self._report_voice(user)

    def _report_voice(self, user: str) -> str:
        """Warn if no page of `user` is heard. Return the sentence, or `""`."""
        problems = [problem for listener, problem in self._voices.values() if listener == user]
        sentence = ""
        if problems and "" not in problems:
            sentence = f"{user} hears no names: {VOICE_PROBLEMS[problems[-1]]}"
        self._bus.warn(VOICE, sentence, user)
        return sentence

    def speak(self, user: str, words: Sequence[Mapping[str, Any]]) -> None:
        """Publish words of `user`, who must be present; `words` have ages of wall time, s."""
        now_ns = self._clock.now_ns()
        speed = self._clock.speed

        def stamped(word: Mapping[str, Any]) -> Word:
            start_ns = now_ns - round(word["start_s"] * speed * NS_PER_S)
            end_ns = now_ns - round(word["end_s"] * speed * NS_PER_S)
            return Word(text=word["text"], start_ns=start_ns, end_ns=end_ns, confidence=word["confidence"])

        stamped_words = tuple(stamped(word) for word in words)
        stamp_ns = stamped_words[-1].end_ns
        speech = Speech(stamp_ns=stamp_ns, words=stamped_words, recogniser=BROWSER)
        self._writers[user].speech.put(speech)

    def move(self, user: str, sample: WristSample) -> None:
        """Publish the orientation of the wrist of `user` if they are present."""
        writers = self._writers.get(user)
        if writers is not None:
            writers.wrist.put(sample)

    def place(self, user: str, pose: UserPose) -> None:
        """Publish the pose of `user`, who wears a headset, if they are present."""
        if user in self._writers:
            if user not in self._poses:
                self._poses[user] = self._bus.publisher(POSE, user)
            self._poses[user].put(pose)

    def withdraw_poses(self, is_headset: Callable[[str], bool]) -> None:
        """Withdraw the poses of people who wear no headset any more."""
        users = [user for user in self._poses if not is_headset(user)]
        for user in users:
            self._poses.pop(user).close()


@dataclass(kw_only=True)
class WristMotion:
    """Publishes samples of wrists; rests while no page holds one."""

    wrists: WristControl
    people: PagePeople
    clock: Clock
    ended: Callable[[], None]
    """Called when no page holds a wrist any more."""
    _moving: asyncio.Event = field(default_factory=asyncio.Event)

    def wake(self) -> None:
        """Start if a page holds a wrist."""
        if self._is_needed:
            self._moving.set()

    async def run(self) -> None:
        """Move until cancelled, by wall time."""
        while True:
            await self._moving.wait()
            samples = self.wrists.step(self.clock.now_ns(), self.clock.speed)
            for user, sample in samples:
                self.people.move(user, sample)
            self.people.withdraw_poses(self._wears_headset)
            # After the step, which notices that a page has let go
            if not self._is_needed:
                self._moving.clear()
                self.ended()
            await asyncio.sleep(WRIST_PERIOD_S)

    def _wears_headset(self, user: str) -> bool:
        _, mover = self.wrists.holder(user)
        return mover == "headset"

    @property
    def _is_needed(self) -> bool:
        for user in self.people.names:
            page, _ = self.wrists.holder(user)
            if page:
                return True
        return False
