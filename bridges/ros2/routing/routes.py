"""THE ROUTE TABLE: every topic and service of ROS that the bridge has; and the file that changes it.

The rows are in `outbound.table` and `inbound.table`. A file may change them:

    prefix: /site1              # before every name in ROS but those of `UNPREFIXED`
    world: map                  # the frame {W}
    routes:
      pointing_ray: {ros: "/{user}/ray", rate_hz: 20}
      rotation_in: {enabled: false}
"""

import dataclasses
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import Field, ValidationError, field_validator

from pointit.bridges.ros2.inbound.table import inward, served
from pointit.bridges.ros2.outbound.humans import of_ros4hri
from pointit.bridges.ros2.outbound.table import outward
from pointit.bridges.ros2.routing.route_types import InboundRoute, OutboundRoute, ServiceRoute
from pointit.runtime.config.config import Config, validate
from pointit.runtime.config.validation_message import describe_validation_error, unknown_parameter_message
from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.errors import ConfigError

Row = TypeVar("Row", OutboundRoute, InboundRoute, ServiceRoute)

UNPREFIXED = ("/tf", "/tf_static", "/clock", "/diagnostics", "/rosout")
"""Names that ROS fixes."""
ROS4HRI = "/humans/"
"""Namespace that REP-155 fixes."""
TF = "tf2_msgs/msg/TFMessage"

MAX_NAME = 150
"""Maximum characters of a name in ROS before its user is inserted; a resolved one may have 247."""

_NAME = re.compile(r"(/([A-Za-z_][A-Za-z0-9_]*|\{(user|led)\}))+\Z")
_PREFIX = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)*\Z")
_FRAME = re.compile(r"(?!/)[^\s{}]+\Z")


class RouteChange(Config):
    """Changes of one route."""

    ros: Annotated[
        str | None, Field(max_length=MAX_NAME, description="name in ROS; as in the table if empty")
    ] = None
    rate_hz: Annotated[
        float | None, Field(gt=0, le=1000, description="highest rate, Hz; as in the table if empty")
    ] = None
    enabled: Annotated[bool | None, Field(description="true to have the route; as in the table if empty")] = (
        None
    )

    @field_validator("ros")
    @classmethod
    def _name(cls, ros: str | None) -> str | None:
        if ros is None:
            return None
        if not _NAME.match(ros) or ros.count("{") > 1:
            raise ValueError("begin with /, use letters, digits, _, / and at most one {user} or {led}")
        return ros


class RoutesFile(Config):
    """File that changes routes."""

    prefix: Annotated[str, Field(max_length=100, description="before names in ROS, such as /site1")] = ""
    world: Annotated[str, Field(max_length=MAX_NAME, description="name of the frame {W}")] = "world"
    routes: dict[str, RouteChange] = Field(default={}, description="changes by a route's name")

    @field_validator("prefix")
    @classmethod
    def _prefix(cls, prefix: str) -> str:
        if not _PREFIX.match(prefix):
            raise ValueError("begin with / and use letters, digits, _ and /")
        return prefix

    @field_validator("world")
    @classmethod
    def _world(cls, world: str) -> str:
        if not _FRAME.match(world):
            raise ValueError("a frame has no spaces, no { } and no leading /")
        return world


@dataclass(frozen=True)
class Routes:
    """The route table; names are unique."""

    outward: tuple[OutboundRoute, ...]
    inward: tuple[InboundRoute, ...]
    served: tuple[ServiceRoute, ...]
    file: RoutesFile
    """Source of the name of the frame {W}."""

    @property
    def all(self) -> tuple[OutboundRoute | InboundRoute | ServiceRoute, ...]:
        """Return all rows."""
        return (*self.outward, *self.inward, *self.served)


def routes(path: Path | None = None, *, ros4hri: bool = False) -> Routes:
    """Return the table with new converters, changed by the file at `path` if there is one.

    Args:
        path: path of the file. It may change routes of ROS4HRI even if `ros4hri` is False.
        ros4hri: True if the table includes the routes of ROS4HRI.

    Raises:
        ConfigError: If the file cannot be used. The message has the route, the value and the remedy.
    """
    all_outward = (*outward(), *of_ros4hri())
    table = Routes(all_outward, inward(), served(), RoutesFile())
    if path is not None:
        table = changed(table, read_routes(path), str(path))
    if ros4hri:
        return table
    without_ros4hri = tuple(row for row in table.outward if not row.is_ros4hri)
    return dataclasses.replace(table, outward=without_ros4hri)


def read_routes(path: Path) -> RoutesFile:
    """Return the changes of a file.

    Raises:
        ConfigError: If it cannot be read or used.
    """
    try:
        return validate(RoutesFile, read_yaml(path))
    except ValidationError as error:
        raise ConfigError(f"{path}: {describe_validation_error(error, RoutesFile)}") from error


def changed(table: Routes, file: RoutesFile, source: str) -> Routes:
    """Return `table` with the changes of `file`, which `source` names in errors.

    Raises:
        ConfigError: If a route does not exist, loses its placeholder, or two mean the same.
    """
    known = [row.name for row in table.all]
    for name in file.routes:
        if name not in known:
            problem = unknown_parameter_message(name, known).replace("parameter", "route")
            raise ConfigError(f"{source}: routes: {problem}")
    rows_outward = tuple(_changed(row, file, source) for row in table.outward)
    rows_inward = tuple(_changed(row, file, source) for row in table.inward)
    rows_served = tuple(_changed(row, file, source) for row in table.served)

    # After all changes: two routes may exchange their names
    for rows in (rows_outward, rows_inward, rows_served):
        _check_apart(rows, source)
    return Routes(rows_outward, rows_inward, rows_served, file)


def _changed(row: Row, file: RoutesFile, source: str) -> Row:
    change = file.routes.get(row.name, RouteChange())
    origin = f"{source}: routes.{row.name}"
    ros = row.ros if change.ros is None else change.ros
    placeholder = _placeholder(row.ros)
    if _placeholder(ros) != placeholder:
        remedy = "leave { } out"
        if placeholder:
            remedy = f"write {placeholder} into it, as there is one for each"
        raise ConfigError(f"{origin}.ros: {remedy} (got {ros!r})")
    is_fixed = ros in UNPREFIXED or ros.startswith(ROS4HRI)
    if change.ros is None and not is_fixed:
        ros = file.prefix + ros
    if change.rate_hz is not None and isinstance(row, ServiceRoute):
        raise ConfigError(f"{origin}.rate_hz: a service has none, leave it out")
    changes: dict[str, Any] = change.model_dump(exclude_none=True)
    changes["ros"] = ros
    return dataclasses.replace(row, **changes)


def _check_apart(
    rows: Sequence[OutboundRoute] | Sequence[InboundRoute] | Sequence[ServiceRoute], source: str
) -> None:
    """Check that no two routes publish, read or serve the same name.

    /tf may be both published and read, and published by several routes.
    """
    rows_by_name: dict[str, OutboundRoute | InboundRoute | ServiceRoute] = {}
    for row in rows:
        if not row.enabled:
            continue
        other = rows_by_name.setdefault(row.ros, row)
        is_tf = other.type == row.type == TF
        if other is not row and not is_tf:
            raise ConfigError(
                f"{source}: routes.{row.name}.ros: {row.ros!r} is that of {other.name} already; rename "
                "or switch off one of them"
            )


def _placeholder(ros: str) -> str:
    if "{" not in ros:
        return ""
    end = ros.index("}") + 1
    return ros[ros.index("{") : end]
