"""Pointing at one lamp sets the pose right: asked for by a double press or by others, and back again."""

import pytest

from pointit.schemas import Feedback, Localization, UserPose
from pointit.services.supervisor import transitions
from pointit.services.supervisor.life_cycle import LifeCycle
from tests.unit.supervisor import played
from tests.unit.supervisor.played import Gesture, Phase, S, life_cycle, press, sample, shown, told

AIM = "Point at led_1 with your arm straight and stay on it. No cursor is shown."


def news(now_s: float, phase: Phase, **more: object) -> tuple[Localization, int]:
    return played.news(now_s, phase, **{"purpose": "anchor", **more})


def resting(*, has_pose: bool = True) -> LifeCycle:
    cycle = life_cycle()
    cycle.begin(0)
    if has_pose:
        cycle.pose(*played.pose())
    return cycle


def pointing(since_s: float = 9.0) -> LifeCycle:
    cycle = resting()
    cycle.button(*press(since_s))
    assert cycle.state == "pointing"
    return cycle


def went_back(cue: str, back: str) -> list[str]:
    """Return the outputs of an end with `cue`, for pointing and idle people."""
    if back == "pointing":
        return [f"cue {cue}", "pointing", "cue started"]
    return ["cue localized", "idle", "cue stopped"] if cue == "localized" else ["idle", f"cue {cue}"]


def anchoring(cycle: LifeCycle) -> LifeCycle:
    """Return `cycle` after a double press at 10 s, a consent, and news of the lamp."""
    assert told(cycle.button(*press(10, "double"))) == ["anchor", "localizing", "cue started"]
    assert cycle.on_start_accepted(cycle.run) == []
    outputs = cycle.localization(*news(11, "sampling", target_id="led_1", since_ns=10 * S))
    assert told(outputs) == ["localizing", "cue target"]
    assert shown(outputs).next_step == AIM
    return cycle


@pytest.mark.parametrize("back", ["pointing", "idle"])
@pytest.mark.parametrize(
    ("phase", "cue", "reason"),
    [
        ("solved", "localized", transitions.ANCHORED),
        ("refused", "refused", "the arm moved; hold it still"),
        ("cancelled", "stopped", transitions.ANCHOR_CANCELLED),
    ],
)
def test_it_goes_back_where_it_was_whatever_happens(back: str, phase: Phase, cue: str, reason: str) -> None:
    cycle = anchoring(pointing() if back == "pointing" else resting())
    said = reason if phase == "refused" else ""
    outputs = cycle.localization(*news(13, phase, reason=said, since_ns=10 * S))
    assert told(outputs) == went_back(cue, back)
    assert shown(outputs).reason == reason
    assert next(o.text for o in outputs if isinstance(o, Feedback) and o.cue == cue) == reason
    assert cycle.localization(*news(13, phase, since_ns=10 * S)) == []
    assert told(cycle.button(*press(14)))[0] == ("idle" if back == "pointing" else "pointing")


def test_anchor_is_refused_without_a_pose() -> None:
    cycle = resting(has_pose=False)
    outputs = cycle.button(*press(1, "double"))
    assert told(outputs) == ["idle", "cue refused"]
    assert shown(outputs).reason == transitions.NO_POSE_TO_ANCHOR


@pytest.mark.parametrize("gesture", ["press", "double", "hold"])
def test_any_gesture_calls_it_off_for_good(gesture: Gesture) -> None:
    cycle = anchoring(pointing())
    back = "idle" if gesture == "hold" else "pointing"
    assert told(cycle.button(*press(12, gesture))) == ["cancel", *went_back("stopped", back)]
    late = {"target_id": "led_1", "since_ns": 10 * S}
    assert cycle.localization(*news(12.1, "sampling", **late)) == []  # said before it was cancelled
    assert cycle.localization(*news(12.2, "cancelled", **late)) == []
    assert cycle.state == back


@pytest.mark.parametrize("back", ["pointing", "idle"])
def test_anchor_of_another_client_is_followed(back: str) -> None:
    cycle = pointing() if back == "pointing" else resting()
    outputs = cycle.localization(*news(20, "sampling", target_id="led_1", since_ns=20 * S))
    assert told(outputs) == ["localizing", "cue target"]
    assert (shown(outputs).reason, shown(outputs).next_step) == (transitions.ANCHOR_ASKED_FOR, AIM)
    assert told(cycle.localization(*news(22, "solved", since_ns=20 * S))) == went_back("localized", back)
    outputs = cycle.localization(*news(23, "sampling", target_id="led_2", since_ns=23 * S))  # the next one
    assert told(outputs) == ["localizing", "cue target"]


def test_news_of_the_one_before_do_not_end_it() -> None:
    cycle = pointing()
    cycle.button(*press(10, "double"))
    assert cycle.localization(news(9.9, "refused")[0], 10 * S) == []
    assert cycle.localization(*news(10.1, "cancelled")) == []  # ours is not answered yet
    assert cycle.localization(*news(10.2, "idle", purpose="pose")) == []
    assert cycle.state == "localizing"


@pytest.mark.parametrize("phase", ["idle", "sampling"])
def test_anchor_ends_when_the_localizer_does_something_else(phase: Phase) -> None:
    cycle = anchoring(pointing())
    outputs = cycle.localization(*news(12, phase, purpose="pose"))
    assert told(outputs) == went_back("refused", "pointing")
    assert shown(outputs).reason == transitions.ANCHOR_LOST


def test_it_has_the_time_outs_of_all_that_takes_time() -> None:
    cycle = anchoring(pointing())
    for now_s in range(12, 70):
        cycle.imu(*sample(now_s))
    outputs = cycle.tick(70 * S)
    assert told(outputs) == ["cancel", *went_back("refused", "pointing")]
    assert "no progress for 60 s" in shown(outputs).reason
    assert told(cycle.tick(72 * S)) == ["idle", "cue stopped"]  # the wrist is silent by now


@pytest.mark.parametrize("back", ["pointing", "idle"])
def test_anchor_ends_in_idle_when_the_wrist_is_silent(back: str) -> None:
    cycle = anchoring(pointing() if back == "pointing" else resting())
    cycle.imu(*sample(11))
    assert cycle.deadline_ns == 14 * S
    outputs = cycle.tick(14 * S)
    assert told(outputs) == ["cancel", "idle", "cue refused"]
    assert "Is the wristband on" in shown(outputs).reason
    assert cycle.localization(*news(14.1, "sampling", target_id="led_1", since_ns=10 * S)) == []


def test_next_step_is_an_anchor_while_the_yaw_is_uncertain() -> None:
    def known(now_s: float, sigma_rad: float, method: str = "static_targets") -> tuple[UserPose, int]:
        fields = {
            "stamp_ns": round(now_s * S),
            "position_m": (0.0, 0.0, 0.0),
            "yaw_rad": 0.0,
            "covariance": (0.0,) * 8 + (sigma_rad**2,),
            "method": method,
        }
        return UserPose.model_validate(fields), round(now_s * S)

    cycle = life_cycle()
    cycle.begin(0)
    cycle.pose(*known(1, 0.1))
    assert shown(cycle.button(*press(2))).next_step == transitions.POINT
    unsure = shown(cycle.pose(*known(3, 0.27)))
    assert (unsure.next_step, unsure.is_unsure) == (transitions.POINT_AT_LAMP, True)
    assert cycle.pose(*known(4, 0.28)) == []  # said already
    sure = shown(cycle.pose(*known(5, 0.05)))
    assert (sure.next_step, sure.is_unsure) == (transitions.POINT, False)
    assert cycle.pose(*known(6, 0.5, "external")) == []  # a tracker's is not ours to set right


def test_anchor_that_replaces_another_is_joined() -> None:
    """A second request cancels the first and begins at the same time, and its messages take a while."""
    cycle = pointing()
    assert "localizing" in told(cycle.localization(*news(10, "sampling", since_ns=10 * S, target_id="led_0")))
    cycle.localization(news(11, "cancelled", since_ns=10 * S)[0], round(11.02 * S))
    again = news(11, "sampling", since_ns=11 * S, target_id="led_1")[0]
    assert "localizing" in told(cycle.localization(again, round(11.02 * S)))
    assert "pointing" in told(cycle.localization(*news(15, "solved", since_ns=11 * S)))
    late = news(14, "sampling", since_ns=11 * S, target_id="led_1")[0]
    assert cycle.localization(late, round(15.01 * S)) == []  # of the one that is over
