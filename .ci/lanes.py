"""What CI runs for a change: a lane with the tests of one optional room, or everything.

Prints one sentence that says why, then the lane's folders and files of tests, one a line. Without these it is
everything, as whenever something is not known. A lane is chosen if all that has changed since a green commit
is of one room. A green commit is `CI_BASE`, or else where this branch left origin/main. Changed pages add
their own tests. Every tenth commit of the first line runs everything.
"""

import os
import subprocess
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
WHOLE_EVERY = 10
"""Commits of the first line."""
ALWAYS = (
    *("tests/architecture", "tests/contract", "tests/golden", "tests/mutants", "tests/replay"),
    "tests/docs/test_inline.py",  # options that pages name
)


@dataclass(frozen=True)
class Room:
    """An optional room. Its tests also count as its sources."""

    sources: tuple[str, ...]
    """Folders of the product."""
    tests: tuple[str, ...]
    """Its own tests."""
    others: tuple[str, ...] = ()
    """Tests of several rooms that use it."""


PRODUCT = "pointit/"
BRIDGES = "bridges/"
ROOMS = {
    "devices": Room(
        ("lab/pointit_lab/devices",),
        ("tests/devices", "tests/interop/touch_sdk"),
        (
            *(f"tests/unit/{name}" for name in ("imu_bridge", "led_driver", "robot", "testing_kit")),
            "tests/wheel",
        ),
    ),
    "lab": Room(
        tuple(f"lab/pointit_lab/{name}" for name in ("benchmarks", "cli", "evaluation", "loadtest")),
        ("tests/lab",),
        ("tests/docs", "tests/wheel", "tests/interop/ros2_dds/test_rclpy_relay.py"),
    ),
    "foxglove": Room(
        (f"{BRIDGES}foxglove",),
        ("tests/unit/foxglove", "tests/integration/foxglove"),
        ("tests/examples", "tests/unit/web", "tests/integration/access/test_bridges.py"),
    ),
    "ros2": Room(
        (f"{BRIDGES}ros2",),
        ("tests/unit/ros2", "tests/integration/ros2", "tests/interop/ros2", "tests/interop/ros2_dds"),
        ("tests/unit/cli", "tests/unit/cli_run", "tests/unit/conversion", "tests/unit/testing_kit"),
    ),
    "page": Room(
        (f"{BRIDGES}web", f"{PRODUCT}launch/page.py", f"{PRODUCT}cli/page.py"),
        ("tests/unit/web", "tests/integration/web", "tests/e2e/web", "tests/e2e/web_devices"),
        (
            *("tests/unit/cli_run", "tests/unit/deploy", "tests/unit/recorder", "tests/wheel"),
            *("tests/integration/cli/test_stage.py", "tests/e2e/run/test_metrics.py"),
            *("tests/unit/scan/test_solver.py",),
            *("tests/e2e/run/test_terminal.py", "tests/unit/foxglove/test_layout.py"),
            "tests/unit/launch",
            *(
                "tests/devices/test_mqtt_lamps.py",
                "tests/devices/test_network_wrists.py",
                "tests/e2e/run/test_page.py",
                "tests/integration/assistants",
                "tests/e2e/run/test_assistants.py",
                "tests/unit/cli/test_scan_live.py",
                "tests/unit/study/test_page.py",
            ),
        ),
    ),
    "assistants": Room(
        (f"{PRODUCT}assistants", f"{PRODUCT}cli/assistants.py"),
        ("tests/unit/assistants", "tests/integration/assistants", "tests/e2e/run/test_assistants.py"),
        ("tests/unit/cli",),
    ),
    "studies": Room(
        tuple(f"{PRODUCT}{name}" for name in ("study", "study_report", "cli/study.py")),
        ("tests/unit/study", "tests/unit/study_report", "tests/examples/test_selection_study.py"),
        ("tests/unit/cli", "tests/wheel", "tests/e2e/web/test_study.py"),
    ),
    "scan": Room(
        (f"{PRODUCT}scan", "lab/pointit_lab/evaluation/scan"),
        ("tests/unit/scan", "tests/unit/web/test_scan.py", "tests/unit/web/test_scan_solving.py"),
        (
            "tests/e2e/web/test_scan.py",
            "tests/lab/cli/test_evaluate_scan.py",
            "tests/unit/cli/test_scan_live.py",
        ),
    ),
    "words": Room(
        (f"{PRODUCT}speech", "services/listener"),
        ("tests/unit/speech", "tests/unit/listener", "tests/integration/scenario/test_put_that_there.py"),
        (
            *("tests/examples/test_recogniser.py", "tests/lab/evaluation/test_referents.py"),
            *("tests/e2e/web/test_speech.py", "tests/unit/cli", "tests/unit/cli_run"),
        ),
    ),
    "motion capture": Room(
        (f"{BRIDGES}mocap",),
        ("tests/unit/mocap", "tests/devices/test_mocap.py", "tests/devices/test_qtm.py"),
        ("tests/unit/cli",),
    ),
    "robots": Room(
        (
            *(f"services/{name}" for name in ("goal", "robot", "robot_replay")),
            *(f"{PRODUCT}launch/robots.py", f"{PRODUCT}cli/robots.py", f"{PRODUCT}vda5050"),
            f"{BRIDGES}agv_tracker",
        ),
        (
            *(f"tests/unit/{name}" for name in ("agv_tracker", "goal", "robot", "robot_replay")),
            *("tests/integration/scenario/test_robots.py", "tests/devices/test_vda5050.py"),
            "tests/devices/test_vda5050_tolerance.py",
            "tests/devices/vda5050_agv",
        ),
        (
            *("tests/unit/cli_run", "tests/unit/launch", "tests/unit/ros2", "tests/unit/testing_kit"),
            "tests/unit/runtime/test_missing_plugins.py",
            *("tests/integration/ros2", "tests/integration/scenario/steered_robots.py"),
            "tests/integration/scenario/test_send_a_robot.py",
            "tests/integration/access/test_bridges.py",
            "tests/integration/api/test_found_by_following.py",
            *(f"tests/lab/evaluation/test_robot_{what}.py" for what in ("evaluation", "identification")),
            "tests/lab/cli/test_evaluate_selection.py",
            "tests/e2e/web/test_robots.py",
        ),
    ),
}
DOCUMENTS = ("docs", "README.md", "CHANGELOG.md", "mkdocs.yml")
OF_DOCUMENTS = (
    *("tests/docs", "tests/architecture", "tests/contract"),
    *("tests/unit/maps/test_map_check.py", "tests/unit/robot/test_robot_stops.py"),
    *("tests/unit/ros2/test_routes.py", "tests/unit/ros2/test_map_parameters.py"),
    *("tests/unit/supervisor/test_life_cycle.py", "tests/lab/evaluation/test_honesty_gate.py"),
)
"""What reads the pages."""


def lane(changed: Iterable[str]) -> tuple[str, tuple[str, ...]]:
    """Return why, and the tests to run for the `changed` paths; no tests: everything."""
    paths = set(changed)
    documents = {path for path in paths if is_in(path, DOCUMENTS)}
    also = OF_DOCUMENTS if documents else ()
    if not paths:
        return "everything: nothing has changed", ()
    if documents == paths:
        return "documents: nothing else has changed", also
    for name, room in ROOMS.items():
        if all(is_in(path, (*room.sources, *room.tests)) for path in paths - documents):
            tests = dict.fromkeys((*room.tests, *room.others, *ALWAYS, *also))
            return f"{name}: nothing else has changed", tuple(tests)
    places = [each for room in ROOMS.values() for each in (*room.sources, *room.tests)]
    elsewhere = sorted(path for path in paths - documents if not is_in(path, places))
    return f"everything: {elsewhere[0] if elsewhere else 'more than one room'} has changed", ()


def is_in(path: str, places: Iterable[str]) -> bool:
    """Return True if `path` is one of `places`, or below one."""
    return any(path == place or path.startswith(f"{place}/") for place in places)


def is_turn_of_all(before: int, now: int) -> bool:
    """Return True if a multiple of `WHOLE_EVERY` was passed, given the lengths of the first line."""
    return before // WHOLE_EVERY != now // WHOLE_EVERY


def git(*arguments: str) -> str:
    """Return what git says; raises if it fails."""
    done = subprocess.run(
        ["git", "-C", ROOT, *arguments],  # noqa: S607 - any git
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return done.stdout.strip()


def chosen() -> tuple[str, tuple[str, ...]]:
    """Return why, and the tests, for this checkout."""
    unknown = "everything: no earlier green commit is known", ()
    try:
        base = git("merge-base", "HEAD", os.environ.get("CI_BASE") or "origin/main")
        if base == git("rev-parse", "HEAD") or git("rev-parse", "--is-shallow-repository") == "true":
            return unknown
        before, now = (int(git("rev-list", "--first-parent", "--count", each)) for each in (base, "HEAD"))
        # the old and the new path of what was moved, and what is not committed
        changed = git("diff", "--name-only", "--no-renames", base).splitlines()
        changed += git("ls-files", "--others", "--exclude-standard").splitlines()
    except (OSError, subprocess.CalledProcessError):
        return unknown
    if is_turn_of_all(before, now):
        return f"everything: it is due every {WHOLE_EVERY} commits", ()
    why, tests = lane(changed)
    return f"{why} since {base[:8]}", tuple(each for each in tests if (ROOT / each).exists())


if __name__ == "__main__":
    why, tests = chosen()
    print(why, *tests, sep="\n")
