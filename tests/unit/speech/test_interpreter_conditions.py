"""Conditions of spoken commands: robots, listeners, other people, rights."""

import asyncio

import pytest

from pointit.runtime.errors import AccessDeniedError
from pointit.schemas import Referent, Referents, SetThing, Speech, StopRobot, Word
from pointit.schemas.topics import ROBOT_STATE, SERVICE_ALIVE, SPEECH
from pointit.speech.interpreter import Interpreter
from tests.support.bench import background, in_virtual_time
from tests.unit.speech.spoken_room import HOSTILE, ROVER, USER, fired, room


@in_virtual_time
async def test_robots_are_known_before_words_are_and_stop_reaches_those_that_say_nothing() -> None:
    async with room() as here:
        here.bench.bus.announce(SERVICE_ALIVE, "robot.silent")
        here.bench.bus.announce(SERVICE_ALIVE, "robot.late")
        await here.bench.settle()
        interpreter = Interpreter(here.bench.bus, here.bench.clock, USER)
        waiting = asyncio.create_task(interpreter.wait_for_room(2.0))
        await asyncio.sleep(1.0)
        here.bench.put(ROBOT_STATE, ROVER, "late")
        await waiting
        assert ("late",) in interpreter.vocabulary.names
        here.say("stop", 0.0)
        await here.result()
        assert {name for name, _ in here.queries(StopRobot)} == {"late", "rover", "silent"}


@in_virtual_time
async def test_without_a_listener_it_says_how_to_start_one() -> None:
    async with room() as here:
        interpreter = Interpreter(here.bench.bus, here.bench.clock, "ben")
        now_ns = here.bench.clock.now_ns()
        words = tuple(Word(text=each, start_ns=now_ns, end_ns=now_ns) for each in ("take", "that"))
        async with background(interpreter.run()):
            here.bench.put(SPEECH, Speech(stamp_ns=now_ns, words=words), "ben")
            assert (await here.result()).message == (
                "nobody keeps where ben points: run `pointit service run listener --user ben`"
            )


@in_virtual_time
async def test_words_of_others_are_not_followed() -> None:
    async with room() as here:
        word = Word(text="stop", start_ns=1, end_ns=here.bench.clock.now_ns())
        here.bench.put(SPEECH, Speech(stamp_ns=1, words=(word,)), "ben")
        await here.bench.settle()
        assert not here.understood
        assert not here.asked


@in_virtual_time
@pytest.mark.parametrize(
    ("last", "result", "said"),
    [
        (HOSTILE, "done", "done so"),
        ("kettle", "refused", "kettle wants a press: point at it, and press the button"),
    ],
)
async def test_these_are_all_that_more_probably_were_swept_over_than_not(
    last: str, result: str, said: str
) -> None:
    async with room() as here:
        swept = {"radio": 0.9, last: 0.6, "lamp": 0.4}
        each = tuple(Referent(kind="thing", name=name, probability=p) for name, p in swept.items())
        here.found = {"these": Referents(candidates=each, none=0.02, rays=100)}
        here.say("take these")
        told = await here.result()
        assert (told.result, told.message) == (result, f"done so; {said}")
        assert [one.name for one in told.referents] == ["radio", last]
        both = [fired(name) for name in ("radio", HOSTILE)]
        assert [query for _, query in here.queries(SetThing)] == (both if result == "done" else both[:1])


@in_virtual_time
async def test_who_may_not_ask_is_not_told_to_start_a_listener(monkeypatch: pytest.MonkeyPatch) -> None:
    async def deny(*_about: object) -> None:
        raise AccessDeniedError("anna may not ask that")

    async with room() as here:
        monkeypatch.setattr(here.bench.bus, "call", deny)
        here.say("take that")
        assert (await here.result()).message == "anna may not ask that"
