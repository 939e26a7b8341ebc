"""Boxes, links and hand as tracked objects, which the page draws and people point at."""

from collections.abc import Iterator, Mapping
from itertools import pairwise

from pointit.plugins import TrackedObject, vector

from .simulated_arm import Vec3, joint_angles, link_ends

COLORS = ("red", "green", "blue", "yellow", "orange", "purple")
BEADS = 7
"""Number of beads along a link."""
BEAD_M = (0.06, 0.06, 0.06)


def shown_boxes(tops_m: Mapping[str, Vec3], size_m: float) -> Iterator[TrackedObject]:
    """Yield the boxes. `tops_m`: middle of the upper side of each, {W}, m; `size_m`: their edge."""
    for number, (name, top_m) in enumerate(tops_m.items()):
        middle_m = vector.subtract(top_m, (0.0, 0.0, size_m / 2.0))
        yield TrackedObject(
            id=name,
            kind=COLORS[number % len(COLORS)],
            position_m=middle_m,
            length_m=size_m,
            size_m=(size_m,) * 3,
            press=True,
        )


def shown_links(base_m: Vec3, tip_m: Vec3) -> Iterator[TrackedObject]:
    """Yield beads along the links of an arm, as the page draws boxes only, and its hand."""
    angles = joint_angles(base_m, tip_m)
    ends = [base_m]
    if angles is not None:
        ends += link_ends(base_m, angles)
    for link, (start_m, end_m) in enumerate(pairwise(ends)):
        along_m = vector.subtract(end_m, start_m)
        for bead in range(BEADS):
            position_m = vector.add(start_m, vector.scale(along_m, bead / BEADS))
            yield TrackedObject(id=f"arm.{link}.{bead}", kind="arm", position_m=position_m, size_m=BEAD_M)
    yield TrackedObject(id="hand", kind="arm", position_m=tip_m, length_m=0.05)
