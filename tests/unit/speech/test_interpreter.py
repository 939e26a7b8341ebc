"""Reactions to spoken commands: requests, questions by light, refusals, and any flood of words."""

import asyncio
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

import pytest

from pointit.cli.things.spoken import own_verbs
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import (
    NS_PER_S,
    Bay,
    Belt,
    ButtonEvent,
    Claim,
    Done,
    Environment,
    FindReferents,
    Lamp,
    Referent,
    Referents,
    RobotState,
    SelectionEvent,
    SendRobot,
    SetLamp,
    SetThing,
    Speech,
    StopRobot,
    Thing,
    TrackedObject,
    TrackedObjects,
    Understood,
    Word,
)
from pointit.schemas.topics import (
    BUTTON,
    CLAIM,
    FIND_REFERENTS,
    MAP,
    OBJECTS,
    ROBOT_STATE,
    SELECTION_EVENTS,
    SEND_ROBOT,
    SERVICE_ALIVE,
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
ROVER = RobotState(
    stamp_ns=1, kind="ground", phase="idle", position_m=PLACE, yaw_rad=0.0,
    velocity_mps=(0.0, 0.0, 0.0), radius_m=0.2,
)  # fmt: skip


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
        interpreter = Interpreter(bench.bus, bench.clock, USER, own_verbs(["heat kettle"]))
        box = {"center_m": (2.0, 0.0, 1.0), "size_m": (0.2, 0.2, 0.2)}
        things = (
            Thing(id="radio", label="Radio", lamp="led_1", mode="switch", **box),  # type: ignore[arg-type]
            Thing(id=HOSTILE, lamp="led_2", **box),  # type: ignore[arg-type]
            Thing(id="kettle", press=True, **box),  # type: ignore[arg-type]
        )
        lamps = tuple(Lamp(id=name, position_m=(2.0, 0.0, 1.0)) for name in ("led_1", "led_2"))
        belts = tuple(
            Belt(id=name, line_m=((0.0, 0.0, 1.0), (x, 2.0, 0.0))) for name, x in (("p", 1.0), ("q", 9.0))
        )
        bays = (Bay(id="1", belt="p"), Bay(id="3", belt="q"))
        bench.put(
            MAP, Environment(stamp_ns=1, name="room", lamps=lamps, things=things, belts=belts, bays=bays)
        )
        bench.put(ROBOT_STATE, ROVER, "rover")
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
    async with room() as here:
        here.found = {"that": either("radio", HOSTILE)}
        here.say("take that")
        asked = await here.result()
        assert asked.result == "asked"
        assert asked.message == f"Radio or {HOSTILE}? Say yes, or press, while it blinks"
        await asyncio.sleep(after_s + told_s)
        if by == "yes":
            here.say("yes", told_s)
        else:
            pressed_ns = here.bench.clock.now_ns() - round(told_s * NS_PER_S)
            here.bench.put(BUTTON, ButtonEvent(stamp_ns=pressed_ns, gesture="press"), USER)
        done = await here.result(2)
        assert done.result == "done"
        assert here.queries(SetThing) == [(USER, SetThing(thing=chosen))]
        last = dict(here.queries(SetLamp))
        assert all(query == SetLamp(color=None) for query in last.values()), "given back to the site"


@in_virtual_time
async def test_no_is_no_and_the_next_candidate_is_asked_about() -> None:
    async with room() as here:
        here.found = {"that": either("radio", HOSTILE)}
        here.say("take that")
        await here.result()
        await asyncio.sleep(0.5)
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
async def test_what_was_said_before_the_question_is_no_answer_to_it() -> None:
    async with room() as here:
        here.found = {"that": either("radio", HOSTILE)}
        here.say("take that")
        await here.result()
        here.say("okay", 0.6)
        assert (await here.result(2)).result == "refused"
        assert here.queries(SetThing) == []


@in_virtual_time
@pytest.mark.parametrize("after_s", [0.0, 0.25])
async def test_an_answer_that_began_before_the_light_could_be_seen_is_none(after_s: float) -> None:
    async with room() as here:
        here.found = {"that": either("radio", HOSTILE)}
        here.say("take that")
        await here.result()
        await asyncio.sleep(after_s)
        here.say("yes", 0.0)
        press = ButtonEvent(stamp_ns=here.bench.clock.now_ns(), gesture="press")
        here.bench.put(BUTTON, press, USER)
        assert (await here.result(2)).result == "refused"
        assert here.queries(SetThing) == []


@in_virtual_time
async def test_what_was_denied_is_not_confirmed_by_the_next_answer() -> None:
    """The `no` of the first candidate is told when the second one blinks already."""
    async with room() as here:
        here.found = {"that": either("radio", HOSTILE)}
        here.say("take that")
        await here.result()
        await asyncio.sleep(3.1)
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
    async with room() as here:
        here.found = {"that": either("radio", HOSTILE)}
        here.say("take that")
        await here.result()
        await asyncio.sleep(4.0)
        now_ns = here.bench.clock.now_ns()
        words = tuple(
            Word(text=each, start_ns=now_ns - at * NS_PER_S // 2, end_ns=now_ns - at * NS_PER_S // 2)
            for at, each in ((4, "hmm"), (3, "that"), (0, said))
        )
        here.bench.put(SPEECH, Speech(stamp_ns=now_ns, words=words), USER)
        await here.result(2)
        assert here.queries(SetThing) == [(USER, SetThing(thing=each)) for each in confirmed]
        assert here.queries(SetLamp)[-1][0] == last, "the other one is asked about after no"


@in_virtual_time
@pytest.mark.parametrize("text", ["the right one", "okay take this", HOSTILE.replace("-", " ")])
async def test_what_means_something_else_confirms_nothing(text: str) -> None:
    async with room() as here:
        here.found = {"that": either("radio", HOSTILE)}
        here.say("take that")
        await here.result()
        await asyncio.sleep(1.0)
        here.say(text, 0.0)
        assert (await here.result(2)).result == "refused"
        assert here.queries(SetThing) == []


@in_virtual_time
async def test_stop_after_yes_confirms_nothing_and_a_second_answer_changes_nothing() -> None:
    async with room() as here:
        here.found = {"that": either("radio", HOSTILE)}
        here.say("take that")
        await here.result()
        await asyncio.sleep(4.0)
        here.say("yes", 0.0)
        here.say("yes", 2.0)
        await here.result(2)
        assert here.queries(SetThing) == [(USER, SetThing(thing=HOSTILE))]
        here.say("take that")
        await here.result(3)
        await asyncio.sleep(1.0)
        here.say("yes", 0.0)
        here.say("stop", 0.0)
        await here.result(5)
        assert len(here.queries(SetThing)) == 1


@in_virtual_time
async def test_stop_is_of_what_was_said_before_it_too() -> None:
    async with room() as here:
        here.found = {"that": sure("robot", "rover"), "there": sure("place", "floor")}
        here.say("put that there", 0.1)
        here.say("go there", 0.1)
        here.say("stop", 0.0)
        here.say("take the radio", 0.0)
        await here.result(4)
        assert here.queries(SendRobot) == []
        assert [(each.command, each.result) for each in here.understood] == [
            ("stop", "done"), ("put", "refused"), ("send", "refused"), ("take", "done")
        ]  # fmt: skip


@in_virtual_time
async def test_all_words_are_looked_up_before_a_question_outlasts_the_memory_of_rays() -> None:
    async with room() as here:
        here.found = {"that": either("radio", HOSTILE), "there": sure("place", "floor")}
        here.say("put that there")
        await here.result()
        assert len(here.queries(FindReferents)) == 2
        here.found["there"] = Referents(none=1.0, rays=100)
        here.say("stop")
        here.say("put that there")
        await here.result(4)
        assert "where 'there' is, is not clear" in here.understood[3].message, "without a question before"


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


@pytest.mark.parametrize("text", ["stop", "no stop", "stop right there"])
@in_virtual_time
async def test_stop_stops_at_once_whatever_is_being_asked_and_however_late_it_is(text: str) -> None:
    async with room() as here:
        here.found = {"that": either("radio", HOSTILE)}
        here.say("take that")
        asked = await here.result()
        here.say(text, ago_s=60.0)
        stopped, unconfirmed = await here.result(2), await here.result(3)
        assert {stopped.command, unconfirmed.command} == {"stop", "take"}
        assert {stopped.result, unconfirmed.result} == {"done", "refused"}
        assert here.bench.clock.now_ns() - asked.stamp_ns < 2 * NS_PER_S, "nothing is asked about any more"
        assert [name for name, _ in here.queries(StopRobot)] == ["rover"]


@in_virtual_time
async def test_a_robot_that_refuses_to_stop_leaves_no_other_one_driving() -> None:
    async with room() as here:
        here.bench.put(ROBOT_STATE, ROVER, "a_rover")
        await here.bench.settle()
        here.refusal = "its driver is gone"
        here.say("stop")
        assert (await here.result()).message == "its driver is gone"
        assert [name for name, _ in here.queries(StopRobot)] == ["a_rover", "rover"]


@in_virtual_time
async def test_a_thing_is_not_stopped_but_the_robots_are_and_the_longest_words_are_followed_on() -> None:
    async with room() as here:
        here.say("stop the radio")
        await here.result()
        assert [name for name, _ in here.queries(StopRobot)] == ["rover"]
        here.say(" ".join(["take", *["x" * 64] * 63]))
        await here.result(2)
        here.say("turn the radio on")
        assert (await here.result(3)).result == "done"


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


class Conveyor:
    """Two packages, and a selector that grants all that nobody has; what is selected goes to bay 1."""

    def __init__(self, here: Room, refusal: str = "") -> None:
        self.here, self.refusal = here, refusal
        self.bays = {"red_7": "3", "blue_8": "3"}
        self.claims: list[Claim] = []
        here.bench.bus.subscribe(CLAIM, self._on_claim, USER)
        self.show()

    def show(self) -> None:
        objects = tuple(
            TrackedObject(id=k, kind=k[:-2], position_m=PLACE, bay=b) for k, b in self.bays.items()
        )
        now_ns = self.here.bench.clock.now_ns()
        self.here.bench.put(OBJECTS, TrackedObjects(stamp_ns=now_ns, objects=objects), "conveyor")

    def _on_claim(self, claim: Claim, user: str) -> None:
        self.claims.append(claim)
        name = claim.object_id
        event = SelectionEvent(
            stamp_ns=claim.stamp_ns, event="refused" if self.refusal else "selected", object_id=name,
            kind=name[:-2], user=user, reason=self.refusal,
        )  # fmt: skip
        self.here.bench.put(SELECTION_EVENTS, event)
        if not self.refusal:
            self.bays[name] = "1"
            self.show()


@in_virtual_time
async def test_a_package_is_claimed_as_by_pointing_and_sent_to_the_bay_that_is_meant() -> None:
    async with room() as here:
        conveyor = Conveyor(here)
        here.found = {"that": sure("object", "red_7"), "there": sure("place", "p")}
        here.say("put that there")
        done = await here.result()
        assert (done.result, done.message) == ("done", "red red_7 is anna's, and goes to bay 1")
        (claim,) = conveyor.claims
        assert (claim.wish, claim.action, claim.cause) == ("toggle", "select", "dwell")
        here.found = {"that": sure("object", "blue_8")}
        here.say("put that bay three")
        assert (await here.result(2)).message == "blue_8 goes to bay 3 already"
        here.say("take that")
        assert (await here.result(3)).message == "blue blue_8 is anna's"
        conveyor.refusal = "blue_8 is past its last way"
        here.say("take that")
        assert (await here.result(4)).message == conveyor.refusal
        here.found["that"] = sure("object", "gone_9")
        here.say("take that")
        assert (await here.result(5)).message == "gone_9 has left"
        conveyor.refusal, here.found["that"] = "", sure("object", "red_7")
        here.say("put that bay three")  # selected ones go to bay 1
        assert "goes to bay 1: the conveyor sends it there, not to 3" in (await here.result(6)).message


@in_virtual_time
async def test_a_verb_is_of_its_things_alone_and_what_wants_a_press_is_not_fired_by_words() -> None:
    async with room() as here:
        radio, kettle = (Referent(kind="thing", name=each, probability=0.48) for each in ("radio", "kettle"))
        here.found = {"that": Referents(candidates=(radio, kettle), none=0.04, rays=100)}
        here.say("heat that")
        done = await here.result()
        assert (done.command, done.result, done.message) == ("heat", "done", "heat kettle")
        here.say("heat the radio")
        assert (await here.result(2)).message == "nothing is attached to `heat` of Radio"
        here.say("turn that on")  # only one of them is a switch
        await here.result(3)
        here.say("take the kettle")
        assert (await here.result(4)).message == "kettle wants a press: point at it, and press the button"
        assert here.queries(SetThing) == [(USER, SetThing(thing="radio", on=True))]


@pytest.mark.parametrize(
    "text",
    ["heat", "heat the kettle=true", "heat2 kettle=true", "heat kettle=no-such-program", "stop kettle=true"],
)
def test_a_verb_that_cannot_be_used_is_refused(text: str) -> None:
    with pytest.raises(ConfigError):
        own_verbs([text])


@in_virtual_time
async def test_a_verb_of_a_thing_that_is_not_there_is_refused_with_those_that_are() -> None:
    async with room() as here:
        interpreter = Interpreter(here.bench.bus, here.bench.clock, USER, own_verbs(["heat kettel"]))
        with pytest.raises(ConfigError, match="the map has no thing 'kettel'; did you mean kettle"):
            await interpreter.wait_for_room(1.0)


@in_virtual_time
async def test_only_switches_are_turned_on_by_their_names_too() -> None:
    async with room() as here:
        here.say(f"turn the {HOSTILE.replace('-', ' ')} on")
        assert (await here.result()).message == f"{HOSTILE} is no switch: say `take that`"
        here.say("turn the raydio on")
        assert (await here.result(2)).message == "turn what on? point at it, and say `turn that on`"
        assert here.queries(SetThing) == []


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
async def test_words_of_others_are_not_followed() -> None:
    async with room() as here:
        word = Word(text="stop", start_ns=1, end_ns=here.bench.clock.now_ns())
        here.bench.put(SPEECH, Speech(stamp_ns=1, words=(word,)), "ben")
        await here.bench.settle()
        assert not here.understood
        assert not here.asked
