"""Options `--on` and `--mqtt` of `pointit run`."""

from collections.abc import Mapping
from typing import Any

import click

from pointit.cli.common.panels import Added, RunPart
from pointit.cli.display.summary import DisplayPart
from pointit.cli.things.mqtt_events import MqttThings, broker_of
from pointit.cli.things.reactions import Reactions, reactions_in
from pointit.diagnosis.missing_services import HOME_REMEDY, home_things, listed, unconnected_sentence
from pointit.launch.plan.launches import Choices, site_launches
from pointit.launch.plan.plan import MakeWatcher, Scenario
from pointit.launch.plan.scenario_catalog import room_of
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.options import given_credentials
from pointit.runtime.mqtt.broker import discovery_prefix
from pointit.services.registry import HOME_ASSISTANT


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
        help="discovery prefix of Home Assistant's MQTT integration  [default: variable "
        "MQTT_DISCOVERY_PREFIX, or homeassistant]",
    )
    return broker(authority(prefix(function)))


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


def _add(scenario: Scenario, choices: Choices, options: Mapping[str, Any]) -> Added:
    """Return the watchers; ConfigError: no such program, thing or extra, or no address of a broker."""
    watchers: list[MakeWatcher] = []
    room = room_of(site_launches(scenario, choices)) if options["on"] else None
    reactions = [each for text in options["on"] for each in reactions_in(text, room)]
    if reactions:
        watchers.append(lambda _launches: Reactions(reactions))
    ca_file = options.get("mqtt_ca_file", "")
    if options["mqtt"] or ca_file:
        config = broker_of(options["mqtt"], ca_file)
        prefix = discovery_prefix(options.get("mqtt_discovery_prefix", ""))
        watchers.append(lambda _launches: MqttThings(config, prefix))
    return Added(watchers=watchers, notes=_home_notes(scenario, choices, options))


def _home_notes(scenario: Scenario, choices: Choices, options: Mapping[str, Any]) -> list[str]:
    """Return a note if nobody switches the things of a Home Assistant, or a simulated person does."""
    try:
        launches = site_launches(scenario, choices)
        room = room_of(launches)
    except ConfigError:  # reported when all options are known
        return []
    is_connected = any(HOME_ASSISTANT.name == launch.service.NAME for launch in launches)
    things = () if room is None else home_things(room)
    has_other_processes = bool(options.get("connect")) or given_credentials() is not None
    is_simulated = "user-sim" in scenario.user and not choices.imu and not options.get("site_only")
    if things and is_connected and is_simulated:
        switched = f"a simulated person points, and switches {listed(things)} of your Home Assistant"
        return [f"{switched}; to point yourself, add --imu page, or --imu with a wrist"]
    if things and not is_connected and not has_other_processes:
        return [f"{unconnected_sentence(things)}; {HOME_REMEDY}"]
    return []


def summary_lines(summary: Mapping[str, Any]) -> list[str]:
    """Return sentences on the entries of reactions and of the broker in a summary."""
    lines: list[str] = []
    if reactions := summary.get("reactions"):
        failed = f", {reactions['failed']} failed" if reactions["failed"] else ""
        failed += f", {reactions['dropped']} not started" if reactions["dropped"] else ""
        lines += [
            f"Reactions: {reactions['started']} started{failed}.",
            *(f"{e}." for e in reactions["failures"]),
        ]
    if mqtt := summary.get("mqtt"):
        dropped = f", {mqtt['dropped']} lost" if mqtt["dropped"] else ""
        lines += [f"MQTT: {mqtt['events']} events published{dropped}."]
        lines += [f"MQTT: {mqtt['problem']}."] if mqtt["problem"] else []
    return lines


THINGS_PART = RunPart(
    heading="Things",
    names=("on", "mqtt", "mqtt_ca_file", "mqtt_discovery_prefix"),
    options=_options,
    add=_add,
)
THINGS_DISPLAY = DisplayPart(
    rows=lambda _monitor, _width: None, lines=lambda _monitor: (), summary=summary_lines
)
