"""Options `--announce`, `--on` and `--mqtt` of `pointit run`."""

import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import click

from pointit.bridges.mqtt_things.mqtt_things import MqttThings
from pointit.bridges.speaker.speech_synthesizer import require_synthesizer
from pointit.cli.parts import RunAddition, RunPart
from pointit.cli.summary import DisplayPart
from pointit.diagnosis.missing_services import HOME_REMEDY, home_things, unconnected_sentence
from pointit.launch.plan.launches import Choices, site_launches
from pointit.launch.plan.plan import MakeWatcher, OnEvent, Scenario
from pointit.launch.plan.scenario_catalog import room_of
from pointit.maps.checks.things import check_labels
from pointit.runtime.bus.contract import Bus, Closable
from pointit.runtime.config.config import Layers
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.options import given_credentials
from pointit.runtime.mqtt.broker import discovery_prefix, require_client
from pointit.runtime.mqtt.broker_config import FORM, BrokerConfig
from pointit.schemas import Announced, Environment, Health, SelectionEvent, Step
from pointit.schemas.problems import NAMES_SPOKEN, VOICE
from pointit.schemas.text import LANGUAGE, few_of
from pointit.schemas.topics import ANNOUNCED, ANY, HEALTH, SELECTION_EVENTS, STEP
from pointit.services.reactions.targets import reactions_in
from pointit.services.registry import HOME_ASSISTANT, with_service_name

HOME = HOME_ASSISTANT.name
SELECTOR = ("selector.method=estimate", 'selector.estimate.announce.people=["*"]')
SPEAKER = "speaker"
"""Value of `--announce`, and the service that it adds."""
DEVICES = ("page", "phone", SPEAKER)
PLAYER = "media_player."
"""Start of the media players of Home Assistant."""
COUNTED = ("stepped", "confirmed")
SUPERVISOR = ("supervisor.press_while_pointing=confirms",)


def _speaking_device(_context: click.Context, _parameter: click.Parameter, value: str | None) -> str | None:
    """Return `value` if it is one of `DEVICES` or a media player of Home Assistant."""
    if value is None or value in DEVICES:
        return value
    if re.fullmatch(rf"{re.escape(PLAYER)}[a-z0-9_]+", value):
        return value
    raise click.BadParameter(f"{value!r}: choose {', '.join(DEVICES)}, or {PLAYER}NAME of Home Assistant")


def _language_tag(_context: click.Context, _parameter: click.Parameter, value: str | None) -> str | None:
    """Return `value` if it is a tag of a language."""
    if value is None:
        return value
    if value and re.match(LANGUAGE, value):
        return value
    raise click.BadParameter(f"{value!r}: write the tag of a language, such as de or en-GB")


def _announce_options(function: Any) -> Any:
    option = click.option(
        "--announce",
        callback=_speaking_device,
        metavar="[page|phone|speaker|media_player.NAME]",
        help="for people who see no lights: speak the name of the thing that they point at, by their page, "
        "their phone, the speaker of this machine (espeak-ng), or a media player of Home Assistant. The "
        "button confirms what was heard; swipe or arrow keys step to another thing",
    )
    language = click.option(
        "--language",
        callback=_language_tag,
        metavar="TAG",
        help="language of the names of --announce, such as de; otherwise that of the browser or voice",
    )
    return option(language(function))


class NameWatcher:
    """Counts the names that were spoken, the steps and the confirmations."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._spoken: dict[str, float] = {}
        """Number of names by the service that speaks them."""
        self._problems: dict[str, str] = {}
        """The reason why nobody hears names, by that service."""

    def attach(self, bus: Bus, on_event: OnEvent) -> Sequence[Closable]:
        """Subscribe on `bus`. Return the subscriptions."""
        del on_event
        return (
            bus.subscribe(ANNOUNCED, self._on_announced, ANY),
            bus.subscribe(HEALTH, self._on_health),
            bus.subscribe(STEP, self._on_step, ANY),
            bus.subscribe(SELECTION_EVENTS, self._on_event),
        )

    def on_map(self, environment: Environment) -> None:
        """Ignore the map."""

    def on_service(self, instance: str, *, is_present: bool) -> None:
        """Ignore services."""

    def summary(self) -> Mapping[str, Any]:
        """Return the number of names that were spoken and were not, of steps and selections by a press."""
        announced = round(sum(self._spoken.values()))
        names: dict[str, Any] = {
            "announced": announced,
            "unheard": max(self._counts["said"] - announced, 0),
        }
        for counter in COUNTED:
            names[counter] = self._counts[counter]
        names["problem"] = next(filter(None, self._problems.values()), "")
        return {"names": names}

    def _on_announced(self, announced: Announced, _user: str) -> None:
        self._counts["said"] += bool(announced.object_id)

    def _on_health(self, health: Health, instance: str) -> None:
        for figure in health.figures:
            if figure.name == NAMES_SPOKEN:
                self._spoken[instance] = figure.value
        self._problems[instance] = ""
        for problem in health.problems:
            if problem.code == VOICE:
                self._problems[instance] = problem.sentence
                break

    def _on_step(self, _step: Step, _user: str) -> None:
        self._counts["stepped"] += 1

    def _on_event(self, event: SelectionEvent, _name: str) -> None:
        is_selection = event.event in {"selected", "deselected"}
        if is_selection and event.cause == "button":
            self._counts["confirmed"] += 1


def _add_names(scenario: Scenario, choices: Choices, options: Mapping[str, Any]) -> RunAddition:
    """Return the parameters and the watcher of names. Raises ConfigError if nothing can be announced."""
    announce = options["announce"]
    language = options["language"]
    if announce is None:
        if language:
            raise ConfigError("--language is that of spoken names: add --announce")
        return RunAddition()
    if "selector" not in scenario.site:
        raise ConfigError(
            f"--announce {announce}: nothing is selected in {scenario.source}; "
            "choose another scenario, such as shelf"
        )
    method = options.get("method", "").partition(":")[0]
    if method not in {"", "estimate"}:
        raise ConfigError(f"--announce {announce} needs method estimate, not {method}: leave --method out")

    # The voice: that of a service, which has a language, or of a page, which asks its browser
    settings = [*SELECTOR]
    site_services: list[str] = []
    voice = ""
    if announce.startswith(PLAYER):
        if HOME not in {*scenario.site, *map(with_service_name, choices.services)}:
            raise ConfigError(f"--announce {announce}: Home Assistant is not connected; {HOME_REMEDY}")
        settings.append(f"{HOME}.speaker={announce}")
        voice = HOME
    elif announce == SPEAKER:
        require_synthesizer("--announce speaker")
        site_services.append(SPEAKER)
        voice = SPEAKER
    if voice and language:
        settings.append(f"{voice}.language={language}")
    if "supervisor" in scenario.user:
        settings += SUPERVISOR
    return RunAddition(
        notes=_label_notes(scenario, choices),
        site_services=tuple(site_services),
        settings=tuple(settings),
        watchers=[lambda _launches: NameWatcher()],
    )


def _label_notes(scenario: Scenario, choices: Choices) -> list[str]:
    """Return a note on the labels of the map that sound alike or take long, if any."""
    room = room_of(site_launches(scenario, choices))
    if room is None:
        return []
    notes = [finding.text for finding in check_labels(room.things)]
    if len(notes) > 1:
        return [f"{notes[0]} (and {len(notes) - 1} more: pointit map check MAP --spoken)"]
    return notes


def announcement_lines(summary: Mapping[str, Any]) -> list[str]:
    """Return the sentence on the names of a summary."""
    counts = summary.get("names")
    if not counts:
        return []
    announced = f"{counts['announced']} announced"
    reason = counts["problem"]
    if counts["unheard"]:
        announced += f", {counts['unheard']} more not heard"
        if not counts["announced"]:
            reason = reason or "is the page or phone open?"
    if reason:
        announced += f" ({reason})"
    steps, confirmed = (counts[counter] for counter in COUNTED)
    return [f"Names: {announced}, {steps} steps, {confirmed} confirmed."]


NAMES_PART = RunPart(
    heading="Names", names=("announce", "language"), options=_announce_options, add=_add_names
)
NAMES_DISPLAY = DisplayPart(summary=announcement_lines)


def mqtt_options(function: Any) -> Any:
    """Add the options of a broker."""
    broker = click.option(
        "--mqtt",
        default="",
        show_default=False,
        metavar="BROKER",
        help="announce things to Home Assistant at this MQTT broker, HOST or mqtts://USER@HOST "
        "(password: variable MQTT_PASSWORD), and publish when they are pointed at",
    )
    authority = click.option(
        "--mqtt-ca-file",
        default="",
        show_default=False,
        metavar="FILE",
        help="certificate of your own authority, for --mqtt mqtts://…  [default: variable MQTT_CA_FILE]",
    )
    prefix = click.option(
        "--mqtt-discovery-prefix",
        default="",
        show_default=False,
        metavar="TOPIC",
        help="discovery prefix at that broker  [default: variable MQTT_DISCOVERY_PREFIX, or homeassistant]",
    )
    return broker(authority(prefix(function)))


def broker_of(address: str, ca_file: str = "") -> BrokerConfig:
    """Return the broker at `HOST`, `HOST:PORT` or `mqtt[s]://[USER@]HOST[:PORT]`.

    Raises:
        ConfigError: If it is none of these, or the extra is missing.
    """
    require_client("things by MQTT")
    if not address:
        raise ConfigError(f"--mqtt: {FORM}")
    layers = Layers()
    layers.add({"broker": address, "ca_file": ca_file}, "--mqtt")
    return layers.build(BrokerConfig)


def _options(function: Any) -> Any:
    """Add the options."""
    on = click.option(
        "--on",
        multiple=True,
        metavar="THING=PROGRAM|URL",
        help="start this program, without a shell, or send a request to this web server, when somebody "
        "points at the thing; both may have {thing}, {user}, {confidence} and {state} (on or off). FILE.yaml "
        "has several, `THING: PROGRAM or URL`. Repeatable",
    )
    return on(mqtt_options(function))


def _add(scenario: Scenario, choices: Choices, options: Mapping[str, Any]) -> RunAddition:
    """Return watchers and parameters. Raises ConfigError: no such program, thing, extra or broker."""
    settings: list[str] = []
    reactions = options["on"]
    if reactions:
        # Only checked here: the service reactions reads them again
        room = room_of(site_launches(scenario, choices))
        for text in reactions:
            list(reactions_in(text, room))
        settings.append(f"reactions.on={json.dumps(reactions)}")
    watchers: list[MakeWatcher] = []
    ca_file = options.get("mqtt_ca_file", "")
    if options["mqtt"] or ca_file:
        config = broker_of(options["mqtt"], ca_file)
        prefix = discovery_prefix(options.get("mqtt_discovery_prefix", ""))
        watchers.append(lambda _launches: MqttThings(config, prefix))
    return RunAddition(watchers=watchers, settings=settings, notes=_home_notes(scenario, choices, options))


def _home_notes(scenario: Scenario, choices: Choices, options: Mapping[str, Any]) -> list[str]:
    """Return a note if nobody switches the things of a Home Assistant, or a simulated person does."""
    try:
        launches = site_launches(scenario, choices)
        room = room_of(launches)
    except ConfigError:  # reported when all options are known
        return []
    has_other_processes = bool(options.get("connect")) or given_credentials() is not None
    things = () if room is None else home_things(room)
    if not things:
        return []

    # A simulated person would switch lights of a real home
    has_simulated_people = "user-sim" in scenario.user and not options.get("site_only")
    if any(HOME_ASSISTANT.name == launch.service.NAME for launch in launches):
        if choices.imu or not has_simulated_people:
            return []
        switched = f"a simulated person points, and switches {few_of(things)} of your Home Assistant"
        return [f"{switched}; to point yourself, add --imu page, or --imu with a wrist"]

    # Where others join, the bridge may be one of them
    if has_other_processes:
        return []
    return [f"{unconnected_sentence(things)}; {HOME_REMEDY}"]


def summary_lines(summary: Mapping[str, Any]) -> list[str]:
    """Return sentences on the entry of the broker in a summary."""
    mqtt = summary.get("mqtt")
    if not mqtt:
        return []
    lines = [f"MQTT: {mqtt['events']} events published."]
    if mqtt["problem"]:
        lines.append(f"MQTT: {mqtt['problem']}.")
    return lines


THINGS_PART = RunPart(
    heading="Things",
    names=("on", "mqtt", "mqtt_ca_file", "mqtt_discovery_prefix"),
    options=_options,
    add=_add,
)
THINGS_DISPLAY = DisplayPart(summary=summary_lines)
