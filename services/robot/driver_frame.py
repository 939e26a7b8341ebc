"""Reports of a driver, checked, and commands to it, between its frame, which the map places, and {W}."""

import math
from dataclasses import replace

from pointit.geometry import vector
from pointit.geometry.rotation import inverse, rotate
from pointit.geometry.vector import Vec3
from pointit.maps.frames import point_in_world, yaw_in_world
from pointit.schemas import FARTHEST
from pointit.schemas.environment import Frame
from pointit.services.robot.robot_driver import Command, Follow, FollowPath, Land, RobotReport

END_NS = 2**62
"""End of the times that are accepted, ns; 146 years."""


def report_in_world(report: RobotReport, frame: Frame) -> RobotReport:
    """Return a report of a pose in {W}."""
    return replace(
        report,
        position_m=point_in_world(report.position_m, frame),
        velocity_mps=rotate(frame.orientation_xyzw, report.velocity_mps),
        yaw_rad=yaw_in_world(report.yaw_rad, frame),
    )


def in_frame(command: Command, frame: Frame) -> Command:
    """Return a command that is in {W} as the driver gets it."""
    match command:
        case Follow():
            place, yaw_rad = _point(command.position_m, frame), _yaw(command.yaw_rad, frame)
            return replace(command, position_m=place, yaw_rad=yaw_rad)
        case FollowPath():
            points = tuple(_point(each, frame) for each in command.points_m)
            return replace(command, points_m=points, yaw_rad=_yaw(command.yaw_rad, frame))
        case Land(position_m=place) if place is not None:
            return replace(command, position_m=_point(place, frame))
        case _:
            return command


def _point(point_m: Vec3, frame: Frame) -> Vec3:
    return rotate(inverse(frame.orientation_xyzw), vector.subtract(point_m, frame.position_m))


def _yaw(yaw_rad: float | None, frame: Frame) -> float | None:
    if yaw_rad is None:
        return None
    return vector.azimuth(rotate(inverse(frame.orientation_xyzw), vector.direction(yaw_rad, 0.0)))


def report_fault(report: RobotReport) -> str:
    """Return the reason not to use `report`, or `""`."""
    numbers = (*report.position_m, *report.velocity_mps, report.yaw_rad)
    if len(numbers) != 7 or not all(math.isfinite(each) and abs(each) <= FARTHEST for each in numbers):
        return (
            "the robot reports a pose or velocity that is no number or too large; it is not used: look at "
            "its localization"
        )
    sigma_m = report.position_sigma_m
    if sigma_m is not None and not 0.0 <= sigma_m <= FARTHEST:
        return (
            f"the robot reports an uncertainty of {sigma_m:g} m; its report is not used: look at its driver"
        )
    if report.battery is not None and not 0.0 <= report.battery <= 1.0:
        return f"the robot reports a charge of {report.battery:g}; its report is not used: look at its driver"
    if not 0 <= report.stamp_ns < END_NS:
        return f"the robot reports the time {report.stamp_ns} ns; its report is not used: look at its clock"
    return ""
