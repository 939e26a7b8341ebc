"""Programs of `--on` when people point at things: their arguments, limits, failures and end."""

import asyncio
import os
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import httpcore
import pytest

from pointit.cli.things.run_things import THINGS_PART
from pointit.launch.plan import scenario_catalog
from pointit.launch.plan.launches import Choices
from pointit.launch.plan.plan import read_scenario
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.link import VARIABLE
from pointit.schemas import Environment, Health, SelectionEvent
from pointit.schemas.environment import Thing
from pointit.schemas.topics import ACT_RESULTS, HEALTH, MAP, SELECTION_EVENTS
from pointit.services.reactions import http_status
from pointit.services.reactions.service import Reactions, ReactionsConfig
from pointit.services.reactions.targets import GRACE_S, STARTED_S, Program, Reaction, reactions_in
from tests.support.acts import act_on, failure_of
from tests.support.bench import in_virtual_time, memory_bench, stand_still, until

SIZE_M = (0.2, 0.2, 0.2)
ROOM = Environment(
    stamp_ns=1,
    name="shop",
    things=(
        Thing(id="screws", center_m=(1.0, 2.0, 1.0), size_m=SIZE_M),
        Thing(id="radio", center_m=(1.0, 3.0, 1.0), size_m=SIZE_M, mode="switch"),
    ),
)


class FakeProgram:
    """A process that ends when it is told to, or by a signal to its group."""

    def __init__(self, pid: int, arguments: Sequence[str]) -> None:
        self.pid = pid
        self.arguments = arguments
        self.signals: list[int] = []
        self.code: asyncio.Future[int] = asyncio.get_running_loop().create_future()

    async def wait(self) -> int:
        return await asyncio.shield(self.code)


class Machine:
    """The processes that were started, in order."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.started: list[FakeProgram] = []
        self.error: OSError | None = None
        self.options: dict[str, Any] = {}
        monkeypatch.setattr(asyncio, "create_subprocess_exec", self._start)
        monkeypatch.setattr(os, "killpg", self._signal)

    async def _start(self, *arguments: str, **options: Any) -> FakeProgram:
        if self.error is not None:
            raise self.error
        self.options = options
        self.started.append(FakeProgram(len(self.started), arguments))
        return self.started[-1]

    def _signal(self, group: int, number: int) -> None:
        program = self.started[group]
        if program.code.done():
            raise ProcessLookupError
        program.signals.append(number)
        if number == signal.SIGKILL:
            program.code.set_result(-number)


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Machine:
    return Machine(monkeypatch)


async def settled() -> None:
    await asyncio.sleep(0.01)


@in_virtual_time
async def test_program_gets_its_arguments_as_they_are_without_a_shell(machine: Machine) -> None:
    program = Program.parse("echo '{user} turns it {state};' {thing} {confidence} '$HOME {\"a\": 1}'")
    acts = [act_on("radio", confidence=0.876), act_on("radio", event="deselected")]
    running = [asyncio.create_task(failure_of(program, act)) for act in acts]
    await settled()
    assert [program.arguments for program in machine.started] == [
        ("echo", "anna turns it on;", "radio", "0.88", '$HOME {"a": 1}'),
        ("echo", "anna turns it off;", "radio", "", '$HOME {"a": 1}'),
    ]
    assert machine.options["start_new_session"]
    for program_of in machine.started:
        program_of.code.set_result(0)
    assert await asyncio.gather(*running) == [("", ""), ("", "")]


@in_virtual_time
async def test_failure_is_a_sentence_with_the_exit_code(machine: Machine) -> None:
    program = Program.parse("false 'a b'")
    for code, ended in ((3, "exit code 3"), (-9, "signal 9")):
        running = asyncio.create_task(failure_of(program, act_on("screws")))
        await settled()
        machine.started[-1].code.set_result(code)
        assert await running == ("error", f"false 'a b' ended with {ended}")
    machine.error = PermissionError(13, "Permission denied")
    failure = await failure_of(program, act_on("screws"))
    assert failure == ("error", "false 'a b' could not be started (permission denied)")


@in_virtual_time
async def test_long_program_reports_its_start_and_ends_after_60_s(
    machine: Machine,
) -> None:
    started: list[bool] = []
    act = act_on("screws", tell_started=lambda: started.append(True))
    running = asyncio.create_task(failure_of(Program.parse("true"), act))
    await asyncio.sleep(STARTED_S - 0.1)
    assert started == []
    await asyncio.sleep(59.9 - STARTED_S)
    (program,) = machine.started
    assert (started, program.signals) == ([True], [])
    await asyncio.sleep(0.3)
    assert program.signals == [signal.SIGTERM]
    assert await running == ("no_answer", "true was ended after 60 s")
    assert program.signals == [signal.SIGTERM, signal.SIGKILL]


@in_virtual_time
async def test_programs_end_with_the_service_and_their_acts_fail(machine: Machine) -> None:
    async with memory_bench() as bench:
        results = bench.collect(ACT_RESULTS)
        service = bench.start(Reactions, ReactionsConfig(on=("screws=true", "radio=true")))
        await settled()
        bench.put(
            SELECTION_EVENTS, act_on("screws", stamp_ns=bench.clock.now_ns(), carriers=("reactions",)).event
        )
        await until(lambda: bool(machine.started))
        await bench.end(service)
        await asyncio.sleep(GRACE_S + 0.1)
        assert machine.started[0].signals == [signal.SIGTERM, signal.SIGKILL]
        assert [(each.object_id, each.text) for each in results] == [
            ("screws", "reactions ended before it was done")
        ]


@in_virtual_time
async def test_missing_thing_is_a_problem_until_another_map_has_it() -> None:
    async with memory_bench() as bench:
        health: list[Health] = bench.collect(HEALTH)
        bench.start(Reactions, ReactionsConfig(on=("scews=true",)))
        bench.put(MAP, ROOM)

        def problems() -> list[tuple[str, str]]:
            return [(each.subject, each.sentence) for each in health[-1].problems] if health else []

        await until(lambda: problems() != [])
        sentence = "scews: the map has no thing 'scews'; did you mean screws?"
        assert problems() == [("scews", sentence)]
        bench.put(
            MAP, ROOM.model_copy(update={"things": (ROOM.things[0].model_copy(update={"id": "scews"}),)})
        )
        await until(lambda: problems() == [])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("screws", "write THING=PROGRAM"),
        ("=true", "write THING=PROGRAM"),
        ("screws=", "write THING=PROGRAM"),
        ("screws=true 'a", "no closing quotation; close it"),
        ("screws=true {usr}", r"screws: there is no \{usr\}; did you mean user\?"),
        ("screws=./nothing-here.sh", r"screws: no program \./nothing-here\.sh; give a path"),
    ],
)
def test_unstartable_program_is_one_sentence(text: str, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        Reaction.parse(text)


def test_script_that_may_not_run_is_named(tmp_path: Path) -> None:
    script = tmp_path / "order.sh"
    script.write_text("#!/bin/sh\n")
    with pytest.raises(ConfigError, match="`chmod \\+x` a script"):
        Program.parse(str(script))
    script.chmod(0o755)
    assert Program.parse(f"{script} {{user}}").arguments == [str(script), "{user}"]


def test_unknown_thing_is_refused_before_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def read(_name: str) -> Environment:
        return ROOM

    monkeypatch.setattr(scenario_catalog, "_map_without_points", read)
    scenario = read_scenario("scenario_2")
    with pytest.raises(ConfigError, match=r"^scews: the map has no thing 'scews'; did you mean screws\?"):
        THINGS_PART.add(scenario, Choices(), {"on": ("scews=true",), "mqtt": ""})
    with pytest.raises(ConfigError, match=r"^scews: the map has no thing"):  # no program either
        THINGS_PART.add(scenario, Choices(), {"on": ("scews=./nothing-here.sh",), "mqtt": ""})
    added = THINGS_PART.add(scenario, Choices(), {"on": ("screws=true",), "mqtt": ""})
    assert added.settings == ['reactions.on=["screws=true"]']
    assert not THINGS_PART.add(scenario, Choices(), {"on": (), "mqtt": ""}).settings


def test_home_assistant_things_without_its_service_are_named_at_start(tmp_path: Path) -> None:
    path = tmp_path / "home.yaml"
    path.write_text("things: {desk: {home_assistant: light.desk, center: [0, 1, 1], size: [1, 1, 1]}}")
    scenario = read_scenario(str(path))

    def notes(*services: str, imu: Sequence[str] = (), **options: object) -> Sequence[str]:
        choices = Choices(services=services, imu=imu)
        return THINGS_PART.add(scenario, choices, {"on": (), "mqtt": "", **options}).notes

    (note,) = notes()
    assert "is not connected: pointing at desk switches nothing there; add --with home-assistant" in note
    (note,) = notes("home_assistant")
    assert note.startswith("a simulated person points, and switches desk of your Home Assistant; ")
    assert notes("home_assistant", imu=["page"]) == notes("home_assistant", site_only=True) == []
    joined = THINGS_PART.add(scenario, Choices(), {"on": (), "mqtt": "", "connect": ("tcp/hub:7447",)})
    assert not joined.notes, "its bridge may run there"
    with click.Context(click.Command("run")) as context:
        context.meta[VARIABLE] = "credentials"
        assert not notes(), "on a secured site the bridge is a process of its own"
    assert THINGS_PART.add(read_scenario("shelf"), Choices(), {"on": (), "mqtt": ""}).notes == []


def test_file_has_several_reactions(tmp_path: Path) -> None:
    path = tmp_path / "site.yaml"
    path.write_text("screws: ['true', 'http://home/hook']\nradio: echo {state}\n")
    assert [each.thing for each in reactions_in(str(path))] == ["screws", "screws", "radio"]
    assert [each.thing for each in reactions_in("screws=echo x.yaml")] == ["screws"]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("screws: 3", r"screws: write a program or a URL, or a list of them, not 3"),
        ("screws: [{a: b}]", r"screws: write a program or a URL"),
        ("screws: ./nothing-here.sh", r"site\.yaml: screws: no program \./nothing-here\.sh"),
        ("screws: ''", r"write THING=PROGRAM"),
        ("- screws", r"site\.yaml"),
        ("screws: [", r"is not YAML"),
    ],
)
def test_file_that_is_wrong_is_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "site.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=sentence):
        list(reactions_in(str(path)))


def test_thing_name_in_a_file_is_its_literal_text(tmp_path: Path) -> None:
    path = tmp_path / "reactions.yaml"
    path.write_text("no: echo 1\n01: echo 2\n1: [echo 3, echo 4]\n1.10: echo 5\n")
    assert [each.thing for each in reactions_in(str(path))] == ["no", "01", "1", "1", "1.10"]


@in_virtual_time
async def test_webhook_is_not_called_again_after_its_process_was_stopped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    calls: list[float] = []

    async def stopped_during_call(_pool: object, _request: object) -> tuple[int, str]:
        calls.append(asyncio.get_running_loop().time())
        await asyncio.sleep(0.5)
        stand_still(8.0)  # people were told meanwhile that it failed
        raise httpcore.NetworkError("reset")

    monkeypatch.setattr(http_status, "post", stopped_during_call)
    async with memory_bench() as bench:
        results = bench.collect(ACT_RESULTS)
        bench.start(Reactions, ReactionsConfig(on=("screws=http://127.0.0.1:9/order",)))
        await bench.settle()
        bench.put(MAP, ROOM)
        await bench.settle()

        stamp_ns = bench.clock.now_ns()
        event = SelectionEvent(
            stamp_ns=stamp_ns, event="selected", object_id="screws", user="anna", carriers=("reactions",)
        )
        bench.put(SELECTION_EVENTS, event)
        await until(lambda: bool(results))
        await asyncio.sleep(60.0)

    assert len(calls) == 1
    assert [(each.result, each.code) for each in results] == [("failed", "no_answer")]
