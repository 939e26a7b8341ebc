"""Sentences and what they do, with conditions."""

import asyncio

import pytest

from pointit.cli.things.listen import own_verbs
from pointit.runtime.errors import AccessDeniedError, ConfigError
from pointit.schemas import (
    NS_PER_S,
    Claim,
    FindReferents,
    Referent,
    Referents,
    SelectionEvent,
    SendRobot,
    SetThing,
    Speech,
    StopRobot,
    TrackedObject,
    TrackedObjects,
    Word,
)
from pointit.schemas.topics import CLAIM, OBJECTS, ROBOT_STATE, SELECTION_EVENTS, SERVICE_ALIVE, SPEECH
from pointit.speech.interpreter import MAX_WAITING, Interpreter
from tests.support.bench import background, in_virtual_time, until
from tests.unit.speech.spoken_room import HOSTILE, PLACE, ROVER, USER, Room, either, fired, room, sure


@in_virtual_time
async def test_put_that_there_sends_the_robot_by_the_checked_request() -> None:
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
async def test_all_mentions_are_looked_up_before_the_first_question() -> None:
    async with room() as here:
        here.found = {"that": either("rover", "cart", kind="robot"), "there": sure("place", "floor")}
        here.say("put that there")
        await here.result()
        assert len(here.queries(FindReferents)) == 2
        here.found["there"] = Referents(none=1.0, rays=100)
        here.say("stop")
        here.say("put that there")
        await here.result(4)
        assert "where 'there' is, is not clear" in here.understood[3].message, "without a question before"


def unsure(*candidates: Referents) -> Referents:
    """Return the candidates of all, none of which is sure."""
    listed = tuple(one for each in candidates for one in each.candidates)
    return Referents(candidates=listed, none=0.25, rays=100)


TWO = unsure(either("radio", HOSTILE))
ANSWERS: list[tuple[str, Referents | None, str, str]] = [
    ("put that there", TWO, "refused", "Radio is no robot, and nothing is attached to moving it"),
    ("put that", TWO, "refused", "where to? say `there` while you point at the place"),
    (
        "take that", unsure(either("kettle")), "refused",
        "kettle wants a press: point at it, and press the button"),
    (
        "put that there", unsure(either("radio"), either("rover", kind="robot")), "asked",
        "rover? Say yes, or press, while it blinks"),
    (
        f"turn the {HOSTILE.replace('-', ' ')} on", None, "refused",
        f"{HOSTILE} is no switch: say `take that`"),
    (
        "turn the raydio on", None, "refused",
        "nothing here is called 'raydio': did you mean radio? or point at it, and say `turn that on`"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "that", "result", "message"), ANSWERS)
@in_virtual_time
async def test_candidates_that_would_be_refused_are_not_asked_about(
    text: str, that: Referents | None, result: str, message: str
) -> None:
    async with room() as here:
        here.found = {"there": sure("place", "floor")} | ({} if that is None else {"that": that})
        here.say(text)
        said = await here.result()
        assert (said.result, said.message) == (result, message)
        assert here.queries(SetThing) == here.queries(SendRobot) == []


@in_virtual_time
async def test_refusal_by_the_goal_service_is_reported() -> None:
    async with room() as here:
        here.found = {"there": sure("place", "floor")}
        here.refusal = "you are not pointing"
        here.say("go there")
        said = await here.result()
        assert (said.result, said.message) == ("refused", here.refusal)


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("take the hammer", "hammer"),
        ("take hammer", "hammer"),
        ("put the hammer there", "hammer"),
        ("put hammer there", "hammer"),
        ("send the big crane there", "big crane"),
        ("what is the time", "time"),
        ("heat my soup please", "soup"),
        ("turn on the lights", "lights"),
        ("turn the lights off", "lights"),
    ],
)
@in_virtual_time
async def test_unknown_name_is_reported_and_no_robot_is_sent(text: str, name: str) -> None:
    async with room() as here:
        here.found["there"] = sure("place", "floor")
        here.say(text)
        said = await here.result()
        assert said.result == "refused"
        assert said.message.startswith(f"nothing here is called {name!r}: name one of bay 1, bay 3, kettle,")
        assert here.queries(SendRobot) == []


@pytest.mark.parametrize("text", ["go straight over there", "put it there now", "drive to the door there"])
@in_virtual_time
async def test_words_that_are_no_object_do_not_stop_a_robot(text: str) -> None:
    async with room() as here:
        here.found["there"] = sure("place", "floor")
        here.say(text)
        assert (await here.result()).result == "done"


@in_virtual_time
async def test_referents_probability_is_relative_to_candidates_of_the_right_kind() -> None:
    async with room() as here:
        floor = Referent(kind="place", name="floor_2", probability=0.04, place_m=PLACE)
        near = Referent(kind="thing", name="radio", probability=0.955)
        here.found["there"] = Referents(candidates=(near, floor), none=0.005, rays=100)
        here.say("go there")
        done = await here.result()
        assert (done.result, [one.name for one in done.referents]) == ("done", ["floor_2"])
        assert done.referents[0].probability > 0.85


@in_virtual_time
async def test_unclear_command_is_refused_with_the_reason() -> None:
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
async def test_stop_is_obeyed_at_once_during_questions_and_when_late(text: str) -> None:
    async with room() as here:
        here.found = {"that": either("radio", HOSTILE)}
        here.say("take that")
        asked = await here.result()
        here.say(text, ago_s=60.0)
        stopped = await here.result(2)
        unconfirmed = await here.result(3)
        assert {stopped.command, unconfirmed.command} == {"stop", "take"}
        assert {stopped.result, unconfirmed.result} == {"done", "refused"}
        assert here.bench.clock.now_ns() - asked.stamp_ns < 2 * NS_PER_S, "nothing is asked about any more"
        assert [name for name, _ in here.queries(StopRobot)] == ["rover"]


@in_virtual_time
async def test_robot_that_refuses_to_stop_leaves_no_other_driving() -> None:
    async with room() as here:
        here.bench.put(ROBOT_STATE, ROVER, "a_rover")
        await here.bench.settle()
        here.refusal = "its driver is gone"
        here.say("stop")
        assert (await here.result()).message == "its driver is gone"
        assert [name for name, _ in here.queries(StopRobot)] == ["a_rover", "rover"]


@in_virtual_time
async def test_stopping_things_stops_robots_and_long_speech_is_harmless() -> None:
    async with room() as here:
        here.say("stop the radio")
        await here.result()
        assert [name for name, _ in here.queries(StopRobot)] == ["rover"]
        here.say(" ".join(["take", *["x" * 64] * 63]))
        await here.result(2)
        here.say("turn the radio on")
        assert (await here.result(3)).result == "done"


@in_virtual_time
async def test_interim_words_wait_and_a_flood_of_words_is_bounded() -> None:
    async with room() as here:
        here.say("stop", is_final=False)
        await here.bench.settle()
        assert here.understood == []
        here.found = {"that": either("radio", HOSTILE)}
        for _ in range(200):  # of 50 words: 10 000 words
            here.say("take that " + "word " * 48)
        await until(lambda: len(here.understood) >= 200 - MAX_WAITING)
        flooded = [one for one in here.understood if "too many words" in one.message]
        assert len(flooded) >= 200 - MAX_WAITING - 1
        here.say("what is that")
        assert (await here.result(len(here.understood) + 1)).result in ("refused", "done")


class Conveyor:
    """Two packages, and a selector that grants all that nobody has; what is selected goes to bay 1."""

    def __init__(self, here: Room, refusal: str = "") -> None:
        self.here = here
        self.refusal = refusal
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
async def test_package_named_by_speech_is_claimed_as_by_pointing() -> None:
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
async def test_verb_applies_to_its_own_things_and_replaces_no_press() -> None:
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


@pytest.mark.parametrize("text", ["heat", "heat the kettle=true", "heat2 kettle=true", "stop kettle=true"])
def test_a_verb_that_cannot_be_used_is_refused(text: str) -> None:
    with pytest.raises(ConfigError):
        own_verbs([text])


def test_missing_program_is_returned_as_a_problem_with_the_verbs() -> None:
    verbs, problem = own_verbs(["heat kettle=true", "heat radio=no-such-program", "heat nuts="])
    assert verbs["heat"].things == {"kettle", "radio", "nuts"}
    assert str(problem).startswith("heat radio: no program no-such-program")
    assert own_verbs(["heat kettle=true", "heat nuts"])[1] is None


@in_virtual_time
async def test_verb_of_an_unknown_thing_is_refused_with_a_suggestion() -> None:
    async with room() as here:
        interpreter = Interpreter(here.bench.bus, here.bench.clock, USER, own_verbs(["heat kettel"])[0])
        with pytest.raises(ConfigError, match="the map has no thing 'kettel'; did you mean kettle"):
            await interpreter.wait_for_room(1.0)


@in_virtual_time
async def test_interpreter_waits_for_robots_and_stop_reaches_silent_ones() -> None:
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
async def test_these_means_all_things_more_probably_swept_over_than_not(
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
async def test_user_without_the_right_is_not_told_to_start_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def deny(*_about: object) -> None:
        raise AccessDeniedError("anna may not ask that")

    async with room() as here:
        monkeypatch.setattr(here.bench.bus, "call", deny)
        here.say("take that")
        assert (await here.result()).message == "anna may not ask that"
