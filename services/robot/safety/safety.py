"""Permitted targets, set-points and speeds of a robot, and the reasons to stop. No safety function."""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import get_args

from pointit.geometry.vector import Vec3, add, azimuth, direction, dot, norm, scale, subtract, wrap
from pointit.schemas import NS_PER_S, Environment, RobotState
from pointit.schemas.text import round_beyond
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.robot_driver import RobotReport
from pointit.services.robot.safety.people import FORGOTTEN_S, PeopleNearRobot
from pointit.services.robot.safety.region import (
    MARGIN_M,
    CylinderObstacle,
    KeepIn,
    KeepOut,
    Obstacle,
    ObstacleKind,
    Region,
)
from pointit.services.robot.stop_reason import PermittedSetPoint, StopReason

JUMP_M = 0.5
"""Distance by which a report may exceed the speed limit's distance, in addition to 2 sigma, m."""
SPEED_RATIO = 1.5
"""Speed that a robot may have, as a multiple of its limit: others push it, and its clock is not ours."""
SETTLED_S = 1.0
"""Time without another jump after which a robot's reports are trusted again."""
AHEAD_S = 1.0
"""Time by which a report may be ahead of this machine's clock."""
MOVING_MPS = 0.1
"""Speed above which a robot moves."""
BASE_S = 0.25
"""Least time between two places whose difference is a velocity."""
TURN_S = 0.1
"""Least time between two directions whose difference is a turn rate."""

NEAR_M = 1.0
"""Distance beyond a person's own space in which `max_approach_mps` is the limit."""
SPARE_S = 0.1
"""Time by which a robot brakes earlier than it must."""
SPARE = 0.8
"""Share of the acceleration that is planned with."""
LEAD_S = 0.5
"""Time by which a set-point is farther away than the way to stop, so that a robot need not brake for it."""
MIN_MPS = 0.02
"""Speed at which a robot may always go to a permitted place."""
TURN_STEP_RAD = math.radians(30.0)
"""Angle between two directions in which a robot that turns is checked."""

TOO_FAST_MPS = 0.2
"""Excess over the limit near people at which a robot is stopped: it is still slowing down below that."""
LEAVING = 0.5
"""Least gain of clearance, by the rise or fall, of a robot that rises or comes down in a person's space."""
NO_MAP = "the map of the room has not come yet, with its fences: see that `pui` runs"


class Reports:
    """Newest usable report, and the problem of later ones."""

    def __init__(self, config: RobotConfig, robot: str) -> None:
        self._config = config
        self._robot = robot
        self._problem = f"{robot} has not reported its place yet: see that it is switched on and connected"
        self._jump = ""
        self._jumped_ns = 0
        self._came_ns = 0
        """Time of the newest report by the slower of the two clocks."""
        self._base: RobotReport | None = None
        self._turn_base: RobotReport | None = None
        self._driven_mps: Vec3 = (0.0, 0.0, 0.0)
        """Velocity from the places of two reports."""
        self.turn_radps = 0.0
        """Turn rate from the directions of two reports."""
        self.newest: RobotReport | None = None

    @property
    def velocity_mps(self) -> Vec3:
        """Return the robot's velocity; from its places if it reports none."""
        reported = (0.0, 0.0, 0.0)
        if self.newest is not None:
            reported = self.newest.velocity_mps
        return reported if norm(reported) >= MOVING_MPS else self._driven_mps

    def on_report(self, report: RobotReport, now_ns: int) -> str:
        """Check `report`, of finite numbers in {W}. Return why it is not used, or `""`."""
        ahead_s = (report.stamp_ns - now_ns) / NS_PER_S
        if ahead_s > AHEAD_S:
            self._problem = (
                f"{self._robot} is {ahead_s:.1f} s ahead of this machine: synchronize the two clocks"
            )
            return self._problem
        last = self.newest
        if last is not None and report.stamp_ns < last.stamp_ns:
            return f"{self._robot} reports late: a newer report was here before"
        if last is not None:
            self._find_jump(last, report, now_ns)

        # It is used even after a jump, which stops the robot for a while
        self.newest = report
        self._came_ns = min(report.stamp_ns, now_ns)
        self._update_velocity(report)
        self._update_turn_rate(report)
        self._problem = ""
        return ""

    def on_link_lost(self, reason: str) -> None:
        """Discard the reports. None is usable until the next one."""
        self._problem = reason

    def stop_reason(self, now_ns: int) -> StopReason | None:
        """Return the reason to stop a robot with these reports, or None."""
        if self._problem or self.newest is None:
            return StopReason("report", self._problem, is_freeing=True)
        age_s = (now_ns - self._came_ns) / NS_PER_S
        if age_s > self._config.report_timeout_s:
            text = f"{self._robot} has not reported its place for {age_s:.1f} s: look at its link and battery"
            return StopReason("report", text, is_freeing=True)
        if self.newest.has_other_master:
            text = (
                f"another master control steers {self._robot}: it is left alone until its order has ended; "
                "stop it there, or at the vehicle"
            )
            return StopReason("other_master", text, is_freeing=True)
        if self._jump and now_ns - self._jumped_ns < SETTLED_S * NS_PER_S:
            return StopReason("jump", self._jump, is_freeing=True)
        return None

    def _update_turn_rate(self, report: RobotReport) -> None:
        base = self._turn_base or report
        passed_s = (report.stamp_ns - base.stamp_ns) / NS_PER_S
        if passed_s >= TURN_S or self._turn_base is None:
            self._turn_base = report
            turned_rad = wrap(report.yaw_rad - base.yaw_rad)
            self.turn_radps = turned_rad / max(passed_s, TURN_S)

    def _update_velocity(self, report: RobotReport) -> None:
        base = self._base or report
        passed_s = (report.stamp_ns - base.stamp_ns) / NS_PER_S
        if passed_s < BASE_S and self._base is not None:
            return
        self._base = report
        way = subtract(report.position_m, base.position_m)
        self._driven_mps = scale(way, 1.0 / max(passed_s, BASE_S))

    def _find_jump(self, last: RobotReport, report: RobotReport, now_ns: int) -> None:
        passed_s = (report.stamp_ns - last.stamp_ns) / NS_PER_S
        sigma_m = math.hypot(last.position_sigma_m or 0.0, report.position_sigma_m or 0.0)
        drivable_m = SPEED_RATIO * self._config.max_speed_mps * passed_s
        limit_m = drivable_m + JUMP_M + 2.0 * sigma_m
        moved_m = math.dist(last.position_m, report.position_m)
        if moved_m > limit_m:
            self._jumped_ns = now_ns
            self._jump = (
                f"{self._robot}'s place jumped by {moved_m:.1f} m: check its localization and that no other "
                "robot has its name, then take it again"
            )


def stopping_m(config: RobotConfig, speed_mps: float) -> float:
    """Return the way to a standstill from `speed_mps`."""
    reaction_m = speed_mps * config.reaction_s
    return reaction_m + speed_mps**2 / (2.0 * config.max_acceleration_mps2)


def lead_m(config: RobotConfig, speed_mps: float) -> float:
    """Return the distance of a set-point ahead, which keeps a robot without a limit hardly faster."""
    return stopping_m(config, speed_mps) + speed_mps * LEAD_S


def speed_limit_mps(config: RobotConfig, region: Region, place_m: Vec3, step: Vec3, yaw_rad: float) -> float:
    """Return the greatest speed at `place_m` in the direction of `step`, to which its front turns."""
    limit = config.max_speed_mps
    length = norm(step)
    if length == 0.0:
        return limit

    # Before everything ahead it must be able to stop, also while a ground robot still turns
    ahead = scale(step, 1.0 / length)
    horizon_m = stopping_m(config, limit) + limit * SPARE_S + limit**2 / config.max_acceleration_mps2
    courses = [(ahead, 0.0)]
    for turning in _turn(config, ahead, yaw_rad):
        courses.append((turning, MARGIN_M / 2.0))
    for course, margin_m in courses:
        end_m = add(place_m, scale(course, horizon_m))
        way = region.way(place_m, end_m, margin_m)
        if way.blocker is not None:
            limit = min(limit, _speed_before(config, way.share * horizon_m, 0.0))

    # Towards people it has the approach limit when it gets near them
    for obstacle in region.obstacles:
        if obstacle.kind != "people":
            continue
        gap_m = region.clearance_m(obstacle, place_m) - NEAR_M
        closing = -dot(ahead, region.away(obstacle, place_m))
        if gap_m <= 0.0:
            limit = min(limit, config.max_approach_mps)
        elif closing > 0.0:
            approach_mps = _speed_before(config, gap_m, config.max_approach_mps)
            approach_mps = max(approach_mps, config.max_approach_mps)
            limit = min(limit, approach_mps / closing)
    return max(limit, MIN_MPS)


def path_limit_mps(config: RobotConfig, region: Region, points_m: Sequence[Vec3]) -> float:
    """Return the greatest speed along all of a path."""
    people = [obstacle for obstacle in region.obstacles if obstacle.kind == "people"]
    near_people = Region(people, region.apart_m)
    for start_m, end_m in pairwise(points_m):
        if near_people.way(start_m, end_m, NEAR_M).blocker or near_people.blocker(start_m, NEAR_M):
            return min(config.max_speed_mps, config.max_approach_mps)
    return config.max_speed_mps


def _turn(config: RobotConfig, ahead: Vec3, yaw_rad: float) -> Iterator[Vec3]:
    """Yield the directions in which a ground robot drives before it has turned from `yaw_rad` to `ahead`."""
    if config.kind != "ground":
        return
    remaining_rad = wrap(azimuth(ahead) - yaw_rad)
    count = math.ceil(abs(remaining_rad) / TURN_STEP_RAD)
    for index in range(count):
        yield direction(yaw_rad + remaining_rad * index / count, 0.0)


def predicted_places_m(
    config: RobotConfig, place_m: Vec3, velocity_mps: Vec3, turn_radps: float
) -> tuple[Vec3, ...]:
    """Return where a robot would come to rest if it were stopped now, or after a ground robot's turn.

    It does not sink below the floor.
    """
    speed_mps = norm(velocity_mps)
    turned_rad = azimuth(velocity_mps) + turn_radps * (config.reaction_s + TURN_S)
    turned_mps = scale(direction(turned_rad, 0.0), speed_mps)
    courses_mps = [velocity_mps]
    if config.kind == "ground":
        courses_mps.append(turned_mps)
    return tuple(_rest_m(config, place_m, course_mps, speed_mps) for course_mps in courses_mps)


def _rest_m(config: RobotConfig, place_m: Vec3, velocity_mps: Vec3, speed_mps: float) -> Vec3:
    stopping_s = stopping_m(config, speed_mps) / speed_mps
    x, y, z = add(place_m, scale(velocity_mps, stopping_s))
    floor_m = min(place_m[2], 0.0)
    return (x, y, max(z, floor_m))


def _speed_before(config: RobotConfig, way_m: float, end_mps: float) -> float:
    """Return the speed from which `end_mps` is reached within `way_m`."""
    a = SPARE * config.max_acceleration_mps2
    reaction = a * (config.reaction_s + SPARE_S)
    return math.sqrt(reaction**2 + 2.0 * a * way_m + end_mps**2) - reaction


class Safety:
    """Permission of the orders to one robot. Times are the service's, ns; places are in {W}, m."""

    def __init__(self, config: RobotConfig, robot: str) -> None:
        self._config = config
        self._robot = robot
        self.people = PeopleNearRobot(config, robot)
        """The people around it, which learn what everybody does."""
        self._reports = Reports(config, robot)
        self._fences: tuple[Obstacle, ...] | None = None
        """None before the map has come: then it must not move."""
        self._other_robots: dict[str, RobotState] = {}
        self._received_ns: dict[str, int] = {}
        """Time of the first step after the last state of another robot."""
        self._now_ns = 0
        self._stop: tuple[str, StopReason] | None = None
        """Last reason to stop, and the user at that time. Its text is kept while its kind is the same."""

    def on_map(self, environment: Environment) -> None:
        """Update fences and level planes."""
        fences: list[Obstacle] = []
        for fence in environment.fences:
            if fence.kind == "keep_in":
                fences.append(KeepIn(fence))
            else:
                fences.append(KeepOut(fence))
        self._fences = tuple(fences)
        self.people.on_map(environment)

    def on_robot(self, name: str, state: RobotState) -> None:
        """Update the state of another robot. Its last place counts for a while if it sends no other."""
        # Before the first report, the place of a lost robot is only that of its start
        is_unknown = state.phase == "lost" and name not in self._other_robots
        if name != self._robot and not is_unknown:
            self._other_robots[name] = state
            self._received_ns.pop(name, None)

    def on_report(self, report: RobotReport, now_ns: int) -> str:
        """Check a report of this robot, in {W}. Return why it is not used, or `""`."""
        return self._reports.on_report(report, now_ns)

    def on_link_lost(self, reason: str) -> None:
        """Record that this robot is not connected."""
        self._reports.on_link_lost(reason)

    def take_problem(self, user: str, now_ns: int) -> str:
        """Return the reason why `user` cannot steer this robot now, or `""`.

        A quadrotor does not take off beside people.
        """
        self._now_ns = now_ns
        stop = self._reports.stop_reason(now_ns) or self.people.stop_reason(user, now_ns)
        if stop is not None:
            return stop.text
        if self._fences is None:
            return NO_MAP
        report = self._reports.newest
        if self._config.kind == "ground":
            return ""
        if report is None or report.is_flying:
            return ""

        # A quadrotor on the ground needs room to hover
        region = self._region()
        hover_m = add(report.position_m, (0.0, 0.0, self._config.hover_m))
        blocker = region.blocker(hover_m, 0.0)
        if blocker is None:
            return ""
        short_m = round_beyond(-region.clearance_m(blocker, hover_m))
        remedy = "make room"
        if blocker.kind == "people":
            remedy = self.people.room_remedy(blocker.name)
        return f"{self._robot} would hover {short_m} m too near to {blocker.name}: carry it away, or {remedy}"

    def target_problem(self, user: str, points_m: Sequence[Vec3], now_ns: int, *, sigma_m: float) -> str:
        """Return the reason not to go along points, known to `sigma_m` (1 sigma), or `""`."""
        stop = self._reports.stop_reason(now_ns) or self.people.stop_reason(user, now_ns)
        stop = stop or self.people.cursor_stop_reason(user, now_ns, follows=False)
        stop = stop or self.people.sigma_stop_reason(sigma_m)
        return self.way_problem(points_m) if stop is None else stop.text

    def way_problem(self, points_m: Sequence[Vec3]) -> str:
        """Return the reason not to send it along points for anybody, or `""`."""
        if self._fences is None:
            return NO_MAP
        region = self._region()
        leg_start_m = self._place_m()
        for number, point_m in enumerate(points_m, start=1):
            point_name = "the place" if number == len(points_m) else f"way-point {number}"
            blocker = region.blocker(point_m)
            if blocker is not None:
                clearance_m = region.clearance_m(blocker, point_m)
                return self._too_near(point_name, blocker, clearance_m)
            blocker = region.way(leg_start_m, point_m).blocker
            if blocker is not None:
                return f"the way to {point_name} comes too near to {blocker.name}: set way-points around it"
            leg_start_m = point_m
        return ""

    def set_point(self, user: str, target_m: Vec3, now_ns: int) -> PermittedSetPoint:
        """Return where it may go on its way to the place at which `user` points.

        Without a usable report or with a reason to stop it is the robot's own place.
        """
        place_m = self._place_m()
        stop = self.stop(user, "follow", now_ns)
        if stop is not None:
            return PermittedSetPoint(place_m, self._config.max_approach_mps, stop.text)
        region = self._region()
        reach_m = lead_m(self._config, self._config.max_speed_mps)
        ahead_m, blocker = region.toward(place_m, target_m, reach_m)
        step = subtract(ahead_m, place_m)

        # The speed limit also brings the set-point nearer: some drivers have no other limit
        report = self._reports.newest
        yaw_rad = 0.0 if report is None else report.yaw_rad
        limit_mps = speed_limit_mps(self._config, region, place_m, step, yaw_rad)
        max_m = max(lead_m(self._config, limit_mps), MARGIN_M)
        if norm(step) > max_m:
            ahead_m = add(place_m, scale(step, max_m / norm(step)))
        problem = ""
        if blocker is not None:
            problem = f"{blocker.name} is in {self._robot}'s way: point elsewhere"
        return PermittedSetPoint(ahead_m, limit_mps, problem)

    def stop(self, user: str, mode: str, now_ns: int) -> StopReason | None:
        """Return the reason to stand still now, or None.

        `user`: user who steers, or `""`. `mode`: mode of `Steering`. A landing continues when its person no
        longer points. Otherwise the robot would wait in the air.
        """
        self._now_ns = now_ns
        for name in tuple(self._other_robots):
            received_ns = self._received_ns.setdefault(name, now_ns)
            if now_ns - received_ns > FORGOTTEN_S * NS_PER_S:
                del self._other_robots[name]

        # The robot itself, then its user, then what it approaches
        stop = self._reports.stop_reason(now_ns)
        if stop is None and user:
            stop = self._user_stop_reason(user, mode, now_ns)
        if stop is None:
            stop = self._stop_before_obstacle()
        if stop is None:
            stop = self._stop_above_person(mode)

        # The first text of a kind is kept: the numbers in it would change all the time
        if stop is None:
            self._stop = None
            return None
        if self._stop is not None:
            last_user, last = self._stop
            if (last_user, last.kind) == (user, stop.kind):
                return last
        self._stop = (user, stop)
        return stop

    def _user_stop_reason(self, user: str, mode: str, now_ns: int) -> StopReason | None:
        if mode == "land":
            return self.people.presence_stop_reason(user)
        stop = self.people.stop_reason(user, now_ns)
        if stop is not None:
            return stop
        return self.people.cursor_stop_reason(user, now_ns, follows=mode == "follow")

    def speed_limit_mps(self, points_m: Sequence[Vec3]) -> float:
        """Return the greatest speed along points, from where it is."""
        return path_limit_mps(self._config, self._region(), (self._place_m(), *points_m))

    def _stop_before_obstacle(self) -> StopReason | None:
        """Return the obstacle that it cannot avoid unless it brakes now, or that it is in already."""
        report = self._reports.newest
        velocity_mps = self._reports.velocity_mps
        if report is None or norm(velocity_mps) < MOVING_MPS:
            return None
        if self._fences is None:
            return StopReason("fence", NO_MAP, is_freeing=False)

        # An obstacle stops it until it stands: else it is stopped and goes on in turns
        if self._stop is not None:
            _, last = self._stop
            if last.kind in get_args(ObstacleKind) and last.text != NO_MAP:
                return last
        region = self._region()
        blocker = self._moving_blocker(region, report.position_m, velocity_mps)
        if blocker is None:
            return None
        return self._stop_for(blocker, region.clearance_m(blocker, report.position_m))

    def _moving_blocker(self, region: Region, place_m: Vec3, velocity_mps: Vec3) -> Obstacle | None:
        """Return the obstacle for which a robot that moves from `place_m` must brake now, or None."""
        rests_m = predicted_places_m(self._config, place_m, velocity_mps, self._reports.turn_radps)
        for rest_m in rests_m:
            blocker = region.way(place_m, rest_m, 0.0).blocker
            if blocker is not None:
                return blocker
        if abs(velocity_mps[2]) >= MOVING_MPS:
            person = _person_not_left(region, place_m, rests_m[0])
            if person is not None:
                return person
        return self._person_passed_too_fast(region, place_m, norm(velocity_mps))

    def _stop_above_person(self, mode: str) -> StopReason | None:
        """Return the person in whose space a landing was stopped. It continues when they have left."""
        if mode != "land" or self._stop is None or self._stop[1].kind != "people":
            return None
        region = self._region()
        place_m = self._place_m()
        person = _person_not_left(region, place_m, place_m)
        if person is None:
            return None
        return self._stop_for(person, region.clearance_m(person, place_m))

    def _stop_for(self, blocker: Obstacle, gap_m: float) -> StopReason:
        if gap_m < 0.0:
            short_m = round_beyond(-gap_m)
            text = f"{self._robot} is {short_m} m too near to {blocker.name}: point away from it"
        else:
            text = f"{self._robot} stops before {blocker.name}: point elsewhere"
        return StopReason(blocker.kind, text, is_freeing=False)

    def _person_passed_too_fast(self, region: Region, place_m: Vec3, speed_mps: float) -> Obstacle | None:
        """Return the person near whom it exceeds the limit of speed, or None."""
        if speed_mps <= self._config.max_approach_mps + TOO_FAST_MPS:
            return None
        for obstacle in region.obstacles:
            if obstacle.kind == "people" and region.clearance_m(obstacle, place_m) < NEAR_M - MARGIN_M:
                return obstacle
        return None

    def _too_near(self, point_name: str, blocker: Obstacle, clearance_m: float) -> str:
        if clearance_m < 0.0 and blocker.kind == "fence":
            return f"{point_name} is beyond {blocker.name}: choose one on the robot's side of it"
        short_m = round_beyond(MARGIN_M - clearance_m)
        return f"{point_name} is {short_m} m too near to {blocker.name}: choose one farther away"

    def _place_m(self) -> Vec3:
        report = self._reports.newest
        return self._config.start_m if report is None else report.position_m

    def _region(self) -> Region:
        config = self._config
        report = self._reports.newest
        sigma_m = 0.0
        if report is not None:
            sigma_m = report.position_sigma_m or 0.0
        people = self.people.cylinders(self._now_ns)
        others = [self._cylinder(name, state) for name, state in self._other_robots.items()]
        obstacles = (*(self._fences or ()), *people, *others)
        return Region(obstacles, config.radius_m + 2.0 * sigma_m)

    def _cylinder(self, name: str, state: RobotState) -> CylinderObstacle:
        """Return the space of another robot: its size, twice its place's sigma, and its way to a stop."""
        reach_m = state.radius_m + 2.0 * (state.position_sigma_m or 0.0)
        reach_m += stopping_m(self._config, norm(state.velocity_mps))
        return CylinderObstacle("robots", f"robot {name}", state.position_m, reach_m, half_height_m=reach_m)


def _person_not_left(region: Region, place_m: Vec3, rest_m: Vec3) -> Obstacle | None:
    """Return the person in whose space a robot rises or comes down, instead of leaving it, or None.

    Their spaces are infinitely high: up and down do not lead away.
    """
    min_m = LEAVING * abs(rest_m[2] - place_m[2])
    for obstacle in region.obstacles:
        gap_m = region.clearance_m(obstacle, place_m)
        if obstacle.kind != "people" or gap_m >= 0.0:
            continue
        if region.clearance_m(obstacle, rest_m) - gap_m <= min_m:
            return obstacle
    return None
