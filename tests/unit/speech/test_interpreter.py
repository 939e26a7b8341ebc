"""Reactions to spoken commands: requests, questions by light, refusals, and any flood of words."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

import pytest

from pointit.runtime.errors import RefusedError
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import (
    NS_PER_S,
    ButtonEvent,
    Done,
    Environment,
    FindReferents,
    Lamp,
    Referent,
    Referents,
    RobotState,
    SendRobot,
    SetLamp,
    SetThing,
    Speech,
    StopRobot,
    Thing,
    Understood,
    Word,
)
from pointit.schemas.topics import (
    BUTTON,
    FIND_REFERENTS,
    MAP,
    ROBOT_STATE,
    SEND_ROBOT,
    SET_LAMP,
    SET_THING,
    SPEECH,
    STOP_ROBOT,
    UNDERSTOOD,
)
from pointit.speech.interpreter import MOST_WAITING, Interpreter
from tests.support.bench import Bench, background, in_virtual_time, memory_bench, until

USER = "anna"
PLACE = (1.0, 2.0, 0.0)
HOSTILE = "yes-send-all-robots"


class Room:
    """A room whose services note what they are asked."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.asked: list[tuple[str, object]] = []
        self.found: dict[str, Referents] = {}
        self.understood = bench.collect(UNDERSTOOD)
        self.refusal = ""
        bus = bench.bus
        bus.serve(FIND_REFERENTS, self._referents, USER)
        bus.serve(SET_THING, self._note, USER)
        bus.serve(SEND_ROBOT, self._note, USER)
        bus.serve(SET_LAMP, self._note)
        bus.serve(STOP_ROBOT, self._note)

    async def _referents(self, query: FindReferents, _user: str) -> Referents:
        self.asked.append(("referents", query))
        return self.found.get(query.word, Referents(message="no rays at that time"))

    async def _note(self, query: object, name: str) -> Done:
        self.asked.append((name, query))
        if self.refusal:
            raise RefusedError(self.refusal)
        return Done(message="done so")

    def say(self, text: str, ago_s: float = 0.5, *, is_final: bool = True) -> None:
        now_ns = self.bench.clock.now_ns() - round(ago_s * NS_PER_S)
        begins_ns = [now_ns + index * NS_PER_S // 10 for index in range(len(text.split()))]
        words = tuple(
            Word(text=each, start_ns=begin_ns, end_ns=begin_ns + NS_PER_S // 10)
            for each, begin_ns in zip(text.split(), begins_ns, strict=True)
        )
        self.bench.put(SPEECH, Speech(stamp_ns=now_ns, words=words, is_final=is_final), USER)

    async def result(self, count: int = 1) -> Understood:
        await until(lambda: len(self.understood) >= count)
        return self.understood[count - 1]

    def queries(self, kind: type[object]) -> list[tuple[str, object]]:
        return [(name, query) for name, query in self.asked if isinstance(query, kind)]


@asynccontextmanager
async def room() -> AsyncGenerator[Room]:
    async with memory_bench(VirtualClock()) as bench:
        here = Room(bench)
        interpreter = Interpreter(bench.bus, bench.clock, USER)
        box = {"center_m": (2.0, 0.0, 1.0), "size_m": (0.2, 0.2, 0.2)}
        things = (
            Thing(id="radio", label="Radio", lamp="led_1", mode="switch", **box),  # type: ignore[arg-type]
            Thing(id=HOSTILE, lamp="led_2", **box),  # type: ignore[arg-type]
        )
        lamps = tuple(Lamp(id=name, position_m=(2.0, 0.0, 1.0)) for name in ("led_1", "led_2"))
        bench.put(MAP, Environment(stamp_ns=1, name="room", lamps=lamps, things=things))
        rover = RobotState(
            stamp_ns=1, kind="ground", phase="idle", position_m=PLACE, yaw_rad=0.0,
            velocity_mps=(0.0, 0.0, 0.0), radius_m=0.2,
        )  # fmt: skip
        bench.put(ROBOT_STATE, rover, "rover")
        await bench.settle()
        async with background(interpreter.run()):
            yield here


def sure(kind: str, name: str) -> Referents:
    one = Referent.model_validate({"kind": kind, "name": name, "probability": 0.95, "place_m": PLACE})
    return Referents(candidates=(one,), none=0.05, rays=100)


def either(*names: str) -> Referents:
    candidates = tuple(Referent(kind="thing", name=name, probability=0.45) for name in names)
    return Referents(candidates=candidates, none=0.1, rays=100)


@in_virtual_time
async def test_put_that_there_sends_the_robot_to_the_place_by_the_checked_request() -> None:
    async with room() as here:
        here.found = {"that": sure("robot", "rover"), "there": sure("place", "floor")}
        here.say("put that there")
        done = await here.result()
        assert (done.command, done.result, done.message) == ("put", "done", "done so")
        assert [one.name for one in done.referents] == ["rover", "floor"]
        assert here.queries(SendRobot) == [(USER, SendRobot(position_m=PLACE, robot="rover"))]
        first, second = (query for _, query in here.queries(FindReferents))
        assert isinstance(first, FindReferents)
        assert isinstance(second, FindReferents)
        assert (first.others_ns, second.others_ns) == ((second.at_ns,), (first.at_ns,))


@in_virtual_time
async def test_what_the_goal_service_refuses_is_said_and_not_done() -> None:
    async with room() as here:
        here.found, here.refusal = ({"there": sure("place", "floor")}, "you are not pointing")
        here.say("go there")
        said = await here.result()
        assert (said.result, said.message) == ("refused", here.refusal)


@in_virtual_time
async def test_things_are_switched_by_pointing_and_by_name() -> None:
    async with room() as here:
        here.found = {"that": sure("thing", "radio")}
        here.say("turn that on")
        await here.result()
        here.say("turn the radio off")
        await here.result(2)
        here.say("take that")
        await here.result(3)
        asked = [query for _, query in here.queries(SetThing)]
        assert asked == [SetThing(thing="radio", on=on) for on in (True, False, None)]


@in_virtual_time
@pytest.mark.parametrize("by", ["yes", "press"])
async def test_two_candidates_blink_in_turn_and_the_second_is_confirmed(by: str) -> None:
    async with room() as here:
        here.found = {"that": either("radio", HOSTILE)}
        here.say("take that")
        asked = await here.result()
        assert asked.result == "asked"
        assert asked.message == f"Radio or {HOSTILE}? Say yes, or press, while it blinks"
        await until(lambda: any(name == "led_2" for name, _ in here.queries(SetLamp)))
        if by == "yes":
            here.say("yes", 0.0)
        else:
            here.bench.put(BUTTON, ButtonEvent(stamp_ns=here.bench.clock.now_ns(), gesture="press"), USER)
        done = await here.result(2)
        assert done.result == "done"
        assert here.queries(SetThing) == [(USER, SetThing(thing=HOSTILE))]
        last = dict(here.queries(SetLamp))
        assert last == {lamp: SetLamp(color=None) for lamp in ("led_1", "led_2")}, "given back to the site"


@in_virtual_time
async def test_no_is_no_and_the_next_candidate_is_asked_about() -> None:
    async with room() as here:
        here.found = {"that": either("radio", HOSTILE)}
        here.say("take that")
        await here.result()
        asked_ns = here.bench.clock.now_ns()
        here.say("no", 0.0)
        await until(lambda: any(name == "led_2" for name, _ in here.queries(SetLamp)))
        assert here.bench.clock.now_ns() - asked_ns < NS_PER_S, "at once"
        assert here.queries(SetThing) == []


@in_virtual_time
async def test_without_an_answer_nothing_is_done() -> None:
    async with room() as here:
        here.found = {"that": either("radio", HOSTILE)}
        here.say("take that")
        refused = await here.result(2)
        assert (refused.result, here.queries(SetThing)) == ("refused", [])
        assert "was confirmed" in refused.message


@in_virtual_time
async def test_what_is_unclear_or_without_rays_is_refused_with_the_reason() -> None:
    async with room() as here:
        here.say("take that")
        assert (await here.result()).message == "no rays at that time"
        here.found = {"that": Referents(none=1.0, rays=100)}
        here.say("take that")
        assert "point at it, and say it again" in (await here.result(2)).message
        here.say("take that", ago_s=60.0)
        assert "s ago: say it again" in (await here.result(3)).message
        here.say("hello there")
        here.say("take that", ago_s=60.0)
        assert (await here.result(4)).text == "take that", "what is no command is not published"


@in_virtual_time
async def test_stop_stops_at_once_whatever_is_being_asked() -> None:
    async with room() as here:
        here.found = {"that": either("radio", HOSTILE)}
        here.say("take that")
        await here.result()
        here.say("stop")
        stopped = await here.result(2)
        assert (stopped.command, stopped.result) == ("stop", "done")
        assert [name for name, _ in here.queries(StopRobot)] == ["rover"]


@in_virtual_time
async def test_what_is_not_final_waits_and_a_flood_of_words_is_bounded() -> None:
    async with room() as here:
        here.say("stop", is_final=False)
        await here.bench.settle()
        assert here.understood == []
        here.found = {"that": either("radio", HOSTILE)}
        for _ in range(200):  # of 50 words: 10 000 words
            here.say("take that " + "word " * 48)
        await until(lambda: len(here.understood) >= 200 - MOST_WAITING)
        flooded = [one for one in here.understood if "too many words" in one.message]
        assert len(flooded) >= 200 - MOST_WAITING - 1
        here.say("what is that")
        assert (await here.result(len(here.understood) + 1)).result in ("refused", "done")


@in_virtual_time
async def test_words_of_others_are_not_followed() -> None:
    async with room() as here:
        word = Word(text="stop", start_ns=1, end_ns=here.bench.clock.now_ns())
        here.bench.put(SPEECH, Speech(stamp_ns=1, words=(word,)), "ben")
        await here.bench.settle()
        assert not here.understood
        assert not here.asked
