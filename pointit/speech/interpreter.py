"""Does what a person says while they point: words in, requests out, and what was understood."""

import asyncio
import contextlib
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from itertools import product

from pointit.errors import AccessDeniedError, ConfigError, NoAnswerError, RequestError
from pointit.runtime.bus.contract import Bus
from pointit.runtime.clock import Clock
from pointit.runtime.config.nearest_name import nearest
from pointit.schemas import (
    NS_PER_S,
    ButtonEvent,
    FindReferents,
    Referent,
    Referents,
    SetLamp,
    Speech,
    Understood,
)
from pointit.schemas.base import Rgb
from pointit.schemas.topics import (
    BUTTON,
    FIND_REFERENTS,
    MAP,
    OBJECTS,
    ROBOT_STATE,
    SET_LAMP,
    SPEECH,
    UNDERSTOOD,
)
from pointit.services.listener.referents import REACTION_S, WordDecision, decide
from pointit.site.following import follow_site
from pointit.site.site_state import Change, SiteState
from pointit.speech.grammar import PLACES, Answer, Command, Mention, SpokenRoom, Vocabulary, answer, parse
from pointit.speech.verbs import VERBS, Packages, Verb, VerbContext

TURN_S = 3.0
"""Time for which one candidate is asked about, s."""
LATE_S = 1.5
"""Time for which answers are awaited after the last turn, s: recognisers tell words when they are over."""
ROUNDS = 2
BLINKS = 6
"""Number of times that a lamp blinks in a turn."""
COLOR: Rgb = (255, 255, 255)

SETTLE_S = 0.4
"""Time after the last deictic word for which rays are awaited, s."""
LOOK_S = 0.2
"""Time in which the robots that are there are found, s."""
MAX_UTTERANCE_AGE_S = 8.0
"""Age of an utterance from which it is not followed."""
MAX_WAITING = 4
"""Number of utterances that may wait for an earlier one; further ones are refused."""
MAX_CHARACTERS = 4096
"""Largest length of `Understood.text`."""
AGAIN = "point at it, and say it again"


class Question:
    """Asks one question at a time."""

    def __init__(self, bus: Bus, clock: Clock, user: str, room: SpokenRoom) -> None:
        self._bus = bus
        self._clock = clock
        self._room = room
        self._turns: list[tuple[int, Referent]] = []
        """The candidates shown since the question began, each with the time of its first blink, ns."""
        self._remaining: list[Referent] = []
        """Candidates that may still be confirmed."""
        self._chosen: Referent | None = None
        self._answered = asyncio.Event()
        bus.subscribe(BUTTON, self._on_button, user)

    def answer(self, reply: Answer, at_ns: int) -> bool:
        """Answer what was shown at `at_ns`, when the answer began. Return False if nothing was asked then.

        A candidate that was denied is not confirmed, and an answer is not taken back.
        """
        decided_ns = at_ns - round(REACTION_S * NS_PER_S)
        shown = [candidate for since_ns, candidate in self._turns if since_ns <= decided_ns]
        if not shown:
            return False
        meant = shown[-1]
        if reply == "no":
            self._remaining = [candidate for candidate in self._remaining if candidate != meant]
        elif meant in self._remaining:
            self._remaining = []
            self._chosen = meant

        # The turn ends with the answer, unless the next candidate is shown already.
        is_present_turn = len(shown) == len(self._turns)
        if not self._remaining or is_present_turn:
            self._answered.set()
        return True

    def stop(self) -> None:
        """Ask no more: nothing is confirmed."""
        self._remaining = []
        self._chosen = None
        self._answered.set()

    def _on_button(self, event: ButtonEvent, _user: str) -> None:
        if event.gesture == "press":
            self.answer("yes", event.stamp_ns)

    async def ask(self, candidates: Sequence[Referent]) -> Referent | None:
        """Return the candidate that is confirmed in its turn, or None if none is."""
        self._remaining = list(candidates)
        self._chosen = None
        try:
            for candidate in [*candidates] * ROUNDS:
                if candidate in self._remaining:
                    await self._show_turn(candidate)
            # Recognisers report words when these are over: the last answer comes late.
            if self._remaining:
                await self._answer_within(LATE_S)
            return self._chosen
        finally:
            self._turns.clear()

    async def _show_turn(self, candidate: Referent) -> None:
        """Blink the lamp of a candidate until it is answered, or its turn is over."""
        self._turns.append((self._clock.now_ns(), candidate))
        blinking = asyncio.create_task(self._blink(self._room.lamp(candidate)))
        try:
            await self._answer_within(TURN_S)
        finally:
            blinking.cancel()
            await asyncio.wait({blinking})

    async def _answer_within(self, time_s: float) -> None:
        self._answered.clear()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(time_s / self._clock.speed):
                await self._answered.wait()

    async def _blink(self, lamp: str) -> None:
        """Blink a lamp, and give it back to the site. Without the right to set lamps, words alone ask."""
        if not lamp:
            return
        half_s = TURN_S / (2 * BLINKS) / self._clock.speed
        with contextlib.suppress(RequestError):
            try:
                for _ in range(BLINKS):
                    await self._bus.call(SET_LAMP, SetLamp(color=COLOR), lamp)
                    await asyncio.sleep(half_s)
                    await self._bus.call(SET_LAMP, SetLamp(color=(0, 0, 0)), lamp)
                    await asyncio.sleep(half_s)
            finally:
                await self._bus.call(SET_LAMP, SetLamp(color=None), lamp)


class NotUnderstood(Exception):  # noqa: N818 - no error of the program
    """A command that cannot be followed. The message has the reason and the remedy."""


class Interpreter:
    """Follows the words of one person."""

    def __init__(self, bus: Bus, clock: Clock, user: str, verbs: Mapping[str, Verb] | None = None) -> None:
        """Subscribe to the person's words; `verbs` replace or add some, each said by its name."""
        self._bus = bus
        self._clock = clock
        self._user = user
        self._room = room = SpokenRoom(SiteState(self._on_change))
        self._context = VerbContext(bus, clock, user, room, Packages(bus, clock, user, room))
        self._verbs: dict[str, Verb] = {**VERBS, **(verbs or {})}
        self._question = Question(bus, clock, user, room)
        self._waiting: deque[tuple[Speech, int]] = deque()
        self._stops = 0
        """Number of times that stop was said: what was said before, and waits, is not followed."""
        self._arrived = asyncio.Event()
        self._has_map = asyncio.Event()
        self._idle = asyncio.Event()
        self._idle.set()
        self._understood = bus.publisher(UNDERSTOOD, user)
        self._stopping = set[asyncio.Task[None]]()
        self._changed = asyncio.Event()
        self._count = 0
        self.on_understood: Callable[[Understood], None] = lambda _understood: None
        """Called with all that is published, and with what is ignored."""
        self._now_s = asyncio.get_running_loop().time
        follow_site(room.site, bus, self._now_s, (MAP, ROBOT_STATE, OBJECTS))
        bus.subscribe(SPEECH, self._on_speech, user)

    @property
    def vocabulary(self) -> Vocabulary:
        """Return the words of the room as far as it is known, for recognisers."""
        return Vocabulary(names=self._room.names, verbs=tuple(self._verbs.keys() - VERBS.keys()))

    async def wait_for_room(self, patience_s: float) -> None:
        """Wait until map and robots are known, or not longer than `patience_s`: names come from them.

        Raises:
            ConfigError: If a verb is of a thing that the map does not have.
        """
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(patience_s):
                await self._has_map.wait()
                await asyncio.sleep(LOOK_S)
                while self._room.present_robots - self._room.robots.keys():
                    self._changed.clear()
                    await self._changed.wait()
        things = {thing.id for thing in self._room.things}
        things_of_verbs = set[str]().union(*(verb.things for verb in self._verbs.values()))
        for thing in things_of_verbs - things:
            if things:  # without any, the map is not known yet
                raise ConfigError(f"the map has no thing {thing!r}; {nearest(thing, sorted(things))}")

    async def finish(self, count: int) -> None:
        """Wait until `count` utterances have come, and none is being followed."""
        while self._count < count or not self._idle.is_set() or self._stopping:
            self._changed.clear()
            await self._changed.wait()

    async def run(self) -> None:
        """Follow utterances, one after the other, until cancelled."""
        while True:
            while self._waiting:
                await self._follow(*self._waiting[0])
                self._waiting.popleft()
            self._idle.set()
            self._changed.set()
            self._arrived.clear()
            await self._arrived.wait()

    def _on_change(self, change: Change) -> None:
        if change.topic is MAP:
            self._has_map.set()
        self._changed.set()

    def _on_speech(self, speech: Speech, _user: str) -> None:
        if not speech.is_final or not speech.words:
            return
        self._room.site.tick(self._now_s())
        self._count += 1
        self._changed.set()
        command = parse(speech.words, self.vocabulary)
        if command is not None and command.verb == "stop":  # also in "no, stop", and "stop right there"
            self._follow_stop(speech)
            return
        if self._is_answer(speech, command):
            return
        if len(self._waiting) >= MAX_WAITING:
            self._publish(speech, command, (), "refused", "too many words at once: say it again, slowly")
            return
        self._waiting.append((speech, self._stops))
        self._idle.clear()
        self._arrived.set()

    def _is_answer(self, speech: Speech, command: Command | None) -> bool:
        """Answer the open question, if the words do. "Yes" before a command about something else does not."""
        reply = answer(speech.words)
        if reply is None:
            return False
        meaning, at_ns = reply
        has_mentions = command is not None and bool(command.mentions)
        if has_mentions and meaning == "yes":
            return False
        return self._question.answer(meaning, at_ns)

    def _follow_stop(self, speech: Speech) -> None:
        """Follow "stop" at once: it waits for no earlier utterance, and ends what was said before."""
        self._stops += 1
        self._question.stop()
        stopping = asyncio.get_running_loop().create_task(self._follow(speech, self._stops))
        self._stopping.add(stopping)
        stopping.add_done_callback(self._on_stopped)

    def _on_stopped(self, task: asyncio.Task[None]) -> None:
        self._stopping.discard(task)
        self._changed.set()

    async def _follow(self, speech: Speech, stops: int) -> None:
        command = parse(speech.words, self.vocabulary)
        if command is None:
            self._publish(speech, None, (), "ignored", "")
            return
        resolved: list[Referent] = []
        try:
            self._check_command(speech, command)
            await self._settle(command)
            # All mentions are looked up before the first question: it outlasts the memory of rays.
            all_decisions = [await self._decide(command, mention) for mention in command.mentions]
            decisions = [self._possible(command, all_decisions, index) for index in range(len(all_decisions))]
            all_referents: list[Sequence[Referent]] = []
            for decision in decisions:
                self._check_not_stopped(command, stops)
                referents = await self._resolve(speech, command, decision, resolved)
                all_referents.append(referents)
                resolved.extend(referents)
            message = await self._act(command, all_referents, stops)
        except (NotUnderstood, RequestError) as error:
            self._publish(speech, command, resolved, "refused", str(error))
        else:
            self._publish(speech, command, resolved, "done", message)

    async def _act(self, command: Command, all_referents: Sequence[Sequence[Referent]], stops: int) -> str:
        """Do a command for each of what its words mean, and return what was done, also if it ends halfway."""
        done: list[str] = []
        try:
            for referents in product(*all_referents):
                self._check_not_stopped(command, stops)
                done.append(await self._verbs[command.verb].act(self._context, command, referents))
        except (NotUnderstood, RequestError) as error:
            raise NotUnderstood("; ".join([*done, str(error)])) from error
        return "; ".join(done)

    def _check_command(self, speech: Speech, command: Command) -> None:
        """Check the age of the words, and that they name all that the verb needs."""
        age_s = (self._clock.now_ns() - speech.words[-1].end_ns) / NS_PER_S
        if age_s > MAX_UTTERANCE_AGE_S and command.verb != "stop":
            raise NotUnderstood(f"that was said {age_s:.0f} s ago: say it again")
        problem = self._verbs[command.verb].problem(self._context, command, ())
        if problem:
            raise NotUnderstood(problem)

    def _check_not_stopped(self, command: Command, stops: int) -> None:
        if command.verb != "stop" and stops != self._stops:
            raise NotUnderstood("stop was said after it: say it again")

    async def _settle(self, command: Command) -> None:
        """Wait until the rays after the last deictic word are there."""
        last_ns = max((mention.at_ns for mention in command.mentions), default=0)
        wait_s = SETTLE_S - (self._clock.now_ns() - last_ns) / NS_PER_S
        if last_ns and wait_s > 0.0:
            await asyncio.sleep(min(wait_s, 2.0 * SETTLE_S) / self._clock.speed)

    async def _decide(self, command: Command, mention: Mention) -> WordDecision:
        """Return the referent of a mention, or those to ask about."""
        if mention.name:
            return WordDecision("act", (self._room.named(mention.name),))
        # The listener keeps the person's rays: it says what they pointed at during the deictic word.
        reply = await self._find_referents(command, mention)
        is_place = mention is command.to and mention.word in PLACES
        if is_place:
            decision = decide(reply, ("place",))
        else:
            verb = self._verbs[command.verb]
            things = verb.things or None
            if command.verb in ("on", "off"):
                things = self._room.switches
            decision = decide(reply, verb.kinds, things, several=mention.word == "these")

        # Nothing blinks at a place, so that nobody can confirm one.
        is_unclear = decision.do == "refuse" or (decision.do == "ask" and is_place)
        if is_unclear:
            question = "where" if is_place else "what"
            raise NotUnderstood(reply.message or f"{question} {mention.word!r} is, is not clear: {AGAIN}")
        return decision

    async def _find_referents(self, command: Command, mention: Mention) -> Referents:
        """Return the candidates for a deictic word: all that the person may have meant."""
        others_ns: list[int] = []
        for other in command.mentions:
            if not other.name and other.at_ns != mention.at_ns:
                others_ns.append(other.at_ns)
        query = FindReferents(at_ns=mention.at_ns, word=mention.word, others_ns=tuple(others_ns))
        try:
            return await self._bus.call(FIND_REFERENTS, query, self._user)
        except AccessDeniedError:
            raise
        except NoAnswerError as error:
            remedy = f"run `pointit service run listener --user {self._user}`"
            raise NotUnderstood(f"nobody keeps where {self._user} points: {remedy}") from error

    def _possible(self, command: Command, decisions: Sequence[WordDecision], index: int) -> WordDecision:
        """Return a decision without the candidates about which asking leads to a refusal.

        Raises:
            NotUnderstood: If none is left.
        """
        decision = decisions[index]
        if decision.do != "ask":
            return decision
        check = self._verbs[command.verb].problem
        referents = [other.candidates[0] for other in decisions]
        possible: list[Referent] = []
        problems: list[str] = []
        for candidate in decision.candidates:
            referents[index] = candidate
            problem = check(self._context, command, tuple(referents))
            if problem:
                problems.append(problem)
            else:
                possible.append(candidate)
        if not possible:
            raise NotUnderstood(problems[0])
        return WordDecision("ask", possible)

    async def _resolve(
        self, speech: Speech, command: Command, decision: WordDecision, resolved: Sequence[Referent]
    ) -> Sequence[Referent]:
        """Return the referents of a decision. The person is asked if it is not clear which one they meant.

        `resolved` are the referents of earlier mentions.
        """
        if decision.do == "act":
            return decision.candidates
        if command.verb == "what":  # says how sure it is
            return decision.candidates[:1]
        labels = [self._room.label(candidate) for candidate in decision.candidates]
        question = f"{' or '.join(labels)}? Say yes, or press, while it blinks"
        self._publish(speech, command, (*resolved, *decision.candidates), "asked", question)
        chosen = await self._question.ask(decision.candidates)
        if chosen is not None:
            return (chosen,)
        text = f"{labels[0]} was not"
        if len(labels) > 1:
            text = f"neither {' nor '.join(labels)} was"
        raise NotUnderstood(f"{text} confirmed: {AGAIN}")

    def _publish(
        self,
        speech: Speech,
        command: Command | None,
        referents: Sequence[Referent],
        result: str,
        message: str,
    ) -> None:
        understood = Understood.model_validate(
            {
                "stamp_ns": speech.stamp_ns,
                "text": " ".join(word.text for word in speech.words)[:MAX_CHARACTERS],
                "command": "" if command is None else command.verb,
                "referents": tuple(referents),
                "result": result,
                "message": message,
            }
        )
        if result != "ignored":  # what is no command concerns nobody else
            self._understood.put(understood)
        self.on_understood(understood)
