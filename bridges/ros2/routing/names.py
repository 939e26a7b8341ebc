"""Names of frames and people in ROS, and back.

{W} is `world`, {H} of a person is `{user}/human_footprint`: at their feet, z up, x forward at IMU yaw 0.
"""

import re
from typing import Literal

WORLD = "{world}"
"""Stands for the frame {W} in a route."""
PERSON = "{person}"
"""Stands for a person's frame {H} in a route."""

MAX_FRAME_NAMES = 10_000
"""Maximum number of distinct names: people and robots come and go for years."""

FIXED_FRAMES = frozenset({"earth", "map", "odom", "world"})
"""Frames of REP 105 that no robot carries along, also in a namespace, as in agv1/odom."""

_NOT_ROS = re.compile(r"[^A-Za-z0-9_]")


def frame_name(name: str) -> str:
    """Return the name of a frame as tf2 has it: without the slash that old drivers begin it with."""
    return name.lstrip("/")


def is_fixed(name: str) -> bool:
    """Return True if REP 105 defines the frame as fixed to the ground."""
    return name.rpartition("/")[2] in FIXED_FRAMES


def holds_frame(cdr: bytes, name: str) -> bool:
    """Return True if the CDR of a message has the frame `name`, with or without a slash.

    Decoding takes 200 times as long.
    """
    order: Literal["little", "big"] = "big"
    if cdr[1:2] == b"\1":
        order = "little"

    # With the length and the terminating 0 before and after it, so that no longer name has it in it
    text = frame_name(name).encode()
    for frame in (text, b"/" + text):
        length = len(frame) + 1
        if length.to_bytes(4, order) + frame in cdr:
            return True
    return False


class RosNames:
    """Names of people and lamps as parts of ROS names, without `-` and `.`, not beginning with a digit."""

    def __init__(self) -> None:
        self._of: dict[str, str] = {}
        self._taken: set[str] = set()

    def of(self, name: str) -> str:
        """Return the ROS name of `name`: unchanged where possible, always the same, unique."""
        ros_name = self._of.get(name)
        if ros_name is None:
            ros_name = self._free(_NOT_ROS.sub("_", name) or "_")
            if len(self._of) >= MAX_FRAME_NAMES:
                oldest = next(iter(self._of))
                self._taken.discard(self._of.pop(oldest))
            self._of[name] = ros_name
            self._taken.add(ros_name)
        return ros_name

    def _free(self, base: str) -> str:
        """Return `base`, with a number if it is taken."""
        if base[0].isdigit():
            base = f"_{base}"
        ros_name = base
        count = 1
        while ros_name in self._taken:
            count += 1
            ros_name = f"{base}_{count}"
        return ros_name


class Frames:
    """Names of frames."""

    def __init__(self, names: RosNames, world: str = "world") -> None:
        """Set the name of {W}."""
        self.world = world
        self._names = names

    def person(self, user: str) -> str:
        """Return the frame {H} of `user`."""
        return self.resolve(PERSON, user)

    def resolve(self, template: str, name: str) -> str:
        """Return the frame that `template` of a route means for the person `name`."""
        frame = template.replace(WORLD, self.world).replace(PERSON, "{user}/human_footprint")
        if "{user}" not in frame:
            return frame
        return frame.replace("{user}", self._names.of(name))
