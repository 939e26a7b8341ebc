"""`pointit track` measures trackers and lists their objects."""

import json

import pytest

from pointit.cli.inspect.track import TrackerMeters, Tracking, show
from pointit.schemas import NS_PER_S, TrackedObject, TrackedObjects

BEGIN_NS = 1000 * NS_PER_S


def thing(name: str, **fields: object) -> TrackedObject:
    return TrackedObject.model_validate({"id": name, "kind": "red", "position_m": (1.0, 2.0, 0.5), **fields})


def measured(*only: str) -> Tracking:
    meters = TrackerMeters(only)
    cups = (thing("mug", velocity_mps=(3.0, 4.0, 0.0), yaw_rad=0.0), thing("cup", position_sigma_m=0.02))
    for step in range(30):
        late_ns = NS_PER_S // 10 if step % 10 else NS_PER_S // 2
        now_ns = BEGIN_NS + step * NS_PER_S // 10
        camera = TrackedObjects(stamp_ns=now_ns - late_ns, objects=cups, latency_sigma_s=0.03)
        meters.add("camera", camera, arrived_s=0.1 * step, arrived_ns=now_ns)
        other = TrackedObjects(stamp_ns=now_ns, objects=(thing("cup"),))
        meters.add("robot", other, arrived_s=0.1 * step, arrived_ns=now_ns)
    return meters.take(3.0, 3.0)


def test_rates_ages_and_objects_are_measured() -> None:
    tracking = measured()
    camera, robot = tracking.trackers
    assert (camera.tracker, camera.objects, camera.latency_sigma_s) == ("camera", 2, 0.03)
    assert camera.rate_hz == pytest.approx(10.0)
    assert camera.age_s == pytest.approx(0.1)
    assert camera.age_p95_s == pytest.approx(0.5)
    assert robot.age_s == pytest.approx(0.0)
    cup, mug, _ = tracking.objects
    assert (cup.object, cup.tracker, cup.sigma_m, cup.yaw_deg) == ("cup", "camera", 0.02, None)
    assert (mug.x_m, mug.y_m, mug.z_m, mug.speed_mps, mug.yaw_deg) == (1.0, 2.0, 0.5, 5.0, 0.0)


def test_one_object_of_two_trackers_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert show(measured("robot"), 3.0, as_json=False)
    out = capsys.readouterr().out
    assert "warning: the trackers camera and robot both report cup" in out
    assert "mug" not in out.replace("cup of the tracker camera and mug", "")


def test_a_window_is_one_line_of_json(capsys: pytest.CaptureFixture[str]) -> None:
    show(measured(), 3.0, as_json=True)
    (line,) = capsys.readouterr().out.splitlines()
    said = json.loads(line)
    assert said["window_s"] == 3.0
    assert [row["tracker"] for row in said["trackers"]] == ["camera", "robot"]
    assert [row["object"] for row in said["objects"]] == ["cup", "mug", "cup"]
    assert said["twins"][0].startswith("the trackers camera and robot both report cup")


def test_without_a_tracker_the_remedy_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    show(TrackerMeters().take(3.0, 3.0), 3.0, as_json=False)
    assert capsys.readouterr().err == (
        "no tracker was heard within 3 s; start one, or see `pointit doctor`\n"
    )
