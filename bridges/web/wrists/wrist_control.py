"""Control of each person's wrist by a page's mouse, a headset or a phone."""

import itertools
import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pointit.bridges.web.config import Place, WebConfig
from pointit.bridges.web.wire import AimAt, AssumedPlace, HeadsetMotion, Mover, PersonLine, Turn
from pointit.bridges.web.wrists.headset import HEADSET_TIMEOUT_S, HeadsetPose
from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Environment, Localization, UserPose, UserProfile, WristSample
from pointit.sim.aim import Stance, Tremor

Stand = tuple[Vec3, float]
"""Feet in {W}, m, and the azimuth of {H}'s x axis in {W}, rad."""
Hold = Literal["mouse", "phone", "headset"]

CLEAR_M = 2.0
"""Distance from the nearest object for a person placed automatically, m."""
_GRID = 41
"""Number of tried positions along each side of the room."""
_TOO_NEAR = 3.0
"""Weight: a metre too close to an object counts as this many metres away from the middle."""

FASTEST_RADPS = math.radians(720.0)
"""Maximum angular speed of the arm: a jump of the mouse is followed within a quarter of a second."""

REST_RAD = math.radians(-20.0)
"""Elevation of an arm before the first aim."""

STILL_S = 0.18
"""After this silence a phone counts as held still and its sample is repeated, at least five times a second,
s."""

SILENT_S = 1.0
"""After this silence, without any message, a phone has released the wrist, s."""

MAX_TREMOR_DEG = 5.0

MAX_SESSIONS = 16
"""Maximum number of distinct phone sessions per person; the oldest are forgotten."""


def places(room: Environment) -> NDArray[np.float64]:
    """Return points on all things of `room`, n x 3, {W}, m: vertices of lines, middles of solids."""
    points: list[Vec3] = []
    for line in (*room.strips, *room.belts):
        points.extend(_points_along(line.line_m))
    points.extend(lamp.position_m for lamp in room.lamps)
    for solid in (*room.boxes, *room.fixed_things, *room.cylinders, *room.spheres):
        points.append(solid.center_m)
    points.extend(plane.center_m for plane in room.planes if plane.size_m is not None)
    for cloud in room.clouds:
        points.append(cloud.low_m)
        points.append(cloud.high_m)
    return np.array(points, dtype=np.float64).reshape(-1, 3)


def middle(room: Environment) -> Vec3:
    """Return the middle of all things, {W}, m. In an empty room: 2 m ahead of the origin."""
    points = places(room)
    if not len(points):
        return (CLEAR_M, 0.0, 1.0)
    x, y, z = ((points.min(axis=0) + points.max(axis=0)) / 2.0).tolist()
    return (x, y, z)


def choose_pose(room: Environment) -> Stand:
    """Return a pose near the middle of `room`, `CLEAR_M` away from its objects, facing the middle.

    In a room too small for both, the position moves towards the middle, not through the walls.
    """
    points = places(room)[:, :2]
    if not len(points):
        return ((0.0, 0.0, 0.0), 0.0)

    # Positions to try: the middle, and a grid that reaches beyond the objects
    low = points.min(axis=0)
    high = points.max(axis=0)
    center = (low + high) / 2.0
    beyond_m = CLEAR_M + 0.5
    columns, rows = np.linspace(low - beyond_m, high + beyond_m, _GRID).T
    nodes = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    grid = np.vstack([center, nodes])

    # The cheapest: not too close to an object, and not far from the middle
    clear_m = np.full(len(grid), CLEAR_M)
    for point in points:
        distance_m = np.hypot(*(grid - point).T)
        np.minimum(clear_m, distance_m, out=clear_m)
    cost = np.hypot(*(grid - center).T) + _TOO_NEAR * (CLEAR_M - clear_m)
    x, y = grid[int(np.argmin(cost))].tolist()

    ahead_x, ahead_y = (center - (x, y)).tolist()
    yaw_rad = 0.0
    if math.hypot(ahead_x, ahead_y) > 0.1:
        yaw_rad = math.atan2(ahead_y, ahead_x)
    return ((x, y, 0.0), yaw_rad)


class AssumedPose:
    """One person's pose, from messages on the bus."""

    def __init__(self, place: Place | None = None) -> None:
        """Use `place` of the configuration while no pose is known."""
        self._place = None if place is None else (place.position_m, math.radians(place.yaw_deg))
        self._in_room: Stand = ((0.0, 0.0, 0.0), 0.0)
        self._pose: Stand | None = None
        self._truth: Stand | None = None
        """Pose when the localization began, or None outside a localization."""

    @property
    def at(self) -> Stand:
        """Return the person's true pose.

        During a localization that is the pose when it began, so that a localization by the mouse has a true
        value to find. Otherwise it is the newest pose.
        """
        return self._truth or self._newest

    @property
    def assumed(self) -> Stand | None:
        """Return the configured pose while no pose is known, else None."""
        return self._place if self._pose is None else None

    def room(self, stand: Stand) -> None:
        """Set the pose of a person without any other, see `choose_pose`."""
        self._in_room = stand

    def pose(self, pose: UserPose) -> None:
        """Update from a pose."""
        self._pose = (pose.position_m, pose.yaw_rad)

    def localization(self, progress: Localization) -> None:
        """Update from the progress of a localization."""
        if progress.phase != "sampling" or progress.purpose != "pose":
            self._truth = None
        elif self._truth is None:
            self._truth = self._newest

    @property
    def _newest(self) -> Stand:
        return self._pose or self._place or self._in_room


def _points_along(line: tuple[Vec3, ...]) -> list[Vec3]:
    """Return the vertices of `line` and, in long segments, points in between."""
    points = [line[0]]
    for a, b in itertools.pairwise(line):
        length_m = math.dist(a, b)
        parts = min(64, max(1, math.ceil(length_m / 0.5)))
        for k in range(1, parts + 1):
            s = k / parts
            x = a[0] + s * (b[0] - a[0])
            y = a[1] + s * (b[1] - a[1])
            z = a[2] + s * (b[2] - a[2])
            points.append((x, y, z))
    return points


class MouseArm:
    """One person's arm in {H}, which follows a mouse's point in {W}.

    It is the inverse of the pointing service's model. Corrections by that service and the localizer, the
    person's offset and the pose's elevation bias, are not inverted: the user of the mouse sees the cursor and
    corrects it.
    """

    def __init__(self, *, seed: int = 0) -> None:
        """Begin hanging down in front of the body; `seed` is of the tremor."""
        self._profile = UserProfile(stamp_ns=0)
        self._position_m: Vec3 = (0.0, 0.0, 0.0)
        self._yaw_rad = 0.0
        self._tremor = Tremor(0.0, np.random.default_rng(seed))
        self._at_m: Vec3 | None = None
        self._target = rotation.from_azimuth_elevation(0.0, REST_RAD)
        self._orientation = self._target
        self._step_ns: int | None = None

    def set_profile(self, profile: UserProfile) -> None:
        """Set the person's body measures, hand and ray model."""
        self._profile = profile
        self._update_target()

    def set_pose(self, position_m: Vec3, yaw_rad: float) -> None:
        """Set the person's pose: {H} in {W}, m and rad."""
        if (position_m, yaw_rad) != (self._position_m, self._yaw_rad):
            self._position_m = position_m
            self._yaw_rad = yaw_rad
            self._update_target()

    @property
    def eyes_height_m(self) -> float:
        """Return the height of the eyes above the feet, m."""
        return self._profile.body.footprint_to_neck_m + self._profile.body.neck_to_eyes_m

    def aim(self, at_m: Vec3) -> None:
        """Point at `at_m`, {W}, from now on."""
        self._at_m = at_m
        self._update_target()

    def set_tremor(self, rms_rad: float) -> None:
        """Set the tremor about both axes, rad rms each; 0 turns it off."""
        self._tremor.rms_rad = rms_rad

    def azimuth(self, at_m: Vec3) -> float:
        """Return the arm's azimuth in {H}, rad, that points at `at_m`."""
        azimuth, _ = self._stance().aim_at(at_m)
        return azimuth - self._yaw_rad

    def step(self, now_ns: int) -> Quaternion:
        """Return the arm's orientation in {H} at `now_ns`; its x axis points along the arm to the finger."""
        passed_s = 0.0
        if self._step_ns is None:
            self._orientation = self._target  # the first sample may jump
        else:
            passed_s = max(0, now_ns - self._step_ns) / NS_PER_S
            self._orientation = _turned_towards(self._orientation, self._target, FASTEST_RADPS * passed_s)
        self._step_ns = now_ns
        left_rad, up_rad = self._tremor.step(passed_s)
        if left_rad == up_rad == 0.0:
            return self._orientation
        tremor = rotation.from_azimuth_elevation(left_rad, up_rad)
        return rotation.normalized(rotation.multiply(self._orientation, tremor))

    def _stance(self) -> Stance:
        profile = self._profile
        return Stance(profile.body, profile.hand, self._position_m, ray_model=profile.ray_model)

    def _update_target(self) -> None:
        if self._at_m is not None:
            azimuth, elevation = self._stance().aim_at(self._at_m)
            self._target = rotation.from_azimuth_elevation(azimuth - self._yaw_rad, elevation)


def _turned_towards(start: Quaternion, end: Quaternion, most_rad: float) -> Quaternion:
    """Return `start` turned towards `end`, by `most_rad` at most."""
    x, y, z, w = rotation.multiply(rotation.inverse(start), end)
    if w < 0.0:  # the shorter way round
        x = -x
        y = -y
        z = -z
        w = -w
    sine = math.hypot(x, y, z)
    if 2.0 * math.atan2(sine, w) <= most_rad:
        return end
    part = rotation.from_axis_angle((x / sine, y / sine, z / sine), most_rad)
    return rotation.normalized(rotation.multiply(start, part))


@dataclass(slots=True)
class _Phone:
    heard_ns: int
    turn: Turn
    session: int


@dataclass(slots=True)
class _Person:
    assumed_pose: AssumedPose
    arm: MouseArm
    page: str = ""
    """Page that holds the wrist, or `""`."""
    by: Hold = "mouse"
    sent_ns: int = 0
    seq: int = 0
    phones: dict[str, _Phone] = field(default_factory=dict[str, _Phone])
    """By page id."""
    lost: set[str] = field(default_factory=set[str])
    """Phones that have lost the wrist to another page; they must request it again."""
    headset: HeadsetPose = field(default_factory=HeadsetPose)
    """Pose by a headset."""
    sessions: dict[tuple[str, int], int] = field(default_factory=dict[tuple[str, int], int])
    """Own session ids by page and the phone's session: time of the first sample, so that none repeats."""


class WristControl:
    """Control of wrists: holder and motion of each person's wrist.

    One page holds a wrist at a time, the last one that took it. All times are the site's, ns.
    """

    def __init__(self, config: WebConfig) -> None:
        self._config = config
        self._people: dict[str, _Person] = {}
        self._stand = choose_pose(Environment(stamp_ns=0, name=""))
        self._middle = middle(Environment(stamp_ns=0, name=""))

    # Input from the bus.

    def profile(self, user: str, profile: UserProfile) -> None:
        """Set a person's profile."""
        self._person(user).arm.set_profile(profile)

    def pose(self, user: str, pose: UserPose) -> None:
        """Set a person's pose."""
        person = self._person(user)
        person.assumed_pose.pose(pose)
        person.arm.set_pose(*person.assumed_pose.at)

    def localization(self, user: str, progress: Localization) -> None:
        """Update a person's localization."""
        person = self._person(user)
        person.assumed_pose.localization(progress)
        person.arm.set_pose(*person.assumed_pose.at)

    def room(self, room: Environment) -> None:
        """Set the map."""
        self._stand = choose_pose(room)
        self._middle = middle(room)
        for person in self._people.values():
            person.assumed_pose.room(self._stand)
            person.arm.set_pose(*person.assumed_pose.at)

    # Holders.

    def acquire(self, user: str, page: str, by: Hold) -> str:
        """Give the wrist of `user` to `page`, and return the page that has lost it, or `""`."""
        person = self._person(user)
        loser = "" if person.page == page else person.page
        if loser and person.by == "phone":
            person.lost.add(loser)
        person.lost.discard(page)
        person.page = page
        person.by = by
        person.sent_ns = 0
        if by == "headset":
            person.headset = HeadsetPose(yaw_rad=person.assumed_pose.at[1])
            person.arm.set_tremor(0.0)
        return loser

    def release_from(self, user: str, page: str) -> bool:
        """Release the wrist of `user` from `page`. Return False if it was not the holder."""
        person = self._people.get(user)
        if person is None or person.page != page:
            return False
        if person.by == "phone":
            person.lost.add(page)  # its further samples are no request for the wrist
        self._release(person)
        return True

    def release(self, user: str) -> str:
        """Release the wrist of `user`, and return the page that held it, or `""`."""
        page, _ = self.holder(user)
        if page:
            self.release_from(user, page)
        return page

    def close(self, page: str) -> list[str]:
        """Release the wrists of `page`, which is gone for now or for ever, and return their users."""
        users = [user for user, person in self._people.items() if person.page == page]
        for user in users:
            self._release(self._people[user])
        return users

    def forget(self, user: str) -> None:
        """Forget a person who has left."""
        self._people.pop(user, None)

    def holder(self, user: str) -> tuple[str, Mover]:
        """Return the page that holds the wrist of `user` and what moves it, or `("", "own")`."""
        person = self._people.get(user)
        if person is None or not person.page:
            return ("", "own")
        return (person.page, person.by)

    def users_of(self, page: str) -> frozenset[str]:
        """Return the people whose wrists `page` holds."""
        return frozenset(user for user, person in self._people.items() if person.page == page)

    # Motion.

    def aim(self, page: str, aim: AimAt) -> bool:
        """Aim the mouse of `page`. Return False if it does not hold the wrist."""
        person = self._people.get(aim.user)
        if person is None or person.page != page or person.by != "mouse":
            return False
        person.arm.aim(aim.at_m)
        return True

    def set_tremor(self, user: str, page: str, rms_deg: float) -> bool:
        """Set the tremor of the arm that `page` moves. Return False if it does not hold the wrist."""
        if self.holder(user) != (page, "mouse"):
            return False
        limited_deg = min(max(rms_deg, 0.0), MAX_TREMOR_DEG)
        self._person(user).arm.set_tremor(math.radians(limited_deg))
        return True

    def turn(self, user: str, page: str, turn: Turn, now_ns: int) -> WristSample | None:
        """Process a phone's orientation, and return the sample to publish if it has the wrist, else None.

        A phone takes the wrist by its first message, unless it has lost it to another page.
        """
        person = self._person(user)
        session = person.sessions.setdefault((page, turn.session), now_ns)
        while len(person.sessions) > MAX_SESSIONS:
            del person.sessions[next(iter(person.sessions))]
        person.phones[page] = _Phone(now_ns, turn, session)
        if not person.page and page not in person.lost:
            person.page = page
            person.by = "phone"
        if person.page != page:
            return None
        return self._sample(person, now_ns)

    def move_by_headset(
        self, page: str, motion: HeadsetMotion, now_ns: int
    ) -> tuple[UserPose | None, WristSample] | None:
        """Process a headset's head and hand, and return what to publish if `page` has the wrist, else None.

        The pose is None if that before is good enough.

        Raises:
            RefusedError: If the headset is not aligned, or is too far from the map.
        """
        person = self._people.get(motion.user)
        if person is None or (person.page, person.by) != (page, "headset"):
            return None
        pose = person.headset.update(motion, person.arm.eyes_height_m, now_ns)
        person.arm.set_pose(person.headset.feet_m, person.headset.yaw_rad)
        person.arm.aim(person.headset.target_m)
        return pose, self._sample(person, now_ns)

    def step(self, now_ns: int, speed: float = 1.0) -> list[tuple[str, WristSample]]:
        """Return the samples that are due, of arms moved by mice and of phones and headsets held still.

        Silent ones release the wrist. `speed`: of the site's time relative to the wall's, by which people
        live.
        """
        due: list[tuple[str, WristSample]] = []
        for user, person in self._people.items():
            if not person.page:
                continue
            if person.by == "mouse":
                due.append((user, self._sample(person, now_ns)))
                continue

            # Silence since the last message of a headset or phone
            is_headset = person.by == "headset"
            timeout_s = SILENT_S
            heard_ns: float = -math.inf  # simulated time may begin at 0
            if is_headset:
                timeout_s = HEADSET_TIMEOUT_S
                heard_ns = person.headset.last_received_ns(now_ns)
            elif person.page in person.phones:
                heard_ns = person.phones[person.page].heard_ns
            silence_s = (now_ns - heard_ns) / (speed * NS_PER_S)
            if silence_s > timeout_s:
                self._release(person)
                continue

            # Its last sample again, but none of a headset before its first message
            has_sent = person.sent_ns or not is_headset
            if has_sent and now_ns - person.sent_ns >= STILL_S * NS_PER_S:
                if is_headset and silence_s > SILENT_S:
                    person.arm.aim(person.headset.feet_m)
                due.append((user, self._sample(person, now_ns)))
        return due

    def ahead(self, user: str) -> float:
        """Return the arm's azimuth in {H}, rad, that points at the middle of the map."""
        return self._person(user).arm.azimuth(self._middle)

    def line(self, user: str, now_ns: int, *, paired: str = "") -> PersonLine:
        """Return the status of `user` for pages that do not move them; `paired`: page id of the phone."""
        holder, mover = self.holder(user)
        person = self._person(user)
        phone = person.phones.get(paired) if paired else None

        # A phone may be connected without being the holder: another page may have taken the wrist
        if not paired:
            phone_state = ""
        elif phone is None:
            phone_state = "waiting for the phone"
        elif now_ns - phone.heard_ns > SILENT_S * NS_PER_S:
            phone_state = "paired, but silent"
        elif holder == paired:
            phone_state = "moves the arm"
        else:
            phone_state = "connected, does not move the arm"

        assumed = None
        if person.assumed_pose.assumed is not None:
            position_m, yaw_rad = person.assumed_pose.assumed
            assumed = AssumedPlace(position_m=position_m, yaw_rad=yaw_rad)
        return PersonLine(
            user=user,
            moved_by=mover,
            assumed=assumed,
            phone=phone_state,
            battery=None if phone is None else phone.turn.battery,
        )

    def _person(self, user: str) -> _Person:
        person = self._people.get(user)
        if person is None:
            assumed_pose = AssumedPose(self._config.places.get(user))
            assumed_pose.room(self._stand)
            person = _Person(assumed_pose, MouseArm(seed=len(self._people)))
            person.arm.set_pose(*assumed_pose.at)
            self._people[user] = person
        return person

    def _sample(self, person: _Person, now_ns: int) -> WristSample:
        person.sent_ns = now_ns
        person.seq += 1
        if person.by != "phone":
            source = "headset" if person.by == "headset" else ""
            arm_xyzw = person.arm.step(now_ns)
            return WristSample(stamp_ns=now_ns, seq=person.seq, orientation_xyzw=arm_xyzw, source=source)
        phone = person.phones[person.page]
        return WristSample(
            stamp_ns=now_ns,
            seq=person.seq,
            orientation_xyzw=phone.turn.q,
            device="phone",
            session=phone.session,
            device_time_ns=round(phone.turn.t_ms * 1e6),
            battery=phone.turn.battery,
        )

    def _release(self, person: _Person) -> None:
        person.page = ""
