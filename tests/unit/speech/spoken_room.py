"""A room whose services note what a spoken command asks of them."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

from pointit.cli.things.listen import own_verbs
from pointit.runtime.errors import RefusedError
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import (
    NS_PER_S,
    Bay,
    Belt,
    Done,
    Environment,
    FindReferents,
    Lamp,
    Referent,
    Referents,
    RobotState,
    SetThing,
    Speech,
    Thing,
    Understood,
    Word,
)
from pointit.schemas.person import ReferentKind
from pointit.schemas.topics import (
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
from pointit.speech.interpreter import Interpreter
from tests.support.bench import Bench, background, memory_bench, until

USER = "anna"
PLACE = (1.0, 2.0, 0.0)
HOSTILE = "yes-send-all-robots"
ROVER = RobotState(
    stamp_ns=1, kind="ground", phase="idle", position_m=PLACE, yaw_rad=0.0,
    velocity_mps=(0.0, 0.0, 0.0), radius_m=0.2,
)  # fmt: skip


def fired(thing: str) -> SetThing:
    """Return the request of `take`: a switch is toggled; a button that is on already is not fired again."""
    return SetThing(thing=thing, on=None if thing == "radio" else True)


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
        interpreter = Interpreter(bench.bus, bench.clock, USER, own_verbs(["heat kettle"])[0])
        box = {"center_m": (2.0, 0.0, 1.0), "size_m": (0.2, 0.2, 0.2)}
        things = (
            Thing(id="radio", label="Radio", lamp="led_1", mode="switch", **box),
            Thing(id=HOSTILE, lamp="led_2", **box),
            Thing(id="kettle", press=True, **box),
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


def either(*names: str, kind: ReferentKind = "thing") -> Referents:
    candidates = tuple(Referent(kind=kind, name=name, probability=0.45) for name in names)
    return Referents(candidates=candidates, none=0.1, rays=100)
