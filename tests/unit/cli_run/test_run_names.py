"""Option `--announce` of `run`: what it counts and speaks, and what it refuses."""

from typing import Any, cast

import pytest
from click.testing import CliRunner

from pointit.cli.main import command
from pointit.cli.things.run_things import NAMES_PART, NameWatcher, announcement_lines
from pointit.launch.plan.launches import Choices
from pointit.launch.plan.plan import read_scenario
from pointit.runtime.errors import ConfigError
from pointit.schemas import Announced, SelectionEvent, Step, topics
from pointit.speech.audio import SpeechSynthesizer
from tests.support.bench import memory_bench, until


class Synthesizer:
    """Notes what is to be spoken."""

    def __init__(self) -> None:
        self.spoken: list[str] = []

    def speak(self, text: str) -> None:
        self.spoken.append(text)


def selected(user: str, cause: str, event: str = "selected") -> SelectionEvent:
    fields: dict[str, Any] = {"event": event, "cause": cause}
    return SelectionEvent(stamp_ns=0, object_id="kettle", user=user, **fields)


async def test_names_of_two_people_are_spoken_and_counted_with_steps_and_presses() -> None:
    synthesizer = Synthesizer()
    watcher = NameWatcher(cast("SpeechSynthesizer", synthesizer))
    async with memory_bench() as bench:
        subscriptions = watcher.attach(bench.bus, lambda _line, _user: None)
        for user, label in (("anna", "the kettle"), ("ben", "the lamp")):
            object_id = label.rpartition(" ")[2]
            bench.put(topics.ANNOUNCED, Announced(stamp_ns=0, object_id=object_id, label=label), user)
        await until(lambda: len(synthesizer.spoken) == 2)
        bench.put(topics.ANNOUNCED, Announced(stamp_ns=0, object_id="", label=""), "anna")
        for user in ("anna", "ben", "ben"):
            bench.put(topics.STEP, Step(stamp_ns=0, by=1), user)
        for event in (selected("anna", "button"), selected("ben", "dwell"), selected("ben", "", "refused")):
            bench.put(topics.SELECTION_EVENTS, event)
        await until(lambda: watcher.summary()["names"]["confirmed"] == 1)
        await until(lambda: watcher.summary()["names"]["stepped"] == 3)
        for each in subscriptions:
            each.close()
    assert sorted(synthesizer.spoken) == ["the kettle", "the lamp"]
    assert announcement_lines(watcher.summary()) == ["Names: 2 announced, 3 steps, 1 confirmed."]


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
def test_what_cannot_be_announced_is_refused(arguments: tuple[str, ...], sentence: str) -> None:
    result = CliRunner().invoke(command, ["run", *arguments, "--duration", "1"], standalone_mode=False)
    assert isinstance(result.exception, ConfigError)
    assert sentence in str(result.exception)


@pytest.mark.parametrize("device", ["radio", "media_player.", "media_player_kitchen", "light.desk"])
def test_other_device_is_refused_with_the_choices(device: str) -> None:
    result = CliRunner().invoke(command, ["run", "shelf", "--announce", device, "--duration", "1"])
    assert f"{device!r}: choose page, phone, speaker, or media_player.NAME of Home Assistant" in " ".join(
        result.output.replace("│", " ").split()
    )


def test_media_player_is_the_speaker_of_home_assistant() -> None:
    scenario = read_scenario("shelf")
    for name in ("home-assistant", "home_assistant"):
        added = NAMES_PART.add(scenario, Choices(services=[name]), {"announce": "media_player.kitchen"})
        assert "home-assistant.speaker=media_player.kitchen" in added.settings
        assert "selector.method=estimate" in added.settings
