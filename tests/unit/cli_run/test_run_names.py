"""Option `--announce` of `run`: what it counts and speaks, and what it refuses."""

import re
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from pointit.bridges.speaker.speech_synthesizer import PROGRAM
from pointit.cli.main import command
from pointit.cli.things.run_things import NAMES_PART, NameWatcher, announcement_lines
from pointit.launch.plan.launches import Choices
from pointit.launch.plan.plan import read_scenario
from pointit.runtime.errors import ConfigError
from pointit.schemas import Announced, Health, SelectionEvent, Step, topics
from pointit.schemas.problems import NAMES_SPOKEN, VOICE, Problem
from pointit.schemas.system import Figure
from tests.support.bench import memory_bench, until
from tests.support.invoked import printed


def selected(user: str, cause: str, event: str = "selected") -> SelectionEvent:
    fields: dict[str, Any] = {"event": event, "cause": cause}
    return SelectionEvent(stamp_ns=0, object_id="kettle", user=user, **fields)


def health(service: str, spoken: int, problem: str = "") -> Health:
    return Health(
        stamp_ns=0,
        service=service,
        instance=service,
        pid=1,
        figures=(Figure(name=NAMES_SPOKEN, value=spoken),),
        problems=(Problem(code=VOICE, sentence=problem),) if problem else (),
    )


async def test_names_that_were_heard_are_counted_with_steps_and_presses() -> None:
    watcher = NameWatcher()
    async with memory_bench() as bench:
        subscriptions = watcher.attach(bench.bus, lambda _line, _user: None)
        for user, label in (("anna", "the kettle"), ("ben", "the lamp"), ("ben", "the lamp")):
            object_id = label.rpartition(" ")[2]
            bench.put(topics.ANNOUNCED, Announced(stamp_ns=0, object_id=object_id, label=label), user)
            await bench.settle(3)  # the newest message of a person replaces unread ones
        bench.put(topics.ANNOUNCED, Announced(stamp_ns=0, object_id="", label=""), "anna")
        for user in ("anna", "ben", "ben"):
            bench.put(topics.STEP, Step(stamp_ns=0, by=1), user)
        for event in (selected("anna", "button"), selected("ben", "dwell"), selected("ben", "", "refused")):
            bench.put(topics.SELECTION_EVENTS, event)

        await until(lambda: watcher.summary()["names"]["confirmed"] == 1)
        await until(lambda: watcher.summary()["names"]["stepped"] == 3)
        lines = [announcement_lines(watcher.summary())[0]]
        for message in (health("web", 1, "no voices"), health("speaker", 2), health("web", 1)):
            bench.put(topics.HEALTH, message, message.instance)
            await bench.settle(3)
            lines += announcement_lines(watcher.summary())
        for each in subscriptions:
            each.close()
    assert lines == [
        "Names: 0 announced, 3 more not heard (is the page or phone open?), 3 steps, 1 confirmed.",
        "Names: 1 announced, 2 more not heard (no voices), 3 steps, 1 confirmed.",
        "Names: 3 announced (no voices), 3 steps, 1 confirmed.",
        "Names: 3 announced, 3 steps, 1 confirmed.",
    ]


def test_a_run_without_names_says_nothing_of_them() -> None:
    assert announcement_lines({}) == []


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ("scenario_1", "--announce", "page"),
            "nothing is selected in scenario_1.yaml; choose another scenario, such as shelf",
        ),
        (("shelf", "--announce", "phone", "--method", "dwell"), "needs method estimate, not dwell"),
        (("shelf", "--announce", "page", "--no-web"), "exclude each other: there is no page"),
        (
            ("shelf", "--announce", "media_player.kitchen"),
            "--announce media_player.kitchen: Home Assistant is not connected; add --with home-assistant",
        ),
    ],
)
def test_announce_is_rejected_when_nothing_can_be_announced(
    arguments: tuple[str, ...], sentence: str
) -> None:
    with pytest.raises(ConfigError, match=re.escape(sentence)):
        printed(command, "run", *arguments, "--duration", "1")


@pytest.mark.parametrize("device", ["radio", "media_player.", "media_player_kitchen", "light.desk"])
def test_other_device_is_refused_with_the_choices(device: str) -> None:
    result = CliRunner().invoke(command, ["run", "shelf", "--announce", device, "--duration", "1"])
    assert f"{device!r}: choose page, phone, speaker, or media_player.NAME of Home Assistant" in " ".join(
        result.output.replace("│", " ").split()
    )


def test_media_player_is_the_speaker_of_home_assistant() -> None:
    scenario = read_scenario("shelf")
    for name in ("home-assistant", "home_assistant"):
        options = {"announce": "media_player.kitchen", "language": "de"}
        added = NAMES_PART.add(scenario, Choices(services=[name]), options)
        assert "home-assistant.speaker=media_player.kitchen" in added.settings
        assert "home-assistant.language=de" in added.settings
        assert "selector.method=estimate" in added.settings


def test_speaker_of_this_machine_is_a_service_with_a_language(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = {"announce": "speaker", "language": "de"}
    program = tmp_path / PROGRAM
    program.write_text("#!/bin/sh\n", encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    added = NAMES_PART.add(read_scenario("shelf"), Choices(), options)
    assert added.site_services == ("speaker",)
    assert "speaker.language=de" in added.settings
    program.unlink()
    with pytest.raises(ConfigError, match=f"--announce speaker needs `{PROGRAM}`: install it"):
        NAMES_PART.add(read_scenario("shelf"), Choices(), options)


def test_a_language_without_names_is_refused() -> None:
    with pytest.raises(ConfigError, match="add --announce"):
        NAMES_PART.add(read_scenario("shelf"), Choices(), {"announce": None, "language": "de"})
    result = CliRunner().invoke(command, ["run", "shelf", "--language", "German", "--duration", "1"])
    assert "'German': write the tag of a language" in " ".join(result.output.replace("│", " ").split())
