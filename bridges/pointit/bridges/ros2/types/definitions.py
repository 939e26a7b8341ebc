"""Definitions of ROS types: a distribution's own, from rosbags, and ours, from `interfaces/`."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rosbags.typesys import Stores, TypesysError, get_typestore
from rosbags.typesys.base import make_typesdict
from rosbags.typesys.msg import MSGParser
from rosbags.typesys.store import Typestore

from pointit.bridges.ros2.graph.backend import Distro
from pointit.runtime.errors import ConfigError

INTERFACES = Path(__file__).parents[1] / "interfaces"
"""Two packages that a ROS user builds with colcon; they define what we send."""

STORES: dict[Distro, Stores] = {
    "humble": Stores.ROS2_HUMBLE,
    "jazzy": Stores.ROS2_JAZZY,
    "kilted": Stores.ROS2_KILTED,
    "lyrical": Stores.ROS2_LYRICAL,
    "rolling": Stores.ROS2_LYRICAL,  # the newest available
}

# rosbags has no services.
STANDARD_SERVICES = {
    "rcl_interfaces/srv/GetParameters": "string[] names\n---\nrcl_interfaces/ParameterValue[] values\n",
    "rcl_interfaces/srv/ListParameters": "uint64 DEPTH_RECURSIVE=0\nstring[] prefixes\nuint64 depth\n---\n"
    "rcl_interfaces/ListParametersResult result\n",
    "std_srvs/srv/Empty": "---\n",
    "std_srvs/srv/SetBool": "bool data\n---\nbool success\nstring message\n",
    "std_srvs/srv/Trigger": "---\nbool success\nstring message\n",
}

# rosbags has no packages outside ROS's core. Fields of hri_msgs 2.3.2 (ROS4HRI, Apache License 2.0). They are
# not in `interfaces/`, where colcon would build a second hri_msgs with these two types only.
ROS4HRI_MESSAGES = {
    "hri_msgs/msg/IdsList": "std_msgs/Header header\nstring[] ids\n",
    "hri_msgs/msg/IdsMatch": "int8 UNSET=0\nint8 PERSON=1\nint8 FACE=2\nint8 BODY=3\nint8 VOICE=4\n"
    "string id1\nint8 id1_type\nstring id2\nint8 id2_type\nfloat32 confidence\n",
}

# rosbags drops defaults of definitions; of the standard types in use, only this one
# has any but zero.
STANDARD_DEFAULTS: dict[str, dict[str, Any]] = {"geometry_msgs/msg/Quaternion": {"w": 1.0}}


class Definitions:
    """Fields and defaults of every type of `distro` and of ours.

    Raises:
        ConfigError: If a file of `interfaces/` is not a definition.
    """

    def __init__(self, distro: Distro) -> None:
        self.store: Typestore = get_typestore(STORES[distro])
        self.services: set[str] = set()
        self.defaults = dict(STANDARD_DEFAULTS)
        parsed: dict[str, Any] = {}
        for name, text in _texts():
            for part, lines in _parts(name, text):
                fields, defaults = _parsed(part, lines)
                parsed[part] = fields
                if defaults:
                    self.defaults[part] = defaults
            if "/srv/" in name:
                self.services.add(name)
        self.store.register(parsed)


def _texts() -> Iterator[tuple[str, str]]:
    """Yield name and text of types that rosbags lacks."""
    yield from (STANDARD_SERVICES | ROS4HRI_MESSAGES).items()
    for path in sorted(INTERFACES.glob("*/*/*")):
        if path.suffix in {".msg", ".srv"}:
            package, kind = path.parts[-3:-1]
            yield f"{package}/{kind}/{path.stem}", path.read_text(encoding="utf-8")


def _parts(name: str, text: str) -> list[tuple[str, str]]:
    """Return the messages of a definition: itself, or a service's request and response."""
    if "/srv/" not in name:
        return [(name, text)]
    request, _, response = text.partition("---\n")
    return [(f"{name}_Request", request), (f"{name}_Response", response)]


def _parsed(name: str, text: str) -> tuple[Any, dict[str, Any]]:
    """Return constants and fields as rosbags keeps them, and the defaults of fields."""
    try:
        # The parser would put a service's halves under `/srv/msg/`; it gets a message, and the name is kept.
        (message,) = MSGParser(f"MSG: {name.replace('/srv/', '/msg/')}\n{text}").specification()
    except TypesysError as error:
        raise ConfigError(f"{name} in {INTERFACES}: is not a definition of a ROS type ({error})") from error
    (definition,) = make_typesdict([message]).values()
    return definition, {field.name: field.value for field in message.fields if field.value is not None}
