"""`pointit evaluate`: the group of its commands, each imported when it is called."""

from pointit.cli.common.lazy import command, group

EVALUATE = """Measure the accuracy of the estimates on recordings of people, compared with known baselines.

The recordings are not part of PointIt; give their folder by --data or POINTIT_DATA. `selection`,
`things` and `home` need none: they simulate.

Example: pointit evaluate localization --data recordings --only-ours
"""

evaluate = group(
    "evaluate",
    EVALUATE,
    (
        command(
            "localization",
            "poses of people: errors, stated sigma, time; baselines",
            "pointit_lab.cli.command:localization",
        ),
        command("pointing", "yaw error of a drifting IMU, with anchors", "pointit_lab.cli.command:pointing"),
        command(
            "honesty",
            "coverage of stated uncertainties, with faults injected",
            "pointit_lab.cli.honesty:honesty",
        ),
        command(
            "selection",
            "simulated people select: time, wrong, missed, by method",
            "pointit_lab.cli.selection:selection",
        ),
        command(
            "things",
            "simulated people point at things: right, wrong, unintended",
            "pointit_lab.cli.things:things",
        ),
        command(
            "home",
            "simulated people place lamps, with mistakes: are the stated sigmas true?",
            "pointit_lab.cli.home:home",
        ),
    ),
)
