"""Names of frames and people in ROS: REP-103 axes, the ROS toolkit's names by default.

{W} is `world`, {H} of a person is `{user}/human_footprint`: at their feet, z up, x forward at IMU yaw 0.
"""

import re

from pointit.bridges.ros2.message_format import holds_text

WORLD = "{world}"
"""Stands for the frame {W} in a route."""
PERSON = "{person}"
"""Stands for a person's frame {H} in a route."""

MAX_NAMES = 10_000
"""Maximum number of distinct names."""

FIXED_FRAMES = frozenset({"earth", "map", "odom", "world"})
"""Frames of REP 105 that no robot carries along, also in a namespace, as in agv1/odom."""

_NOT_ROS = re.compile(r"[^A-Za-z0-9_]")


def frame_name(name: str) -> str:
    """Return the name of a frame as tf2 has it: without the slash that old drivers begin it with."""
    return name.lstrip("/")


def is_fixed(name: str) -> bool:
    """Return True if a frame is fixed to the ground by its name."""
    return name.rpartition("/")[2] in FIXED_FRAMES


def holds_frame(cdr: bytes, name: str) -> bool:
    """Return True if the CDR of a message has the frame `name`, with or without a slash."""
    name = frame_name(name)
    return holds_text(cdr, name) or holds_text(cdr, f"/{name}")


class RosNames:
    """Names of people and lamps as parts of ROS names, without `-` and `.`, not beginning with a digit."""

    def __init__(self) -> None:
        self._of: dict[str, str] = {}
        self._taken: set[str] = set()

    def of(self, name: str) -> str:
        """Return the ROS name of `name`: unchanged where possible, always the same, unique."""
        made = self._of.get(name)
        if made is None:
            made = self._free(_NOT_ROS.sub("_", name) or "_")
            if len(self._of) >= MAX_NAMES:
                oldest = next(iter(self._of))
                self._taken.discard(self._of.pop(oldest))
            self._of[name] = made
            self._taken.add(made)
        return made

    def _free(self, wanted: str) -> str:
        if wanted[0].isdigit():
            wanted = f"_{wanted}"
        made, count = wanted, 1
        while made in self._taken:
            count += 1
            made = f"{wanted}_{count}"
        return made


class Frames:
    """Names of frames."""

    def __init__(
        self, names: RosNames, *, world: str = "world", person: str = "{user}/human_footprint"
    ) -> None:
        """Set the name of {W}, and that of {H} with `{user}` for the person."""
        self.world = world
        self._person = person
        self._names = names
        self._resolved: dict[tuple[str, str], str] = {}

    def person(self, user: str) -> str:
        """Return the frame {H} of `user`."""
        return self.resolve(PERSON, user)

    def resolve(self, template: str, name: str) -> str:
        """Return the frame that `template` of a route means for the person `name`."""
        found = self._resolved.get((template, name))
        if found is None:
            found = template.replace(WORLD, self.world).replace(PERSON, self._person)
            if "{user}" in found:
                found = found.replace("{user}", self._names.of(name))
            if len(self._resolved) >= MAX_NAMES:
                self._resolved.clear()
            self._resolved[template, name] = found
        return found
