"""One person's cursor: their pose, whether they point, where their ray meets the room (paper, §II-D)."""

import math

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Cursor, Interaction, PointingRay, UserPose
from pointit.services.pui.surfaces import Surfaces

STEEPEST_RAD = math.pi / 2.0

MOST_BIAS_RAD = math.radians(45.0)
"""Nobody points higher or lower than that all the time: a pose that says so is believed so far."""

RIVAL_NS = 2 * NS_PER_S
"""Of two who tell a pose, the one with the older stamp is left out while the other was heard so lately."""


class PersonCursor:
    """Turns one person's rays in {H} into cursors in {W}.

    There is a cursor for every ray while the person is pointing, `none` where it passes everything by.
    Without a supervisor, whose interactions say so, they are taken to be pointing all the time.
    """

    def __init__(self, surfaces: Surfaces) -> None:
        self._surfaces = surfaces
        self._interaction: Interaction | None = None
        self._pose: UserPose | None = None
        self._pose_came_ns = 0
        self._newest_ns = 0
        self._shown = False
        self._seq = 0

    @property
    def lacks_pose(self) -> bool:
        """Return whether rays come to nothing because nobody has said where the person stands."""
        return self._pose is None and self._pointing

    @property
    def _pointing(self) -> bool:
        return self._interaction is None or self._interaction.state == "pointing"

    def set_pose(self, pose: UserPose, now_ns: int | None = None) -> None:
        """Take where the person stands now.

        A localizer and a tracker may both tell it for a moment: then the newer one counts.

        Args:
            pose: from either.
            now_ns: the time; none: there is only one who tells it.
        """
        known = self._pose
        if now_ns is not None:
            is_rival = 0 <= now_ns - self._pose_came_ns <= RIVAL_NS
            if known is not None and is_rival and pose.stamp_ns < known.stamp_ns:
                return
            self._pose_came_ns = now_ns
        self._pose = pose

    def set_interaction(self, interaction: Interaction) -> Cursor | None:
        """Take what the person is about; return the cursor that ends the pointing, once, if this ends it."""
        self._interaction = interaction
        return None if self._pointing else self.end(interaction.stamp_ns)

    def end(self, stamp_ns: int) -> Cursor | None:
        """Return the empty cursor that takes back the one shown, or none if there is none to take back."""
        if not self._shown:
            return None
        self._shown = False
        return self._cursor(max(stamp_ns, self._newest_ns))

    def cursor(self, ray: PointingRay) -> Cursor | None:
        """Return the cursor of `ray` with its stamp, or none while there is nothing to say."""
        pose = self._pose
        if pose is None or not self._pointing:
            return None
        self._newest_ns = ray.stamp_ns
        self._shown = True
        met = self._surfaces.meet(
            vector.add(pose.position_m, vector.turn(ray.origin_m, pose.yaw_rad)),
            vector.turn(_lowered(ray.direction, pose.elevation_bias_rad), pose.yaw_rad),
        )
        if met is None:
            return self._cursor(ray.stamp_ns)
        surface, hit = met
        self._seq += 1
        return Cursor(
            stamp_ns=ray.stamp_ns,
            seq=self._seq,
            surface=surface.kind,
            surface_id=surface.id,
            point_m=hit.point_m,
            position_m=hit.position_m,
            miss_m=hit.miss_m,
            miss_rad=hit.miss_rad,
            range_m=hit.range_m,
        )

    def _cursor(self, stamp_ns: int) -> Cursor:
        self._seq += 1
        return Cursor(stamp_ns=stamp_ns, seq=self._seq)


def _lowered(direction: Vec3, bias_rad: float) -> Vec3:
    """Return `direction` with its elevation less by `bias_rad`, at most straight up or down."""
    if bias_rad == 0.0:
        return direction
    bias_rad = max(-MOST_BIAS_RAD, min(MOST_BIAS_RAD, bias_rad))
    elevation_rad = vector.elevation(direction) - bias_rad
    return vector.direction(vector.azimuth(direction), max(-STEEPEST_RAD, min(STEEPEST_RAD, elevation_rad)))
