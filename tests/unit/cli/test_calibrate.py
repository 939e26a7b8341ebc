"""Reports on a person's pointing and pose, and on a measured mounting."""

import math
from collections.abc import Sequence

import pytest

from pointit.cli.people import anchor as pose_text
from pointit.cli.people import calibrate_user
from pointit.cli.people.anchor import sentence
from pointit.cli.people.calibrate_mounting import format_result
from pointit.cli.people.pose import LatestTruth
from pointit.forearm.true_pose import PoseError
from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    Anchor,
    PointingOffset,
    RememberedBias,
    TrackedObject,
    TrackedObjects,
    UserPose,
    topics,
)
from pointit.services.imu_bridge.fitted_mounting import FittedMounting
from tests.support import there
from tests.support.bench import memory_bench

S = 1_000_000_000
EYES: Vec3 = (0.0, 0.0, 1.6)
AT: Vec3 = (1.0, 2.0, 0.0)
LAMPS: tuple[Vec3, ...] = ((3.5, -1.0, 0.3), (4.0, 3.0, 0.2), (2.5, 5.0, 2.0), (0.0, 6.0, 0.4))


def anchor(index: int, time_s: float, yaw_rad: float, true_yaw_rad: float, low_rad: float = 0.05) -> Anchor:
    """Return the anchor of pointing at a lamp with a yaw of `true_yaw_rad` and an estimate of `yaw_rad`."""
    lamp = LAMPS[index % len(LAMPS)]
    way = vector.subtract(lamp, vector.add(AT, EYES))
    ray = vector.direction(vector.azimuth(way) - true_yaw_rad, vector.elevation(way) - low_rad)
    return Anchor(
        stamp_ns=round(time_s * S), target_id=f"led_{index % len(LAMPS)}", target_m=lamp, origin_m=EYES,
        raw_direction=ray, direction=ray, position_m=AT, yaw_rad=yaw_rad,
    )  # fmt: skip


@pytest.mark.parametrize("count", [1, 3, 4, 7])
def test_heading_that_the_first_anchor_corrected_is_no_offset(count: int) -> None:
    anchors = [anchor(k, 4.0 * k, 0.0 if k == 0 else 1.0, 1.0) for k in range(count)]
    fitted, rows = calibrate_user.assess(anchors, 99)
    assert fitted.dropped == ()
    assert fitted.heading_rad == pytest.approx(1.0)
    assert fitted.offset is not None
    assert (fitted.offset.anchors, fitted.offset.fitted_ns) == (count, 99)
    for row in rows:
        assert row.is_used
        assert row.azimuth_before_rad == pytest.approx(0.0, abs=1e-9)
        assert row.elevation_before_rad == pytest.approx(0.05)
        assert row.elevation_after_rad == pytest.approx(0.05 - fitted.offset.elevation[0])
        assert row.elevation_after_rad == pytest.approx(0.0, abs=0.01)


def test_an_imu_that_drifts_meanwhile_bends_nothing() -> None:
    drift = math.radians(0.5)  # a second: 14° from the first to the last
    anchors = [anchor(k, 4.0 * k, 0.7, 0.7 + drift * 4.0 * k) for k in range(8)]
    fitted, rows = calibrate_user.assess(anchors, 0)
    assert fitted.dropped == ()
    assert [row.azimuth_before_rad for row in rows] == pytest.approx([0.0] * 8, abs=math.radians(0.1))
    turned = [seen.yaw_rad for seen in calibrate_user.in_one_pose(anchors)]
    assert turned == pytest.approx([0.7 + drift * 4.0 * k for k in range(8)])


def test_too_few_pointings_tell_no_drift() -> None:
    anchors = [anchor(k, 4.0 * k, 0.5, 0.6 + 0.1 * k) for k in range(3)]
    assert [seen.yaw_rad for seen in calibrate_user.in_one_pose(anchors)] == [0.5, 0.5, 0.5]
    fitted, rows = calibrate_user.assess([], 0)
    assert (fitted.offset, rows) == (None, [])


def test_restless_holds_and_those_far_from_the_others_are_said() -> None:
    anchors = [anchor(k, 4.0 * k, 0.0, 0.0) for k in range(6)]
    anchors[2] = anchors[2].model_copy(
        update={"spread_rad": 0.1, "accepted": False, "reason": "the arm wandered"}
    )
    anchors[4] = anchor(4, 16.0, 0.0, 0.0, low_rad=0.4)
    fitted, rows = calibrate_user.assess(anchors, 0)
    assert there(fitted.offset).anchors == 4
    assert [calibrate_user.table_row(row)["used"] for row in rows] == [
        *("yes", "yes", "no: the arm wandered", "yes", "no: far from the others", "yes")
    ]


def doubt(anchors: Sequence[Anchor]) -> str:
    return calibrate_user.rejection_reason(calibrate_user.assess(anchors, 0)[1])


def test_pose_is_doubted_for_scatter_but_not_for_one_outlier() -> None:
    right = [anchor(k, 4.0 * k, 0.0, 0.0) for k in range(8)]
    assert doubt(right) == ""
    assert "scatter by" in doubt([each.model_copy(update={"position_m": (3.0, 3.5, 0.0)}) for each in right])
    high = [anchor(k, 4.0 * k, 0.0, 0.0, low_rad=0.05 if k < 3 else 0.8) for k in range(6)]
    assert doubt(high) == "3 of 6 pointings exceed the error of a person"
    right[3] = anchor(3, 12.0, 0.0, 0.8)
    fitted, rows = calibrate_user.assess(right, 0)
    assert fitted.dropped == (3,)
    assert calibrate_user.rejection_reason(rows) == ""
    assert calibrate_user.rejection_reason([]) == ""


def test_pointing_that_counts_although_not_accepted_is_reported() -> None:
    taken = anchor(0, 0.0, 0.0, 0.0)
    rejected = anchor(1, 4.0, 0.0, 0.0).model_copy(update={"accepted": False, "reason": "it is 30° off"})
    _, rows = calibrate_user.assess([taken, rejected], 0)
    assert [calibrate_user.shown_row(row)["counts"] for row in rows] == [
        "yes",
        "yes, but the localizer did not correct the pose by it: it is 30° off",
    ]
    assert [calibrate_user.table_row(row)["not_accepted"] for row in rows] == ["", "it is 30° off"]
    wandered = anchor(0, 0.0, 0.0, 0.0).model_copy(update={"spread_rad": 0.1})
    _, rows = calibrate_user.assess([wandered], 0)
    assert calibrate_user.shown_row(rows[0])["too_far_right"] is None  # not a 0 that nobody measured


def test_an_offset_in_words() -> None:
    terms = (-0.0349, 0.0, 0.0, 0.0, 0.0, 0.0)
    plain = PointingOffset(rung="pitch", elevation=terms, anchors=1, sigma_rad=0.0175)
    assert calibrate_user.describe(plain) == (
        "the rays are turned down by 2.0°; fitted from 1 pointing, 1.0° (1 sigma) is left"
    )
    bent = PointingOffset(rung="polynomial", elevation=terms, anchors=9)
    assert "by 2.0° in the middle, and differently elsewhere (a polynomial" in calibrate_user.describe(bent)


def pose(**fields: object) -> UserPose:
    return UserPose.model_validate(
        {"stamp_ns": 10 * S, "position_m": (1.0, -2.0, 0.0), "yaw_rad": 7.0, **fields}
    )


def test_a_pose_in_peoples_units() -> None:
    known = pose(
        covariance=(0.02, 0.01, 0.0, 0.01, 0.02, 0.0, 0.0, 0.0, math.radians(2.0) ** 2),
        elevation_bias_rad=math.radians(3.0),
        yaw_rate_radps=math.radians(-0.2),
        yaw_rate_sigma_radps=math.radians(0.05),
        anchored_ns=4 * S,
        method="static_targets",
    )
    position_m, yaw_rad = pose_text.sigmas(known)
    assert position_m == pytest.approx(math.sqrt(0.03))  # along the worse direction
    assert math.degrees(yaw_rad) == pytest.approx(2.0)
    assert pose_text.lines(pose_text.fields(known, 12 * S)) == [
        "position      x 1.00 m, y -2.00 m, z 0.00 m; 1 sigma 0.17 m",
        "yaw           41.1°; 1 sigma 2.0°",  # 7 rad, once round less
        "rays too high by 3.0°",
        "drift         -12.0 °/min; 1 sigma 3.0 °/min",
        "last anchor   8.0 s ago",
        "method        found by pointing at lamps",
        "published     2.0 s ago",
    ]

    low = known.model_copy(update={"elevation_bias_rad": math.radians(-3.2)})
    assert pose_text.lines(pose_text.fields(low, 12 * S))[2] == "rays too low  by 3.2°"
    for count, row in ((1, "elevation bias of 1 localization"), (3, "elevation bias of 3 localizations")):
        bias = RememberedBias(
            localizations=count,
            origin_height_m=1.6,
            bias_rad=0.05,
            slope=0.0,
            covariance=(1e-4, 0.0, 0.0, 0.01),
        )
        remembering = known.model_copy(update={"remembered_bias": bias})
        fields = pose_text.fields(remembering, 12 * S)
        assert fields["remembered_localizations"] == count
        assert pose_text.lines(fields)[2:4] == ["rays too high by 3.0°", f"remembered    {row}"]
    unknown = known.model_copy(update={"yaw_rate_radps": 0.0, "yaw_rate_sigma_radps": math.radians(0.25)})
    assert "drift         not known yet" in pose_text.lines(pose_text.fields(unknown, 12 * S))

    given = pose_text.lines(pose_text.fields(pose(), 400 * S))
    assert given[0] == "position      x 1.00 m, y -2.00 m, z 0.00 m"
    assert given[2:] == [
        "drift         not estimated",
        "last anchor   never",
        "method        given, counts as exact",
        "published     6 min ago",
    ]


def test_a_pose_shows_its_error_where_motion_capture_knows_it() -> None:
    known = pose(method="static_targets")
    shown = pose_text.fields(known, 2 * S, PoseError(0.124, math.radians(-3.4)))
    assert (shown["position_error_m"], shown["yaw_error_deg"]) == pytest.approx((0.124, -3.4))
    assert pose_text.lines(shown)[-1] == "true error    position 0.12 m, yaw -3.4°, by motion capture"
    head_only = pose_text.fields(known, 2 * S, PoseError(0.5, None))
    assert pose_text.lines(head_only)[-1] == "true error    position 0.50 m, yaw not known, by motion capture"
    assert "true error" not in "".join(pose_text.lines(pose_text.fields(known, 2 * S)))


async def test_true_pose_is_from_the_tracker_that_sees_the_person() -> None:
    async with memory_bench() as bench:
        truth = LatestTruth(bench.bus, "anna")
        seen = (("mocap", "anna", "person_frame"), ("robot", "cup", "red"), ("camera", "anna", "person"))
        for tracker, name, kind in seen:
            x_m = 4.0 if tracker == "camera" else 1.0  # the one that knows the yaw is used
            each = TrackedObject(id=name, kind=kind, position_m=(x_m, -1.5, 1.7), yaw_rad=0.5)
            bench.put(topics.OBJECTS, TrackedObjects(stamp_ns=10 * S, objects=(each,)), tracker)
        await bench.settle()
        assert await truth.wait(0.0) is not None
    error = there(truth.error_of(pose(method="static_targets", yaw_rad=0.4)))
    assert (error.position_m, error.yaw_rad) == pytest.approx((0.5, -0.1))
    assert truth.error_of(pose(method="external")) is None  # it is of the same cameras


def test_an_anchor_in_one_sentence() -> None:
    found = anchor(1, 1.0, 0.0, 0.0).model_copy(update={"azimuth_error_rad": math.radians(-4.0)})
    after = pose(covariance=(0.01, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, math.radians(1.0) ** 2))
    assert sentence(found, None, after) == (
        "led_1: the direction was 4.0° too far left and is corrected; "
        "the pose is known to 0.10 m and 1.0° now."
    )

    slow = {"yaw_rate_radps": math.radians(0.1), "yaw_rate_sigma_radps": math.radians(0.2)}
    assert "drift" not in sentence(found, None, after.model_copy(update=slow))  # it may be none
    vague = pose(covariance=(0.09, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, math.radians(1.0) ** 2))
    assert sentence(found, after, vague).endswith(
        "known to 0.30 m and 1.0° now, before to 0.10 m and 1.0°; the position is less certain than before, "
        "the direction did not fit it: localize again if the person has moved."
    )

    noted = found.model_copy(update={"reason": "three anchors in a row agreed"})
    assert "less certain than before, three anchors in a row agreed: localize" in sentence(
        noted, after, vague
    )
    assert sentence(found, pose(), after).endswith("; before, it counted as exact, as it was given.")

    refused = found.model_copy(update={"accepted": False, "reason": "it is 40° off"})
    assert sentence(refused, after, after).endswith("not accepted, the pose is as before: it is 40° off")


def test_a_seat_in_words() -> None:
    found = FittedMounting(
        arm_from_true=(0.0, 0.0, 0.0, 1.0), about_arm_rad=math.radians(-92.0),
        off_axis_rad=math.radians(5.0), forward_before_rad=math.radians(-3.0),
        up_before_rad=math.radians(-4.0), forward_after_rad=-1e-9, up_after_rad=0.0, heading_change_rad=0.0,
    )  # fmt: skip
    seat, errors = format_result(found)
    assert "turned by 92° about the arm (counter-clockwise, seen from the elbow)" in seat
    assert "axis of the arm is 5° off" in seat
    assert errors == (
        "elevation of the level arm: -3.0° before, +0.0° with this mounting; of the raised arm, less 90°: "
        "-4.0° before, +0.0° with it"
    )
