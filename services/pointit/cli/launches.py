"""From a scenario and what the command line changes about it to the services that start."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, cast

from pointit.cli.person_options import REALISTIC, Pose, body_of
from pointit.cli.scenario import Scenario
from pointit.runtime import ConfigError, Launch
from pointit.runtime.config import Layers, read_yaml
from pointit.runtime.environment import environment_prefix
from pointit.schemas.topics import check_name
from pointit.services import registry

SWEEP = {"elevation_deg": 2.0, "elevation_amplitude_deg": 5.0}
"""Of a simulated device: an arm nearly level, over which one sees things at the height of a table or belt."""

CURSOR_COLORS = (
    (255, 255, 255),
    (86, 180, 233),
    (240, 228, 66),
    (204, 121, 167),
    (230, 159, 0),
    (0, 158, 115),
)
"""Of people's cursors, in turn: white, then hues that colour-blind people tell apart (Okabe and Ito)."""

PATTERNS = ("solid", "dashed", "striped", "dotted", "hollow", "tailed")
"""Of what people have selected, in turn: a second sign beside the colour."""

Method = Literal["hold", "fraction", "gauge"]
"""How staying on an object selects it."""

OF_TWO_LAMPS: dict[str, Any] = {
    "trust": {"max_position_sigma_m": 1.5, "max_yaw_sigma_deg": 30.0},
    "drift": {"max_yaw_sigma_deg": 35.0},
}
"""Who asks for two lamps, as the paper has it, gets the pose they tell, however little that is."""


@dataclass(frozen=True, kw_only=True)
class Choices:
    """What the command line changes about a scenario."""

    seed: int = 0
    localize: bool = False
    targets: int | None = None
    """How many lamps to point at; none: as the localizer has it."""
    poses: Sequence[Pose | None] = ()
    """Where people stand, for each in turn; who has none takes the scenario's place."""
    method: Method | None = None
    """How staying on an object selects it; none: as the scenario has it."""
    hand: str = ""
    """`left` or `right`; empty: as configured."""
    stature_m: float | None = None
    imu: Sequence[str] = ()
    """For each person in turn: `sim`, `simulated`, `serial:PORT` or `replay:FILE`."""
    leds: str = ""
    """Empty, or `expander:PORT`."""
    files: Sequence[Path] = ()
    """YAML files that map services to parameters."""
    settings: Sequence[str] = ()
    """`service.parameter=value`."""

    def of_one(self, index: int) -> "Choices":
        """Return these choices, made for one person, for the person `index`."""
        return replace(
            self,
            imu=["sim"] * index + list(self.imu) if self.imu else (),
            poses=[None] * index + list(self.poses) if self.poses else (),
        )


def site_launches(scenario: Scenario, choices: Choices) -> list[Launch]:
    """Return what all people of the scenario share.

    Raises:
        ConfigError: a service or parameter is wrong.
    """
    extra: dict[str, dict[str, Any]] = {}
    if choices.leds:
        kind, _, port = choices.leds.partition(":")
        if kind != "expander" or not port:
            raise ConfigError(f"--leds {choices.leds!r}: give expander:PORT, such as expander:/dev/ttyUSB0")
        if "led-driver" not in scenario.site:
            raise ConfigError(f"--leds {choices.leds!r}: the scenario has no led-driver")
        extra["led-driver"] = {"outputs": [{"kind": "expander", "port": port}]}
    if choices.method is not None:
        if "selector" not in scenario.site:
            raise ConfigError(f"--method {choices.method}: nothing is selected in {scenario.source}")
        extra["selector"] = {"method": choices.method}
    return [
        _launch(scenario, name, ({}, parameters, extra.get(name, {})), choices)
        for name, parameters in scenario.site.items()
    ]


def user_launches(scenario: Scenario, choices: Choices, user: str, index: int = 0) -> list[Launch]:
    """Return one person's services; `index` counts people from 0 and gives place, seed and device.

    Raises:
        ConfigError: a service or parameter is wrong.
    """
    check_name(user, "user")
    device = choices.imu[index] if index < len(choices.imu) else "sim"
    usual: dict[str, dict[str, Any]] = {
        "supervisor": {
            "profile": {
                "cursor_color": CURSOR_COLORS[index % len(CURSOR_COLORS)],
                "pattern": PATTERNS[index % len(PATTERNS)],
            }
        },
        "user-sim": {"target_kinds": scenario.target_kinds} if scenario.target_kinds else {},
        "imu-bridge": {"simulated": SWEEP},
    }
    if choices.localize:
        usual["user-sim"] |= REALISTIC
    extra = _person(scenario, choices, index, is_simulated=device == "sim")
    services = dict(scenario.user)
    if device != "sim":
        services.pop("user-sim", None)
        services.setdefault("imu-bridge", {})
        extra["imu-bridge"] = _device(device)
        extra["supervisor"]["autostart"] = True  # many devices have no button
    return [
        _launch(scenario, name, (usual.get(name, {}), parameters, extra.get(name, {})), choices, user)
        for name, parameters in services.items()
    ]


def _person(
    scenario: Scenario, choices: Choices, index: int, *, is_simulated: bool
) -> dict[str, dict[str, Any]]:
    """Return what the command line says of one person: how they are, where they stand, who knows it."""
    place = scenario.places[index % len(scenario.places)]
    position_m, yaw_deg = list(place.position_m), None if choices.localize else place.yaw_deg
    pose = choices.poses[index] if index < len(choices.poses) else None
    if pose is not None:
        if choices.localize and not is_simulated:
            raise ConfigError(
                f"--pose {pose.x_m:g},{pose.y_m:g}: --localize finds out where who wears a device is; "
                "leave one of the two out"
            )
        position_m = [pose.x_m, pose.y_m, 0.0]
        yaw_deg = pose.yaw_deg if choices.localize else pose.yaw_deg or 0.0
    localizer: dict[str, Any] = {"position_m": position_m, "yaw_deg": yaw_deg}
    if choices.localize:  # who localizes is told nothing
        localizer = {"method": "static_targets"}
        if choices.targets is not None:
            localizer["targets"] = choices.targets
            if choices.targets == 2:
                localizer |= OF_TWO_LAMPS
    elif choices.targets is not None:
        raise ConfigError(f"--targets {choices.targets}: add --localize, which points at them")
    profile: dict[str, Any] = {"hand": choices.hand} if choices.hand else {}
    body = dict(profile)
    if choices.stature_m is not None:
        profile["stature_m"] = choices.stature_m
        body |= body_of(choices.stature_m)
    return {
        "localizer": localizer,
        "supervisor": {"localize": choices.localize, "profile": profile},
        "user-sim": {
            "position_m": position_m,
            "yaw_deg": yaw_deg,
            "seed": choices.seed + index,
            "body": body,
        },
    }


def check_settings(launches: Sequence[Launch], choices: Choices) -> None:
    """Make sure that no `--set` is without effect.

    Raises:
        ConfigError: one is for a service that is not among `launches`.
    """
    running = {launch.service.NAME for launch in launches}
    for setting in choices.settings:
        service = _split(setting)[0][0]
        if service not in running:
            raise ConfigError(
                f"--set {setting!r}: {service} is not among what this starts: {', '.join(sorted(running))}"
            )


def _device(device: str) -> dict[str, Any]:
    kind, _, argument = device.partition(":")
    if kind == "simulated" and not argument:
        return {"source": "simulated"}
    if kind == "serial" and argument:
        return {"source": "serial", "serial": {"port": argument}}
    if kind == "replay" and argument:
        return {"source": "replay", "replay": {"recording": argument}}
    raise ConfigError(f"--imu {device!r}: give sim, simulated, serial:PORT or replay:FILE.csv")


def _launch(
    scenario: Scenario, name: str, layered: Sequence[Mapping[str, Any]], choices: Choices, user: str = ""
) -> Launch:
    scope = "user" if user else "site"
    try:
        row = registry.process(name)
    except KeyError as error:
        raise ConfigError(f"{scenario.source}: {scope}: {error.args[0]}") from error
    if row.scope != scope:
        raise ConfigError(f"{scenario.source}: {scope}: {name} must stand under {row.scope}")
    service = row.load()
    layers = Layers()
    for values, source in zip(
        layered, ("defaults of scenarios", scenario.source, "command line"), strict=True
    ):
        layers.add(values, f"{source}, {name}")
    for path in choices.files:
        layers.add(_section(path, name), f"{path}, {name}")
    layers.add_environment(os.environ, environment_prefix(name))
    for setting in choices.settings:
        target, text = _split(setting)
        if target[0] == name:
            layers.add_text(target[1:], text, f"--set {setting}")
    return Launch(service=service, config=layers.build(service.CONFIG), user=user)


def _section(path: Path, name: str) -> Mapping[str, Any]:
    sections = read_yaml(path)
    for section in sections:
        if section not in {row.name for row in registry.PROCESSES}:
            raise ConfigError(f"{path}: {section!r} is no service; `pointit list` shows them")
    value = sections.get(name, {})
    if not isinstance(value, dict):
        raise ConfigError(f"{path}: {name}: a mapping of parameters was expected, got {value!r}")
    return cast("dict[str, Any]", value)


def _split(setting: str) -> tuple[list[str], str]:
    target, separator, text = setting.partition("=")
    path = target.split(".")
    if not separator or len(path) < 2:
        raise ConfigError(f"--set {setting!r}: write service.parameter=value, such as pui.map=conveyor")
    if path[0] not in {row.name for row in registry.PROCESSES}:
        raise ConfigError(f"--set {setting!r}: {path[0]!r} is no service; `pointit list` shows them")
    return path, text
