"""Check of what a driver reports: messages cannot hold everything that a device says."""

import math

from pointit.schemas import FARTHEST
from pointit.services.robot.robot_driver import RobotReport

END_NS = 2**62
"""End of the times that are accepted, ns; 146 years."""


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
