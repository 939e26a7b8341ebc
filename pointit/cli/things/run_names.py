"""Option `--announce` of `pointit run`: the names of things are spoken, and counted in the summary."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import click

from pointit.cli.common.panels import Added, RunPart
from pointit.cli.display.summary import DisplayPart
from pointit.diagnosis.missing_services import HOME_REMEDY
from pointit.launch.plan.launches import Choices
from pointit.launch.plan.plan import OnEvent, Scenario
from pointit.runtime.bus.contract import Bus, Closable
from pointit.runtime.clock import WallClock
from pointit.runtime.errors import ConfigError
from pointit.schemas import Announced, Environment, SelectionEvent, Step
from pointit.schemas.topics import ANNOUNCED, ANY, SELECTION_EVENTS, STEP
from pointit.services.registry import HOME_ASSISTANT, with_service_name
from pointit.speech.speech_synthesizer import SpeechSynthesizer

HOME = HOME_ASSISTANT.name
SELECTOR = ("selector.method=estimate", 'selector.estimate.announce.people=["*"]')
DEVICES = ("page", "phone", "speaker")
PLAYER = "media_player."
"""Begin of the media players of Home Assistant."""
COUNTED = ("announced", "stepped", "confirmed")
SUPERVISOR = ("supervisor.press_while_pointing=confirms",)


def _speaking_device(_context: click.Context, _parameter: click.Parameter, value: str | None) -> str | None:
    """Return `value` if it is one of `DEVICES` or a media player of Home Assistant."""
    if value is None or value in DEVICES or re.fullmatch(rf"{re.escape(PLAYER)}[a-z0-9_]+", value):
        return value
    raise click.BadParameter(f"{value!r}: choose {', '.join(DEVICES)}, or {PLAYER}NAME of Home Assistant")


def _options(function: Any) -> Any:
    option = click.option(
        "--announce",
        callback=_speaking_device,
        metavar="[page|phone|speaker|media_player.NAME]",
        help="for people who see no lights: speak the name of the thing that they point at, by their page, "
        "their phone, the speaker of this machine (espeak-ng), or a media player of Home Assistant. The "
        "button confirms what was heard; swipe or arrow keys step to another thing",
    )
    return option(function)


class NameWatcher:
    """Counts what is announced, stepped to and confirmed, and speaks the names if there is a synthesizer."""

    def __init__(self, synthesizer: SpeechSynthesizer | None = None) -> None:
        self._synthesizer = synthesizer
        self._counts: Counter[str] = Counter()

    def attach(self, bus: Bus, on_event: OnEvent) -> Sequence[Closable]:
        """Subscribe on `bus`. Return the subscriptions."""
        del on_event
        return (
            bus.subscribe(ANNOUNCED, self._on_announced, ANY),
            bus.subscribe(STEP, self._on_step, ANY),
            bus.subscribe(SELECTION_EVENTS, self._on_event),
        )

    def on_map(self, environment: Environment) -> None:
        """Ignore the map."""

    def on_service(self, instance: str, *, is_present: bool) -> None:
        """Ignore services."""

    def summary(self) -> Mapping[str, Any]:
        """Return the number of names, steps and selections by a press."""
        return {"names": {each: self._counts[each] for each in COUNTED}}

    def _on_announced(self, announced: Announced, _user: str) -> None:
        if announced.object_id:
            self._counts["announced"] += 1
            if self._synthesizer is not None:
                self._synthesizer.speak(announced.label)

    def _on_step(self, _step: Step, _user: str) -> None:
        self._counts["stepped"] += 1

    def _on_event(self, event: SelectionEvent, _name: str) -> None:
        self._counts["confirmed"] += event.event in {"selected", "deselected"} and event.cause == "button"


def _add(scenario: Scenario, choices: Choices, options: Mapping[str, Any]) -> Added:
    """Return the parameters and the watcher of names. Raises ConfigError if nothing can be announced."""
    announce = options["announce"]
    if announce is None:
        return Added()
    if "selector" not in scenario.site:
        raise ConfigError(
            f"--announce {announce}: nothing is selected in {scenario.source}; "
            "choose another scenario, such as shelf"
        )
    if (method := options.get("method", "").partition(":")[0]) not in {"", "estimate"}:
        raise ConfigError(f"--announce {announce} needs method estimate, not {method}: leave --method out")
    players = (f"{HOME}.speaker={announce}",) if announce.startswith(PLAYER) else ()
    if players and HOME not in {*scenario.site, *map(with_service_name, choices.services)}:
        raise ConfigError(f"--announce {announce}: Home Assistant is not connected; {HOME_REMEDY}")
    synthesizer = SpeechSynthesizer(WallClock(), "--announce speaker") if announce == "speaker" else None
    return Added(
        settings=(*SELECTOR, *players, *(SUPERVISOR if "supervisor" in scenario.user else ())),
        watchers=[lambda _launches: NameWatcher(synthesizer)],
    )


def summary_lines(summary: Mapping[str, Any]) -> list[str]:
    """Return the sentence on the names of a summary."""
    if not (counts := summary.get("names")):
        return []
    announced, stepped, confirmed = (counts[each] for each in COUNTED)
    return [f"Names: {announced} announced, {stepped} steps, {confirmed} confirmed."]


NAMES_PART = RunPart(heading="Names", names=("announce",), options=_options, add=_add)
NAMES_DISPLAY = DisplayPart(
    rows=lambda _monitor, _width: None, lines=lambda _monitor: (), summary=summary_lines
)
