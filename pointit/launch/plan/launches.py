"""Service launches from a scenario and the command line's changes to it: parameters, notices at the start."""

import os
import re
import zlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np

from pointit.geometry.floor_sigma import ROBOT_PLACE_SIGMA_M
from pointit.launch.plan.plan import REALISTIC, FloorPose, Scenario, ScenarioPlace, body_of
from pointit.runtime.config.config import Layers
from pointit.runtime.config.environment_variables import environment_prefix
from pointit.runtime.config.nearest_name import nearest
from pointit.runtime.config.plugins import PluginConfig, PluginGroup
from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import StateFile
from pointit.runtime.service.service import Launch
from pointit.schemas import PointingOffset
from pointit.schemas.system import check_user, instance_of, split_instance
from pointit.schemas.topics import check_name
from pointit.services import registry
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.sources import SOURCES
from pointit.services.imu_bridge.stored_mounting import PURPOSE, MountingSelection, StoredMountings
from pointit.services.led_driver.outputs import OUTPUTS
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.registry import Process
from pointit.services.selector.selection_methods import METHODS
from pointit.services.supervisor.transitions import OFFSET_PURPOSE, minute, offset_in_use

ROS2 = "ros2"
"""The process of the ROS 2 bridge: starts if the run requests it or the scenario names it."""
PAGE = "web"
"""The process of the page: belongs to a run, so it is not among a scenario's services."""
SWEEP = {"elevation_deg": 2.0, "elevation_amplitude_deg": 5.0}
"""Simulated device: the arm is nearly level, so that it points at objects at table or belt height."""

CURSOR_COLORS = (
    (255, 255, 255),
    (86, 180, 233),
    (240, 228, 66),
    (204, 121, 167),
    (230, 159, 0),
    (0, 158, 115),
)
"""Cursor colours by person index: white, then hues that colour-blind people can distinguish (Okabe, Ito)."""
PATTERNS = ("solid", "dashed", "striped", "dotted", "hollow", "tailed")
"""Patterns of selected objects by person index: a second cue beside the colour."""

OF_TWO_LAMPS: dict[str, Any] = {
    "trust": {"max_position_sigma_m": 1.5, "max_yaw_sigma_deg": 30.0},
    "drift": {"max_yaw_sigma_deg": 35.0},
}
"""With two lamps, as in the paper, poses are uncertain but still accepted."""
FOLLOWING: dict[str, Any] = {"method": "moving_target", "window_s": 10.0, "give_up_s": 60.0}
"""Localization by a robot: people follow it with the arm, s."""
AIM_SHARE = 0.9
"""Share of the uncertainty of a goal that the pose may cause: the aim adds to it."""
LAMPS = "lamps"
LOCALIZATIONS = re.compile(r"lamps|robot(:.*)?")
"""Ways to localize people by pointing: at lamps, or by following a robot, which may be named."""
ROBOT = "robot"
"""The process of a robot, `robot.NAME` in scenarios."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Parameters of services from the command line."""

    files: Sequence[Path] = ()
    """YAML files that map services to parameters."""
    settings: Sequence[str] = ()
    """`service.parameter=value`."""


def layers_of(instance: str, below: Mapping[str, Mapping[str, Any]], chosen: Settings) -> Layers:
    """Return the parameters of a service: `below`, by source, then files, variables and `--set`.

    One of several services on a site, such as `robot.quad`, gets the parameters of `robot`, too, and its own
    last.

    Raises:
        ConfigError: a file or setting is wrong.
    """
    name = split_instance(instance)[0]
    names = dict.fromkeys((name, instance))
    layers = Layers(registry.process(name).config().REPLACED)
    for source, values in below.items():
        layers.add(values, f"{source}, {instance}")
    for path in chosen.files:
        for target_name in names:
            layers.add(_section(path, target_name), f"{path}, {target_name}")
    layers.add_environment(os.environ, environment_prefix(name))

    # the settings of one service come after those of its kind, whichever stands first
    for target_name in names:
        for setting in chosen.settings:
            target, path_in, text = _split(setting)
            if target == target_name:
                layers.add_text(path_in, text, f"--set {setting}")
    return layers


def check_settings(running: Collection[Launch], chosen: Settings, *others: str) -> None:
    """Check that every `--set` affects a service in `running`, or in `others` that are started.

    Raises:
        ConfigError: If one is for a service that is not started.
    """
    services = {*(launch.service.NAME for launch in running), *others}
    named = {launch.instance for launch in running if launch.name}
    for setting in chosen.settings:
        target, _, _ = _split(setting)
        if target not in services | named:
            candidates = named or services
            if target in registry.names():
                candidates = services
            listed = ", ".join(sorted(candidates))
            raise ConfigError(f"--set {setting!r}: {target} is not among what this starts: {listed}")


def service_of(setting: str) -> str:
    """Return the service named in a `--set`.

    Raises:
        ConfigError: If it is malformed, or there is no such service.
    """
    return split_instance(_split(setting)[0])[0]


def _section(path: Path, name: str) -> Mapping[str, Any]:
    sections = registry.sections_by_service(read_yaml(path), str(path))
    for section in sections:
        _check_service(section, str(path))
    value = sections.get(name, {})
    if not isinstance(value, dict):
        raise ConfigError(f"{path}: {name}: a mapping of parameters was expected, got {value!r}")
    return cast("dict[str, Any]", value)


def _split(setting: str) -> tuple[str, list[str], str]:
    """Return the service, or one of several such as `robot.quad`; the path of its parameter; the value."""
    target, separator, text = setting.partition("=")
    path = target.split(".")
    if not separator or len(path) < 2:
        raise ConfigError(f"--set {setting!r}: write service.parameter=value, such as pui.map=conveyor")
    path[0] = registry.with_service_name(path[0])
    _check_service(path[0], f"--set {setting!r}")
    may_name_instance = len(path) > 2 and registry.process(path[0]).several
    if may_name_instance and not _is_parameter(path[0], path[1]):
        instance = instance_of(path[0], path[1])
        return instance, path[2:], text
    return path[0], path[1:], text


def _is_parameter(service: str, name: str) -> bool:
    config = registry.process(service).config()
    if name in config.model_fields:
        return True
    return issubclass(config, PluginConfig) and name in config.plugins().names


def _check_service(instance: str, source: str) -> None:
    name, which = split_instance(instance)
    known = registry.names()
    if name not in known:
        problem = f"{name!r} is no service"
        raise ConfigError(f"{source}: {problem}; {nearest(name, known)}")
    if which and not registry.process(name).several:
        problem = f"{instance!r}: a site has one {name}"
        raise ConfigError(f"{source}: {problem}; leave out {which!r}")


def seed_of(seed: int, part: str) -> int:
    """Return the seed of `part`, an instance such as `conveyor-sim` or `imu-bridge.user1`.

    The streams of different parts are independent (numpy's `SeedSequence`) and do not change when other
    parts are added or removed.
    """
    sequence = np.random.SeedSequence([seed, zlib.crc32(part.encode())])
    return int(sequence.generate_state(1)[0])


@dataclass(frozen=True, kw_only=True)
class Choices(Settings):
    """Changes of the command line to a scenario."""

    seed: int = 0
    localize: bool = False
    robot: str | None = None
    """Robot that people follow to be localized, `""` for the scenario's first. None: they point at lamps."""
    targets: int | None = None
    """Number of lamps to point at. None: the localizer's default."""
    poses: Sequence[FloorPose | None] = ()
    """Pose per person. None: the scenario's place."""
    method: str = ""
    """Selection method, `NAME` or `NAME:VALUE`, or `""` for the scenario's."""
    hand: str = ""
    """`left` or `right`, or `""` as configured."""
    stature_m: float | None = None
    imu: Sequence[str] = ()
    """IMU per person: `sim`, `page`, `simulated`, `serial:PORT` or `replay:FILE`."""
    output: str = ""
    """`expander:PORT`, or `""`."""
    services: Sequence[str] = ()
    """Services to add to those of the scenario, also of other packages."""
    ros2: bool = False
    """The site is also a node in a ROS 2 graph. As with `page`, ROS may move people's wrists."""
    page: bool = False
    """People may point with a page: simulated people also get an imu-bridge, which waits for a page."""

    def of_one(self, index: int) -> "Choices":
        """Return these choices, made for one person, as choices for the person `index`."""
        imu: Sequence[str] = ()
        if self.imu:
            imu = ["sim"] * index + list(self.imu)
        poses: Sequence[FloorPose | None] = ()
        if self.poses:
            poses = [None] * index + list(self.poses)
        return replace(self, imu=imu, poses=poses)


def site_launches(scenario: Scenario, choices: Choices) -> list[Launch]:
    """Return the services that all people of the scenario share.

    Raises:
        ConfigError: a service or parameter is wrong.
    """
    # The command line, which the scenario must have a service for
    extra: dict[str, dict[str, Any]] = {}
    if choices.output:
        kind, parameters = _choose("--output", choices.output, OUTPUTS)
        if "led-driver" not in scenario.site:
            raise ConfigError(f"--output {choices.output!r}: the scenario has no led-driver")
        extra["led-driver"] = {"outputs": [{"kind": kind, **parameters}]}
    if choices.method:
        if "selector" not in scenario.site:
            raise ConfigError(f"--method {choices.method}: nothing is selected in {scenario.source}")
        extra["selector"] = _plugin_parameters("--method", choices.method, METHODS, "method")
    if choices.localize and choices.robot is not None:
        places = [place.position_m for place in scenario.places]
        followed = followed_robot(scenario, choices.robot)
        instance = ROBOT if followed == ROBOT else f"{ROBOT}.{followed}"
        extra[instance] = {"figure": {"people_m": places}}

    # A seed of its own for the simulation, which the scenario may replace
    seed = seed_of(choices.seed, "conveyor-sim")
    usual: dict[str, dict[str, Any]] = {"conveyor-sim": {"seed": seed}}
    services = dict(scenario.site)
    for name in added_services(choices, "site"):
        services.setdefault(name, {})
    if choices.ros2:
        services.setdefault(ROS2, {})
    launches: list[Launch] = []
    for name, parameters in services.items():
        if name == PAGE:  # runs beside the scenario
            continue
        layered = (usual.get(name, {}), parameters, extra.get(name, {}))
        launches.append(_launch(scenario, name, layered, choices))
    return launches


def user_launches(scenario: Scenario, choices: Choices, user: str, index: int = 0) -> list[Launch]:
    """Return one person's services. `index` (from 0) determines place, seed and device.

    Raises:
        ConfigError: a service or parameter is wrong.
    """
    check_user(user)
    device = choices.imu[index] if index < len(choices.imu) else "sim"

    # Defaults, which the scenario may replace
    profile = {
        "cursor_color": CURSOR_COLORS[index % len(CURSOR_COLORS)],
        "pattern": PATTERNS[index % len(PATTERNS)],
    }
    target_kinds = {"target_kinds": scenario.target_kinds} if scenario.target_kinds else {}
    usual: dict[str, dict[str, Any]] = {
        "supervisor": {"profile": profile},
        "user-sim": target_kinds,
        "imu-bridge": {"simulated": SWEEP},
    }
    if device == "sim" and "user-sim" in scenario.user:
        usual["imu-bridge"] = {"source": "page"}  # it only waits for one
    if choices.localize:
        usual["user-sim"] |= REALISTIC
    extra = _person(scenario, choices, index, is_simulated=device == "sim")

    # A person with a device is not simulated, and needs an imu-bridge
    services = dict(scenario.user)
    for name in added_services(choices, "user"):
        services.setdefault(name, {})
    if device != "sim":
        services.pop("user-sim", None)
        services.setdefault("imu-bridge", {})
        extra["imu-bridge"] = _plugin_parameters("--imu", device, SOURCES, "source")
        extra["supervisor"]["autostart"] = True  # many devices have no button
    elif choices.page or choices.ros2 or ROS2 in scenario.site:  # they may bring a device later
        services.setdefault("imu-bridge", {})
    launches: list[Launch] = []
    for name, parameters in services.items():
        layered = (usual.get(name, {}), parameters, extra.get(name, {}))
        launches.append(_launch(scenario, name, layered, choices, user))
    return launches


def shard_launches(scenario: Scenario, choices: Choices, user: str) -> list[Launch]:
    """Return the shards that serve the person alone, with the scenario's parameters.

    Their map is the site's, unless a file or setting names one.

    Raises:
        ConfigError: a parameter is wrong.
    """
    launches: list[Launch] = []
    for row in registry.PROCESSES:
        if row.shard_serves is None or row.name not in scenario.site:
            continue
        parameters = dict(scenario.site[row.name])
        parameters.pop("map", None)
        layered = ({}, parameters, {"people": [user]})
        launches.append(_launch(scenario, instance_of(row.name, user), layered, choices))
    return launches


def _person(
    scenario: Scenario, choices: Choices, index: int, *, is_simulated: bool
) -> dict[str, dict[str, Any]]:
    """Return one person's parameters from the command line: body, pose and which services know the pose."""
    place = scenario.place_of(index)
    position_m = list(place.position_m)
    yaw_deg = None if choices.localize else place.yaw_deg
    pose = choices.poses[index] if index < len(choices.poses) else None
    if pose is not None:
        if choices.localize and not is_simulated:
            given = f"--pose {pose.x_m:g},{pose.y_m:g}"
            raise ConfigError(
                f"{given}: --localize finds the pose of people with a device; leave one of the two out"
            )
        position_m = [pose.x_m, pose.y_m, 0.0]
        yaw_deg = pose.yaw_deg if choices.localize else pose.yaw_deg or 0.0

    # The localizer gets the pose, or finds it by a robot or by lamps
    localizer: dict[str, Any] = {"position_m": position_m, "yaw_deg": yaw_deg}
    supervisor: dict[str, Any] = {"localize": choices.localize}
    if choices.localize and choices.robot is not None:
        limit_m = scenario.user.get("goal", {}).get("max_sigma_m", ROBOT_PLACE_SIGMA_M)
        localizer = FOLLOWING | {"robot_id": followed_robot(scenario, choices.robot)}
        localizer["max_place_sigma_m"] = AIM_SHARE * limit_m
        supervisor["localization_method"] = "moving_target"
        if choices.targets is not None:
            raise ConfigError(f"--targets {choices.targets}: --localize robot has no lamps; leave one out")
    elif choices.localize:  # the localizer must not know the pose
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

    # The simulated person stands there whether the localizer knows it or not
    user_sim = {
        "position_m": position_m,
        "yaw_deg": yaw_deg,
        "seed": choices.seed + index,
        "body": body,
    }
    return {
        "localizer": localizer,
        "supervisor": supervisor | {"profile": profile},
        "user-sim": user_sim,
    }


def robot_of(localization: str | None) -> str | None:
    """Return the robot that one of `LOCALIZATIONS` names, `""` if it names none. None: it is by lamps."""
    kind, _, name = (localization or "").partition(":")
    return name if kind == ROBOT else None


def robots_of(scenario: Scenario) -> list[str]:
    """Return the names of the robots of a scenario."""
    robots: list[str] = []
    for instance in scenario.site:
        service, name = split_instance(instance)
        if service == ROBOT:
            robots.append(name or ROBOT)
    return robots


def followed_robot(scenario: Scenario, robot: str) -> str:
    """Return the robot of the scenario that people follow: `robot`, or the first one if that is `""`.

    Raises:
        ConfigError: If it is not there.
    """
    robots = robots_of(scenario)
    if not robots:
        raise ConfigError(
            f"--localize robot: {scenario.source} has no robot; add one to its site (robot.NAME), or leave "
            "`robot` out to point at lamps"
        )
    if robot and robot not in robots:
        listed = ", ".join(robots)
        raise ConfigError(f"--localize robot:{robot}: {scenario.source} has no such robot; it has {listed}")
    return robot or robots[0]


def place_of(scenario: Scenario, choices: Choices, index: int) -> ScenarioPlace:
    """Return the assumed place of the person `index`: from the command line, else from the scenario."""
    pose = choices.poses[index] if index < len(choices.poses) else None
    if pose is None:
        return scenario.place_of(index)
    return ScenarioPlace(position_m=(pose.x_m, pose.y_m, 0.0), yaw_deg=pose.yaw_deg or 0.0)


def added_services(choices: Choices, scope: Literal["site", "user"]) -> list[str]:
    """Return the services of a scope that the command line adds.

    Raises:
        ConfigError: If one is not installed or cannot be used.
    """
    services = map(registry.with_service_name, choices.services)
    return [name for name in services if _row(name, f"--with {name}").scope == scope]


def _row(instance: str, source: str) -> Process:
    name, which = split_instance(instance)
    try:
        row = registry.process(name)
        if which:
            check_name(which, f"{source}: name")
    except KeyError as error:
        raise ConfigError(f"{source}: {error.args[0]}") from error
    except ConfigError as error:
        raise ConfigError(f"{source}: {error}") from error
    if which and not row.several:
        problem = f"{instance}: a site has one {name}"
        raise ConfigError(f"{source}: {problem}; leave out {which!r}")
    return row


def _choose(option: str, text: str, group: PluginGroup[Any]) -> tuple[str, dict[str, Any]]:
    try:
        return group.choose(text)
    except ConfigError as error:
        raise ConfigError(f"{option} {text!r}: {error}") from error


def _plugin_parameters(option: str, text: str, group: PluginGroup[Any], parameter: str) -> dict[str, Any]:
    name, parameters = _choose(option, text, group)
    return {parameter: name, **({name: parameters} if parameters else {})}


def _launch(
    scenario: Scenario, name: str, layered: Sequence[Mapping[str, Any]], choices: Choices, user: str = ""
) -> Launch:
    scope = "user" if user else "site"
    row = _row(name, f"{scenario.source}: {scope}")
    if row.scope != scope:
        problem = f"{name} must stand under {row.scope}"
        raise ConfigError(f"{scenario.source}: {scope}: {problem}")
    service = row.load()
    sources = ("defaults of scenarios", scenario.source, "command line")
    below = dict(zip(sources, layered, strict=True))
    config = layers_of(name, below, choices).build(service.CONFIG)
    which = split_instance(name)[1]
    return Launch(service=service, config=config, user=user, name=which, plugin=row.label)


def assumed_places(launches: Sequence[Launch], choices: Choices, first: int = 0) -> Iterator[str]:
    """Yield a message for each person with a device whose place was not given.

    People are in the order of `choices`, in which the first of them has the index `first`.
    """
    simulated = {launch.user for launch in launches if launch.service.NAME == "user-sim"}
    users = list(dict.fromkeys(launch.user for launch in launches if launch.user))
    localizers: dict[str, LocalizerConfig] = {}
    for launch in launches:
        if isinstance(launch.config, LocalizerConfig):
            localizers[launch.user] = launch.config

    # A message for those whose localizer has a place that nobody chose
    source = "the scenario or a file of --config says" if choices.files else "the scenario says"
    is_set = any(setting.startswith("localizer.") for setting in choices.settings)
    for index, user in enumerate(users, start=first):
        config = localizers.get(user)
        if config is None or config.method != "fixed":
            continue
        has_pose = index < len(choices.poses) and choices.poses[index] is not None
        if is_set or has_pose or user in simulated:
            continue
        x_m, y_m, _ = config.position_m
        pose = f"{x_m:.2f}, {y_m:.2f} m, yaw {config.yaw_deg:g}°"
        yield (
            f"{user} is assumed to stand at {pose}, as {source}; "
            "give --pose X,Y,YAW or --localize to change that"
        )


def stored_mounting_notices(launches: Sequence[Launch]) -> Iterator[str]:
    """Yield a message for each stored mounting in use from the start."""
    for launch in launches:
        if not isinstance(launch.config, ImuBridgeConfig):
            continue
        try:
            stored = StateFile(StoredMountings, launch.user, PURPOSE).read()
        except ConfigError:
            continue  # the service reports that itself and continues without it
        if stored is not None and MountingSelection(launch.config, stored).is_measured:
            since = minute(stored.by_source[launch.config.source].set_ns)
            forget = f"`pointit person calibrate mounting {launch.user} --erase` forgets it"
            yield f"{launch.user}: a mounting of {since} is in use; {forget}"


def stored_offset_notices(launches: Sequence[Launch]) -> Iterator[str]:
    """Yield a message for each stored pointing offset in use from the start."""
    for launch in launches:
        if launch.service.NAME != "supervisor":
            continue
        try:
            stored = StateFile(PointingOffset, launch.user, OFFSET_PURPOSE).read()
        except ConfigError:
            continue  # as above
        if stored is not None:
            yield offset_in_use(launch.user, stored)
