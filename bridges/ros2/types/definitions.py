"""Definitions of ROS types, a distribution's own and ours, and RIHS01, the hash of them.

Source: REP 2016, whose description is rosidl's `type_description_interfaces/msg/TypeDescription`; checked
against hashes captured from a running Jazzy and a running Kilted.

Fields are described as in rosbags: `(BASE, (name, bound of a string))`, `(NAME, type)`, and
`(ARRAY, (one of those, length))`, `(SEQUENCE, (one of those, bound or 0))`.

Definitions that rosbags lacks, of packages of others: services, actions, and messages beside ROS's core.

They are not in `interfaces/`, where colcon would build second packages of these names.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

from rosbags.typesys import Stores, TypesysError, get_typestore
from rosbags.typesys.base import make_typesdict
from rosbags.typesys.msg import MSGParser
from rosbags.typesys.store import Typestore

from pointit.bridges.ros2.graph.backend import Distro
from pointit.runtime.errors import ConfigError

Fields = Sequence[tuple[str, Any]]

BASE = 1
NAME = 2
ARRAY = 3
SEQUENCE = 4

NAMED_ID = 1
IDS = {
    "int8": 2,
    "uint8": 3,
    "char": 3,  # a byte since ROS 2; the id 13 of that name is never used for it
    "int16": 4,
    "uint16": 5,
    "int32": 6,
    "uint32": 7,
    "int64": 8,
    "uint64": 9,
    "float32": 10,
    "float64": 11,
    "float128": 12,
    "wchar": 14,
    "bool": 15,
    "byte": 16,
    "string": 17,
    "wstring": 18,
}
BOUNDED_IDS = {"string": 21, "wstring": 22}
ARRAY_IDS = 48
BOUNDED_SEQUENCE_IDS = 96
SEQUENCE_IDS = 144

EMPTY: Fields = [("structure_needs_at_least_one_member", (BASE, ("uint8", 0)))]
"""Placeholder of an empty definition, in hashes and in CDR."""

EVENT_INFO = "service_msgs/msg/ServiceEventInfo"

NAVIGATE_TO_POSE = "nav2_msgs/action/NavigateToPose"

STANDARD_SERVICES = {
    "action_msgs/srv/CancelGoal": "action_msgs/GoalInfo goal_info\n---\nint8 ERROR_NONE=0\n"
    "int8 ERROR_REJECTED=1\nint8 ERROR_UNKNOWN_GOAL_ID=2\nint8 ERROR_GOAL_TERMINATED=3\n"
    "int8 return_code\naction_msgs/GoalInfo[] goals_canceling\n",
    "rcl_interfaces/srv/GetParameters": "string[] names\n---\nrcl_interfaces/ParameterValue[] values\n",
    "rcl_interfaces/srv/ListParameters": "uint64 DEPTH_RECURSIVE=0\nstring[] prefixes\nuint64 depth\n---\n"
    "rcl_interfaces/ListParametersResult result\n",
    "std_srvs/srv/Empty": "---\n",
    "std_srvs/srv/SetBool": "bool data\n---\nbool success\nstring message\n",
    "std_srvs/srv/Trigger": "---\nbool success\nstring message\n",
}

# Fields of hri_msgs 2.3.2 (ROS4HRI, Apache License 2.0).
ROS4HRI_MESSAGES = {
    "hri_msgs/msg/IdsList": "std_msgs/Header header\nstring[] ids\n",
    "hri_msgs/msg/IdsMatch": "int8 UNSET=0\nint8 PERSON=1\nint8 FACE=2\nint8 BODY=3\nint8 VOICE=4\n"
    "string id1\nint8 id1_type\nstring id2\nint8 id2_type\nfloat32 confidence\n",
}

# Fields of vision_msgs 4 (Apache License 2.0), that of Humble and newer.
VISION_MESSAGES = {
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score\n",
    "vision_msgs/msg/ObjectHypothesisWithPose": "vision_msgs/ObjectHypothesis hypothesis\n"
    "geometry_msgs/PoseWithCovariance pose\n",
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
    "vision_msgs/msg/Detection3D": "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
    "vision_msgs/BoundingBox3D bbox\nstring id\n",
    "vision_msgs/msg/Detection3DArray": "std_msgs/Header header\nvision_msgs/Detection3D[] detections\n",
}

# Fields of nav2_msgs (Apache License 2.0), which differ between distributions.
_GOAL = "geometry_msgs/PoseStamped pose\nstring behavior_tree\n"
_CODE = "uint16 NONE=0\nuint16 error_code\n"
_FEEDBACK = (
    "geometry_msgs/PoseStamped current_pose\nbuiltin_interfaces/Duration navigation_time\n"
    "builtin_interfaces/Duration estimated_time_remaining\nint16 number_of_recoveries\n"
    "float32 distance_remaining\n"
)
_TRACKING = "float32 position_tracking_error\nfloat32 heading_tracking_error\n"
_RESULTS = {"humble": "std_msgs/Empty result\n", "jazzy": _CODE}

INTERFACES = Path(__file__).parents[1] / "interfaces"
"""Two packages that a ROS user builds with colcon; they define what we send."""

STORES: dict[Distro, Stores] = {
    "humble": Stores.ROS2_HUMBLE,
    "jazzy": Stores.ROS2_JAZZY,
    "kilted": Stores.ROS2_KILTED,
    "lyrical": Stores.ROS2_LYRICAL,
    "rolling": Stores.ROS2_LYRICAL,  # the newest available
}

# rosbags drops defaults of definitions; of the standard types in use, only this one
# has any but zero.
STANDARD_DEFAULTS: dict[str, dict[str, Any]] = {"geometry_msgs/msg/Quaternion": {"w": 1.0}}

_ID = "unique_identifier_msgs/UUID goal_id\n"
ACTION_PARTS = (
    ("SendGoal_Request", _ID, ("Goal",)),
    ("SendGoal_Response", "bool accepted\nbuiltin_interfaces/Time stamp\n", ()),
    ("GetResult_Request", _ID, ()),
    ("GetResult_Response", "int8 status\n", ("Result",)),
    ("FeedbackMessage", _ID, ("Feedback",)),
)
"""Messages that every action has beside its own: their beginning, and which of its own they end with."""


class Rihs01:
    """Hashes of the types that `fields_of(name)` knows; it raises KeyError for others."""

    def __init__(self, fields_of: Callable[[str], Fields]) -> None:
        self._fields_of = fields_of
        self._described: dict[str, tuple[str, frozenset[str]]] = {}

    def message(self, name: str) -> str:
        """Return the hash of the message `name` (`std_msgs/msg/Bool`): `RIHS01_` and 64 digits."""
        return self._hash(*self._description(name))

    def service(self, name: str) -> str:
        """Return the hash of the service `name` (`std_srvs/srv/Empty`): of request, response and event."""
        request = (NAME, f"{name}_Request")
        response = (NAME, f"{name}_Response")
        event = f"{name}_Event"

        # The event is in no file: rosidl derives it from the service
        info = ("info", (NAME, EVENT_INFO))
        requests = ("request", (SEQUENCE, (request, 1)))
        responses = ("response", (SEQUENCE, (response, 1)))
        self._describe(event, [info, requests, responses])
        parts: Fields = [
            ("request_message", request),
            ("response_message", response),
            ("event_message", (NAME, event)),
        ]
        return self._hash(*self._describe(name, parts))

    def _hash(self, text: str, referenced: frozenset[str]) -> str:
        others = ", ".join(self._description(name)[0] for name in sorted(referenced))
        described = f'{{"type_description": {text}, "referenced_type_descriptions": [{others}]}}'
        return f"RIHS01_{sha256(described.encode()).hexdigest()}"

    def _description(self, name: str) -> tuple[str, frozenset[str]]:
        description = self._described.get(name)
        if description is None:
            description = self._describe(name, self._fields_of(name))
        return description

    def _describe(self, name: str, fields: Fields) -> tuple[str, frozenset[str]]:
        """Return the type's own JSON, and the names of all types below it."""
        described: list[dict[str, Any]] = []
        referenced: set[str] = set()
        for field, of in fields or EMPTY:
            kind = _kind(of)
            described.append({"name": field, "type": kind})
            nested = kind["nested_type_name"]
            if nested:
                _, below = self._description(nested)
                referenced |= {nested} | below
        text = json.dumps({"type_name": name, "fields": described})
        self._described[name] = text, frozenset(referenced)
        return self._described[name]


def _kind(of: Any) -> dict[str, Any]:
    shape, rest = of
    offset = 0
    capacity = 0
    string_capacity = 0
    nested = ""
    if shape in {ARRAY, SEQUENCE}:
        (shape, rest), capacity = rest
        offset = BOUNDED_SEQUENCE_IDS if capacity else SEQUENCE_IDS
        if of[0] == ARRAY:
            offset = ARRAY_IDS
    if shape == NAME:
        number = NAMED_ID
        nested = rest
    else:
        base, string_capacity = rest
        number = BOUNDED_IDS[base] if string_capacity else IDS[base]
    return {
        "type_id": offset + number,
        "capacity": capacity,
        "string_capacity": string_capacity,
        "nested_type_name": nested,
    }


def actions(distro: Distro) -> dict[str, str]:
    """Return name and text of the actions that nodes of `distro` have: goal, result and feedback."""
    result = _RESULTS.get(distro, f"{_CODE}string error_msg\n")
    feedback = _FEEDBACK
    if distro in {"lyrical", "rolling"}:
        feedback += _TRACKING
    return {NAVIGATE_TO_POSE: f"{_GOAL}---\n{result}---\n{feedback}"}


class Definitions:
    """Fields and defaults of every type of `distro` and of ours.

    Raises:
        ConfigError: If a file of `interfaces/` is not a definition.
    """

    def __init__(self, distro: Distro) -> None:
        self.store: Typestore = get_typestore(STORES[distro])
        self.services: set[str] = set()
        """Services, and those that actions consist of."""
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
        for name, text in actions(distro).items():
            parsed |= self._action(name, text)
        self.store.register(parsed)

    def _action(self, name: str, text: str) -> dict[str, Any]:
        """Return the messages of an action: its own three, and those of its topic and two services."""
        parsed: dict[str, Any] = {}
        for part, lines in zip(("Goal", "Result", "Feedback"), text.split("---\n"), strict=True):
            message = f"{name}_{part}"
            parsed[message], _ = _parsed(message, lines)
        for part, lines, own_parts in ACTION_PARTS:
            message = f"{name}_{part}"
            (constants, fields), _ = _parsed(message, lines)
            nested = [(own.lower(), (NAME, f"{name}_{own}")) for own in own_parts]
            parsed[message] = constants, [*fields, *nested]
        self.services |= {f"{name}_SendGoal", f"{name}_GetResult"}
        return parsed


def _texts() -> Iterator[tuple[str, str]]:
    yield from (STANDARD_SERVICES | ROS4HRI_MESSAGES | VISION_MESSAGES).items()
    for path in sorted(INTERFACES.glob("*/*/*")):
        if path.suffix in {".msg", ".srv"}:
            package, kind = path.parts[-3:-1]
            name = f"{package}/{kind}/{path.stem}"
            yield name, path.read_text(encoding="utf-8")


def _parts(name: str, text: str) -> list[tuple[str, str]]:
    """Return the messages of a definition: itself, or a service's request and response."""
    if "/srv/" not in name:
        return [(name, text)]
    request, _, response = text.partition("---\n")
    return [(f"{name}_Request", request), (f"{name}_Response", response)]


def _parsed(name: str, text: str) -> tuple[Any, dict[str, Any]]:
    """Return constants and fields as rosbags keeps them, and the defaults of fields."""
    package, _, short = name.split("/")
    try:
        # The parser would put a service's halves under `/srv/msg/`; it gets a message, and the name is kept.
        source = f"MSG: {package}/msg/{short}\n{text}"
        (message,) = MSGParser(source).specification()
    except TypesysError as error:
        problem = f"is not a definition of a ROS type ({error})"
        raise ConfigError(f"{name} in {INTERFACES}: {problem}") from error
    (definition,) = make_typesdict([message]).values()
    defaults = {field.name: field.value for field in message.fields if field.value is not None}
    return definition, defaults
