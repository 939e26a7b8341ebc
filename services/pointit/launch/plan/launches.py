"""From a scenario and what the command line changes about it to the services that start."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from pointit.launch.plan.extras import load
from pointit.launch.plan.person import REALISTIC, Pose, body_of
from pointit.launch.plan.scenario import Place, Scenario
from pointit.launch.plan.seeds import seed_of
from pointit.launch.plan.settings import Settings, layers_of
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Launch
from pointit.schemas.system import check_user
from pointit.services import registry

ROS2 = "ros2"
"""The process of the bridge to ROS 2: of a run that asks for it, or of a scenario that names it."""

PAGE = "web"
"""The process of the page: of a run, not of a scenario, and so not among a scenario's services."""

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
class Choices(Settings):
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
    """For each person in turn: `sim`, `page`, `simulated`, `serial:PORT` or `replay:FILE`."""
    leds: str = ""
    """Empty, or `expander:PORT`."""
    ros2: bool = False
    """The site is a node in a ROS 2 graph too: as with `page`, ROS may move people's wrists."""
    page: bool = False
    """People may point with a page: who is simulated has an imu-bridge too, which waits for one."""

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
    usual: dict[str, dict[str, Any]] = {"conveyor-sim": {"seed": seed_of(choices.seed, "conveyor-sim")}}
    services = dict(scenario.site)
    if choices.ros2:
        services.setdefault(ROS2, {})
    return [
        _launch(scenario, name, (usual.get(name, {}), parameters, extra.get(name, {})), choices)
        for name, parameters in services.items()
        if name != PAGE
    ]


def user_launches(scenario: Scenario, choices: Choices, user: str, index: int = 0) -> list[Launch]:
    """Return one person's services; `index` counts people from 0 and gives place, seed and device.

    Raises:
        ConfigError: a service or parameter is wrong.
    """
    check_user(user)
    device = choices.imu[index] if index < len(choices.imu) else "sim"
    usual: dict[str, dict[str, Any]] = {
        "supervisor": {
            "profile": {
                "cursor_color": CURSOR_COLORS[index % len(CURSOR_COLORS)],
                "pattern": PATTERNS[index % len(PATTERNS)],
            }
        },
        "user-sim": {"target_kinds": scenario.target_kinds} if scenario.target_kinds else {},
        "imu-bridge": {"simulated": SWEEP | {"seed": seed_of(choices.seed, f"imu-bridge.{user}")}},
    }
    if device == "sim" and "user-sim" in scenario.user:
        usual["imu-bridge"] = {"source": "page"}  # it only waits for one
    if choices.localize:
        usual["user-sim"] |= REALISTIC
    extra = _person(scenario, choices, index, is_simulated=device == "sim")
    services = dict(scenario.user)
    if device != "sim":
        services.pop("user-sim", None)
        services.setdefault("imu-bridge", {})
        extra["imu-bridge"] = _device(device)
        extra["supervisor"]["autostart"] = True  # many devices have no button
    elif choices.page or choices.ros2 or ROS2 in scenario.site:
        services.setdefault("imu-bridge", {})
    return [
        _launch(scenario, name, (usual.get(name, {}), parameters, extra.get(name, {})), choices, user)
        for name, parameters in services.items()
    ]


def _person(
    scenario: Scenario, choices: Choices, index: int, *, is_simulated: bool
) -> dict[str, dict[str, Any]]:
    """Return what the command line says of one person: how they are, where they stand, who knows it."""
    place = scenario.place_of(index)
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


def place_of(scenario: Scenario, choices: Choices, index: int) -> Place:
    """Return where the person `index` is taken to stand: as the command line says, else the scenario."""
    pose = choices.poses[index] if index < len(choices.poses) else None
    if pose is None:
        return scenario.place_of(index)
    return Place(position_m=(pose.x_m, pose.y_m, 0.0), yaw_deg=pose.yaw_deg or 0.0)


def _device(device: str) -> dict[str, Any]:
    kind, _, argument = device.partition(":")
    if kind in {"simulated", "page"} and not argument:
        return {"source": kind}
    if kind == "serial" and argument:
        return {"source": "serial", "serial": {"port": argument}}
    if kind == "replay" and argument:
        return {"source": "replay", "replay": {"recording": argument}}
    raise ConfigError(f"--imu {device!r}: give sim, page, simulated, serial:PORT or replay:FILE.csv")


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
    service = load(row)
    named = dict(zip(("defaults of scenarios", scenario.source, "command line"), layered, strict=True))
    return Launch(service=service, config=layers_of(name, named, choices).build(service.CONFIG), user=user)
