"""Reactions of `--on` when people point at things: arguments of programs, limits, failures, their end."""

import asyncio
import os
import signal
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import click
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.cli.things import reactions
from pointit.cli.things import reactions as program
from pointit.cli.things.reactions import MAX_AT_ONCE, Program, Reaction, Reactions, reactions_in
from pointit.cli.things.run_things import THINGS_DISPLAY, THINGS_PART
from pointit.launch.plan import scenario_catalog
from pointit.launch.plan.launches import Choices
from pointit.launch.plan.plan import read_scenario
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.link import VARIABLE
from pointit.schemas import Environment, SelectionEvent
from pointit.schemas.environment import Thing
from pointit.schemas.topics import SELECTION_EVENTS
from tests.support.bench import Bench, in_virtual_time, memory_bench

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


def point(bench: Bench, name: str, event: str = "selected", **fields: Any) -> None:
    usual: dict[str, Any] = {"stamp_ns": 1, "object_id": name, "user": "anna", "confidence": 0.876}
    bench.put(SELECTION_EVENTS, SelectionEvent.model_validate(usual | {"event": event} | fields))


def begun(bench: Bench, *commands: str) -> Reactions:
    watcher = Reactions([Reaction.parse(text) for text in commands])
    watcher.attach(bench.bus, lambda _text, _user: None)
    watcher.on_map(ROOM)
    return watcher


def run_summary(watcher: Reactions) -> list[str]:
    return list(THINGS_DISPLAY.summary(watcher.summary()))


async def settled() -> None:
    await asyncio.sleep(0.01)


@in_virtual_time
async def test_program_gets_its_arguments_as_they_are_without_a_shell(machine: Machine) -> None:
    async with memory_bench() as bench:
        begun(bench, "radio=echo '{user} turns it {state};' {thing} {confidence} '$HOME {\"a\": 1}'")
        point(bench, "radio")
        point(bench, "radio", "deselected", confidence=None)
        point(bench, "screws")
        point(bench, "box_7")
        await settled()
        arguments = [program.arguments for program in machine.started]
        assert arguments == [
            ("echo", "anna turns it on;", "radio", "0.88", '$HOME {"a": 1}'),
            ("echo", "anna turns it off;", "radio", "", '$HOME {"a": 1}'),
        ]
        assert machine.options["start_new_session"]


@in_virtual_time
async def test_button_starts_its_program_once_for_each_pointing(machine: Machine) -> None:
    async with memory_bench() as bench:
        begun(bench, "screws=true")
        point(bench, "screws")
        point(bench, "screws", "deselected")
        await settled()
        assert len(machine.started) == 1


@in_virtual_time
async def test_failure_is_a_sentence_with_the_exit_code(
    machine: Machine, caplog: pytest.LogCaptureFixture
) -> None:
    async with memory_bench() as bench:
        watcher = begun(bench, "screws=false 'a b'")
        for code in (0, 3, -9):
            point(bench, "screws")
            await settled()
            machine.started[-1].code.set_result(code)
            await settled()
        machine.error = PermissionError(13, "Permission denied")
        point(bench, "screws")
        await settled()
        sentences = [
            "screws: false 'a b' ended with exit code 3",
            "screws: false 'a b' ended with signal 9",
            "screws: false 'a b' could not be started (Permission denied)",
        ]
        assert [record.getMessage() for record in caplog.records] == sentences
        lines = run_summary(watcher)
        assert lines == ["Reactions: 4 started, 3 failed.", *(f"{each}." for each in sentences)]


@in_virtual_time
async def test_program_is_ended_with_its_group_after_60_s(machine: Machine) -> None:
    async with memory_bench() as bench:
        watcher = begun(bench, "screws=true")
        point(bench, "screws")
        await asyncio.sleep(59.9)
        (program,) = machine.started
        assert program.signals == []
        await asyncio.sleep(0.2)
        assert program.signals == [signal.SIGTERM]
        await asyncio.sleep(1.0)
        assert program.signals == [signal.SIGTERM, signal.SIGKILL]
        assert run_summary(watcher)[1:] == ["screws: true was ended after 60 s."]


@in_virtual_time
async def test_ninth_program_is_not_started_and_named(machine: Machine) -> None:
    async with memory_bench() as bench:
        watcher = begun(bench, "screws=true")
        for _ in range(MAX_AT_ONCE + 1):
            point(bench, "screws")
        await settled()
        assert len(machine.started) == MAX_AT_ONCE
        assert run_summary(watcher) == [
            "Reactions: 8 started, 1 not started.",
            "screws: true was not started, as 8 reactions still run.",
        ]
        machine.started[0].code.set_result(0)
        await settled()
        point(bench, "screws")
        await settled()
        assert len(machine.started) == MAX_AT_ONCE + 1


@in_virtual_time
async def test_programs_end_with_the_scenario_and_are_no_failures(machine: Machine) -> None:
    async with memory_bench() as bench:
        watcher = Reactions([Reaction.parse("screws=true")])
        listening = watcher.attach(bench.bus, lambda _text, _user: None)
        watcher.on_map(ROOM)
        point(bench, "screws")
        await settled()
        for each in listening:
            each.close()
        await asyncio.sleep(program.GRACE_S + 0.1)
        assert machine.started[0].signals == [signal.SIGTERM, signal.SIGKILL]
        assert run_summary(watcher) == ["Reactions: 1 started."]
        assert asyncio.all_tasks() == {asyncio.current_task()}


class UnexpectedError(Exception):
    """An error that no target is expected to raise."""


class Scripted:
    """A target whose reactions each wait, then return or raise what the test gives."""

    interruption: ClassVar[str] = "was interrupted"

    def __init__(self) -> None:
        self.waiting: list[asyncio.Future[str]] = []

    def describe(self, _values: Mapping[str, str]) -> str:
        return "scripted"

    async def react(self, _values: Mapping[str, str]) -> str:
        self.waiting.append(asyncio.get_running_loop().create_future())
        return await self.waiting[-1]


@given(
    actions=st.lists(st.sampled_from(["point", "turn", "done", "problem", "error", "cancel"]), max_size=40)
)
@in_virtual_time
async def test_started_reactions_are_done_or_have_failed_when_the_run_has_ended(actions: list[str]) -> None:
    """Whatever they return or raise, and whenever the run ends."""
    async with memory_bench() as bench:
        target = Scripted()
        watcher = Reactions([Reaction(thing="screws", target=target)])
        listening = watcher.attach(bench.bus, lambda _text, _user: None)
        watcher.on_map(ROOM)
        for action in actions:
            pending = [each for each in target.waiting if not each.done()]
            if action == "point":
                point(bench, "screws")
            elif action == "turn":
                await asyncio.sleep(0)
            elif pending and action == "error":
                pending[0].set_exception(UnexpectedError())
            elif pending and action == "cancel":
                pending[0].cancel()
            elif pending:
                pending[0].set_result("" if action == "done" else "has failed")
        await bench.settle()
        for each in reversed(listening):
            each.close()
        counts = watcher.summary()["reactions"]
        assert counts["started"] == counts["done"] + counts["failed"]
        assert counts["started"] + counts["dropped"] == actions.count("point")
        sentences = counts["failed"] + counts["dropped"]
        assert len(counts["failures"]) == min(sentences, reactions.MAX_FAILURES)
        await settled()


@in_virtual_time
async def test_unexpected_error_is_a_failure_that_names_it() -> None:
    async with memory_bench() as bench:
        target = Scripted()
        watcher = Reactions([Reaction(thing="screws", target=target)])
        watcher.attach(bench.bus, lambda _text, _user: None)
        watcher.on_map(ROOM)
        point(bench, "screws")
        await settled()
        target.waiting[0].set_exception(UnexpectedError("too hot"))
        await settled()
        assert run_summary(watcher) == [
            "Reactions: 1 started, 1 failed.",
            "screws: scripted stopped by an unexpected error (UnexpectedError: too hot).",
        ]


@in_virtual_time
async def test_failures_in_the_summary_are_bounded(machine: Machine) -> None:
    async with memory_bench() as bench:
        watcher = begun(bench, "screws=true")
        machine.error = FileNotFoundError(2, "No such file")
        for _ in range(30):
            point(bench, "screws")
            await settled()
        assert watcher.summary()["reactions"]["failed"] == 30
        assert len(run_summary(watcher)) == 1 + reactions.MAX_FAILURES


def test_thing_that_a_later_map_lacks_is_a_failure(caplog: pytest.LogCaptureFixture) -> None:
    watcher = Reactions([Reaction.parse("scews=true")])
    watcher.on_map(ROOM)
    sentence = "scews: the map has no thing 'scews'; did you mean screws?"
    assert caplog.messages == [sentence] == watcher.summary()["reactions"]["failures"]


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
def test_what_cannot_be_started_is_one_sentence(text: str, sentence: str) -> None:
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
    (make,) = THINGS_PART.add(scenario, Choices(), {"on": ("screws=true",), "mqtt": ""}).watchers
    assert isinstance(make([]), Reactions)
    assert not THINGS_PART.add(scenario, Choices(), {"on": (), "mqtt": ""}).watchers


def test_things_of_a_home_assistant_without_its_service_are_named_at_the_start(tmp_path: Path) -> None:
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


def test_a_things_name_in_a_file_of_reactions_is_its_literal_text(tmp_path: Path) -> None:
    path = tmp_path / "reactions.yaml"
    path.write_text("no: echo 1\n01: echo 2\n1: [echo 3, echo 4]\n1.10: echo 5\n")
    assert [each.thing for each in reactions_in(str(path))] == ["no", "01", "1", "1", "1.10"]
