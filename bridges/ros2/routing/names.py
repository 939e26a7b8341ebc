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
    order: Literal["little", "big"] = "little" if cdr[1:2] == b"\1" else "big"
    texts = (f"{slash}{frame_name(name)}".encode() for slash in ("", "/"))
    return any((len(each) + 1).to_bytes(4, order) + each in cdr for each in texts)  # no longer name


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
            if len(self._of) >= MAX_FRAME_NAMES:
                self._taken.discard(self._of.pop(next(iter(self._of))))
            self._of[name] = made
            self._taken.add(made)
        return made

    def _free(self, wanted: str) -> str:
        if wanted[0].isdigit():
            wanted = f"_{wanted}"
        made = wanted
        count = 1
        while made in self._taken:
            count += 1
            made = f"{wanted}_{count}"
        return made


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
        found = template.replace(WORLD, self.world).replace(PERSON, "{user}/human_footprint")
        return found.replace("{user}", self._names.of(name)) if "{user}" in found else found
