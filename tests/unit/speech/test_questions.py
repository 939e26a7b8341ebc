"""Questions that a spoken command asks, and their answers; standard input."""

import asyncio
import os
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

import pytest

from pointit.schemas import NS_PER_S, ButtonEvent, SetLamp, SetThing, Speech, Word
from pointit.schemas.topics import BUTTON, SPEECH
from pointit.speech.audio import lines_of
from pointit.speech.grammar import SpokenRoom
from pointit.speech.interpreter import Question
from tests.support.bench import in_virtual_time, until
from tests.unit.speech.spoken_room import HOSTILE, USER, Room, either, fired, room


@asynccontextmanager
async def question(after_s: float = 0.0) -> AsyncGenerator[Room]:
    """Yield a room in which a question about two things was asked `after_s` ago."""
    async with room() as here:
        here.found = {"that": either("radio", HOSTILE)}
        here.say("take that")
        asked = await here.result()
        assert asked.result == "asked"
        assert asked.message == f"Radio or {HOSTILE}? Say yes, or press, while it blinks"
        await asyncio.sleep(after_s)
        yield here


def press(here: Room, ago_s: float = 0.0) -> None:
    stamp_ns = here.bench.clock.now_ns() - round(ago_s * NS_PER_S)
    here.bench.put(BUTTON, ButtonEvent(stamp_ns=stamp_ns, gesture="press"), USER)


@in_virtual_time
@pytest.mark.parametrize("by", ["yes", "press"])
@pytest.mark.parametrize(
    ("after_s", "told_s", "chosen"),
    [
        (1.0, 0.0, "radio"),
        (2.8, 1.0, "radio"),
        (3.1, 0.0, "radio"),
        (3.6, 1.0, HOSTILE),
        (12.2, 1.0, HOSTILE),
    ],
)
async def test_the_candidate_that_blinked_when_the_answer_began_is_confirmed(
    by: str, after_s: float, told_s: float, chosen: str
) -> None:
    """Two blink for 3 s each, twice; people take 0.3 s, and recognisers up to 1.5 s."""
    async with question(after_s + told_s) as here:
        if by == "yes":
            here.say("yes", told_s)
        else:
            press(here, told_s)
        done = await here.result(2)
        assert done.result == "done"
        assert here.queries(SetThing) == [(USER, fired(chosen))]
        last = dict(here.queries(SetLamp))
        assert all(query == SetLamp(color=None) for query in last.values()), "given back to the site"


@in_virtual_time
async def test_no_is_no_and_the_next_candidate_is_asked_about() -> None:
    async with question(0.5) as here:
        asked_ns = here.bench.clock.now_ns()
        here.say("no", 0.0)
        await until(lambda: any(name == "led_2" for name, _ in here.queries(SetLamp)))
        assert here.bench.clock.now_ns() - asked_ns < NS_PER_S, "at once"
        await asyncio.sleep(0.5)
        here.say("no that one is wrong", 0.0)
        assert (await here.result(2)).result == "refused"
        assert here.bench.clock.now_ns() - asked_ns < 2 * NS_PER_S, "neither is asked about again"
        assert here.queries(SetThing) == []


@in_virtual_time
@pytest.mark.parametrize(
    ("after_s", "text", "ago_s"),
    [
        *((1.0, text, 0.0) for text in ("the right one", "okay take this", HOSTILE.replace("-", " "))),
        (0.0, "okay", 0.6),  # was said before the question
        *((after_s, text, 0.0) for after_s in (0.0, 0.25) for text in ("yes", "")),
    ],
)
async def test_other_words_and_answers_before_the_light_confirm_nothing(
    after_s: float, text: str, ago_s: float
) -> None:
    async with question(after_s) as here:
        if text:
            here.say(text, ago_s)
        else:
            press(here)
        assert (await here.result(2)).result == "refused"
        assert here.queries(SetThing) == []


@in_virtual_time
async def test_denied_candidate_is_not_confirmed_by_the_next_answer() -> None:
    """The `no` of the first candidate is told when the second one blinks already."""
    async with question(3.1) as here:
        here.say("no", 1.0)
        here.say("yes", 0.0)
        assert (await here.result(2)).result == "refused"
        assert here.queries(SetThing) == []


@in_virtual_time
@pytest.mark.parametrize(
    ("said", "confirmed", "last"), [("yes", [HOSTILE], "led_2"), ("no", list[str](), "led_1")]
)
async def test_an_answer_begins_with_its_word(said: str, confirmed: list[str], last: str) -> None:
    """The sentence begins while the first candidate blinks, its last word when the second one does."""
    async with question(4.0) as here:
        now_ns = here.bench.clock.now_ns()
        words = tuple(
            Word(text=each, start_ns=now_ns - at * NS_PER_S // 2, end_ns=now_ns - at * NS_PER_S // 2)
            for at, each in ((4, "hmm"), (3, "that"), (0, said))
        )
        here.bench.put(SPEECH, Speech(stamp_ns=now_ns, words=words), USER)
        await here.result(2)
        assert here.queries(SetThing) == [(USER, fired(each)) for each in confirmed]
        assert here.queries(SetLamp)[-1][0] == last, "the other one is asked about after no"


@in_virtual_time
async def test_stop_after_yes_confirms_nothing_and_later_answers_neither() -> None:
    async with question(4.0) as here:
        here.say("yes", 0.0)
        here.say("yes", 2.0)
        await here.result(2)
        assert here.queries(SetThing) == [(USER, fired(HOSTILE))]
        here.say("take that")
        await here.result(3)
        await asyncio.sleep(1.0)
        here.say("yes", 0.0)
        here.say("stop", 0.0)
        await here.result(5)
        assert len(here.queries(SetThing)) == 1


@in_virtual_time
async def test_without_an_answer_nothing_is_done() -> None:
    async with question() as here:
        refused = await here.result(2)
        assert (refused.result, here.queries(SetThing)) == ("refused", [])
        assert "was confirmed" in refused.message


@in_virtual_time
async def test_stop_takes_back_an_answer_of_the_same_instant() -> None:
    async with room() as here:
        question = Question(here.bench.bus, here.bench.clock, USER, SpokenRoom())
        asking = asyncio.create_task(question.ask(either("radio", HOSTILE).candidates))
        await asyncio.sleep(1.0)
        assert question.answer("yes", here.bench.clock.now_ns())
        question.stop()
        assert await asking is None


async def test_silent_pipe_is_left_at_once_and_lines_are_whole() -> None:
    reads, writes = os.pipe()
    lines = lines_of(reads)
    os.write(writes, b"tak\xffe ")
    waiting = asyncio.ensure_future(anext(lines))
    await asyncio.sleep(0.02)
    os.write(writes, b"that\nth")
    assert await waiting == "tak\ufffde that"
    waiting = asyncio.ensure_future(anext(lines))
    await asyncio.sleep(0.02)
    waiting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await waiting
    os.close(reads)
    os.close(writes)
