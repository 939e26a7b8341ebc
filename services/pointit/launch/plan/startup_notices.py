"""Notices when people's services start: assumed places and stored calibrations."""

from collections.abc import Iterator, Sequence

from pointit.launch.plan.launches import Choices
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import StateFile
from pointit.runtime.service.service import Launch
from pointit.schemas import PointingOffset
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.stored_mounting import PURPOSE, MountingSelection, StoredMountings
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.supervisor.user_messages import OFFSET_PURPOSE, minute, offset_in_use


def assumed_places(launches: Sequence[Launch], choices: Choices, first: int = 0) -> Iterator[str]:
    """Yield a message for each person with a device whose place was not given.

    People are in the order of `choices`, in which the first of them has the index `first`.
    """
    simulated = {launch.user for launch in launches if launch.service.NAME == "user-sim"}
    users = list(dict.fromkeys(launch.user for launch in launches if launch.user))
    places = {launch.user: launch.config for launch in launches if isinstance(launch.config, LocalizerConfig)}
    source = "the scenario or a file of --config says" if choices.files else "the scenario says"
    is_set = any(setting.startswith("localizer.") for setting in choices.settings)
    for index, user in enumerate(users, start=first):
        config = places.get(user)
        is_given = is_set or (index < len(choices.poses) and choices.poses[index] is not None)
        if user in simulated or config is None or config.method != "fixed" or is_given:
            continue
        x_m, y_m, _ = config.position_m
        yield (
            f"{user} is assumed to stand at {x_m:.2f}, {y_m:.2f} m, yaw {config.yaw_deg:g}°, as {source}; "
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
