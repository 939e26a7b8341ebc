"""Wrists of pages: the mouse's arm, cues of phones, pairing."""

import math
import xml.etree.ElementTree as ET
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.web.wrists.pairing import UNUSED_S, Pairing, offer
from pointit.bridges.web.wrists.phone import STEPS, PhoneCues
from pointit.bridges.web.wrists.wrist_control import FASTEST_RADPS, MouseArm
from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Announced, Candidate, Feedback, Interaction, Localization

STEP_NS = NS_PER_S // 60
SAMPLING: dict[str, Any] = {"stamp_ns": 0, "phase": "sampling"}
coordinates = st.floats(-20.0, 20.0)


def angle_between(a: Quaternion, b: Quaternion) -> float:
    x, y, z, w = rotation.multiply(rotation.inverse(a), b)
    return 2.0 * math.atan2(math.hypot(x, y, z), abs(w))


def test_it_points_ahead_before_it_is_told_where() -> None:
    arm = rotation.rotate(MouseArm().step(0), (1.0, 0.0, 0.0))
    assert vector.azimuth(arm) == pytest.approx(0.0)
    assert -0.5 < vector.elevation(arm) < 0.0


@given(st.lists(st.tuples(coordinates, coordinates, st.floats(0.0, 3.0)), min_size=2, max_size=12))
def test_it_never_turns_faster_than_a_wrist(places: list[Vec3]) -> None:
    arm = MouseArm()
    arm.set_pose((0.3, 0.2, 0.0), 0.7)
    before, now_ns = arm.step(0), 0
    for place in places:
        arm.aim(place)
        for _ in range(3):
            now_ns += STEP_NS
            after = arm.step(now_ns)
            assert angle_between(before, after) <= FASTEST_RADPS * STEP_NS / NS_PER_S + 1e-6
            before = after


def test_it_arrives_where_the_mouse_jumped_to_within_half_a_second() -> None:
    arm, now_ns = MouseArm(), 0
    arm.aim((3.0, 0.0, 1.0))
    arm.step(now_ns)
    arm.aim((-3.0, 0.5, 1.0))
    steps = [arm.step(now_ns := now_ns + STEP_NS) for _ in range(30)]
    assert angle_between(steps[0], steps[-1]) > 2.0
    assert steps[-1] == steps[-2]


def test_it_goes_the_shorter_way_round() -> None:
    arm = MouseArm()
    arm.aim((-3.0, 0.5, 1.0))
    arm.step(0)
    arm.aim((-3.0, -0.5, 1.0))  # 19° further, across the azimuth where angles begin again
    steps = [arm.step(k * STEP_NS) for k in range(1, 5)]
    assert steps[1] == steps[3]


def test_tremor_has_the_asked_size_and_comes_again_with_its_seed() -> None:
    def angles_of(seed: int) -> list[float]:
        arm = MouseArm(seed=seed)
        arm.aim((3.0, 0.0, 1.6))
        still = arm.step(0)
        arm.set_tremor(math.radians(0.5))
        return [angle_between(still, arm.step(k * STEP_NS)) for k in range(1, 1200)]

    first = angles_of(1)
    rms_deg = math.degrees(math.sqrt(sum(a * a for a in first) / len(first)))
    assert rms_deg == pytest.approx(0.5 * math.sqrt(2.0), rel=0.1)  # about two axes
    assert first == angles_of(1)
    assert first != angles_of(2)


def test_the_interactions_state_is_told_once_and_stays_in_every_cue() -> None:
    cues = PhoneCues()
    sure = Interaction(stamp_ns=0, state="pointing", next_step="hold on a package")
    for state in (sure, sure.model_copy(update={"is_unsure": True})):
        cue = cues.interaction(state)
        assert cue is not None
        assert (cue.state, cue.next_step) == ("pointing", "hold on a package")
        assert cue.wants_double == state.is_unsure
        assert cues.interaction(state) is None
        assert cues.current == cue
    feedback = cues.feedback(Feedback(stamp_ns=0, cue="selected"))
    assert feedback is not None
    assert (feedback.state, feedback.wants_double) == ("pointing", True)


def test_names_are_cues_and_a_phone_that_connects_before_one_is_spoken_knows_that_it_can_step() -> None:
    cues = PhoneCues()
    assert not cues.current.has_names
    first = cues.feedback(Announced(stamp_ns=1))
    assert first is not None
    assert first.has_names
    assert first.announced == ""
    assert cues.current == first
    assert cues.feedback(Announced(stamp_ns=2)) is None
    spoken = cues.feedback(Announced(stamp_ns=3, object_id="d", label="Kettle", began_ns=3))
    assert spoken == first.model_copy(update={"announced": "Kettle"})
    assert cues.current == first


def test_a_localization_tells_each_target_once_and_why_it_was_refused() -> None:
    def at(samples: int, index: int) -> Localization:
        target = {"target_id": f"led_{index}", "target_index": index, "target_count": 3}
        return Localization.model_validate({**SAMPLING, **target, "samples": samples})

    cues = PhoneCues()
    first = cues.localization(at(0, 0))
    assert first is not None
    assert first.text == "point at led_0, 1 of 3"
    assert cues.localization(at(5, 0)) is None
    second = cues.localization(at(5, 1))
    assert second is not None
    assert second.text == "point at led_1, 2 of 3"
    refused = cues.localization(Localization(stamp_ns=0, phase="refused", reason="hold more steadily"))
    assert refused is not None
    assert refused.text == "hold more steadily"
    assert cues.localization(Localization(stamp_ns=0, phase="idle")) is None


def test_progress_is_told_in_steps_from_the_first_target_to_the_end() -> None:
    def at(progress: float, **fields: Any) -> Localization:
        fields = {"phase": "sampling", "target_id": "led_0", "progress": progress, **fields}
        return Localization.model_validate({"stamp_ns": 0, **fields})

    cues = PhoneCues()
    told = [cues.localization(at(k / 1000.0)) for k in range(1001)]
    shares = [cue.progress for cue in told if cue is not None]
    assert shares[0] == 0.0
    assert shares[-1] == 1.0
    assert len(shares) == STEPS + 1
    assert [cue.text for cue in told if cue is not None and cue.text] == ["point at led_0"]
    ended = cues.localization(at(1.0, phase="solved"))
    assert ended is not None
    assert ended.progress is None
    assert ended.text == ""
    assert cues.localization(at(0.0, target_id="", ahead=("ben",))) is None  # who waits points at nothing
    assert cues.current.progress is None


def test_a_robot_that_may_be_one_of_several_is_no_step() -> None:
    cues = PhoneCues()
    candidates = tuple(
        Candidate(object_id=name, probability=share) for name, share in (("r1", 0.6), ("r2", 0.4))
    )
    meant = {"target_id": "r1", "target_count": 3, "candidates": candidates}
    cue = cues.localization(Localization.model_validate({**SAMPLING, **meant}))
    assert cue is not None
    assert cue.text == "point at r1"


def test_a_token_makes_a_phone_one_persons() -> None:
    pairing = Pairing()
    token, replaced = pairing.pair("anna", 0.0)
    assert replaced == ""
    secret = pairing.redeem(token, 1.0)
    assert secret is not None
    assert secret != token
    phone = pairing.phone(secret)
    assert phone is not None
    assert (phone.user, phone.page) == ("anna", pairing.paired("anna", 1.0))
    assert pairing.phone(token) is None
    assert pairing.phone("") is None
    assert pairing.redeem("other", 1.0) is None
    assert pairing.redeem("", 1.0) is None
    other_browsers = pairing.redeem(token, 2.0)
    assert other_browsers is not None
    assert pairing.phone(other_browsers) is phone
    assert pairing.phone(secret) is None


def test_an_unused_token_expires_a_used_ones_phone_stays() -> None:
    pairing = Pairing()
    unused, _ = pairing.pair("anna", 0.0)
    used, _ = pairing.pair("ben", 0.0)
    secret = pairing.redeem(used, 1.0)
    late_s = UNUSED_S + 1.0
    assert pairing.paired("anna", UNUSED_S - 1.0) != ""
    assert pairing.redeem(unused, late_s) is None
    assert pairing.paired("anna", late_s) == ""
    assert secret is not None
    assert pairing.phone(secret) is not None
    assert pairing.paired("ben", late_s) != ""
    assert pairing.redeem(used, late_s) is None


def test_pairing_anew_and_unpairing_revoke() -> None:
    pairing = Pairing()
    token, _ = pairing.pair("anna", 0.0)
    secret = pairing.redeem(token, 1.0)
    assert secret is not None
    page = pairing.paired("anna", 1.0)
    newer, replaced = pairing.pair("anna", 2.0)
    assert replaced == page
    assert pairing.phone(secret) is None
    assert pairing.redeem(token, 3.0) is None
    other = pairing.redeem(newer, 3.0)
    assert other is not None
    assert pairing.unpair("anna") not in ("", page)
    assert pairing.phone(other) is None
    assert pairing.paired("anna", 3.0) == ""
    assert pairing.unpair("anna") == ""


def test_the_offer_has_a_qr_code_that_a_strict_page_may_show() -> None:
    reply = offer("https://192.168.1.20:8443/phone?token=abc", "AB:CD")
    assert (reply["url"], reply["fingerprint"]) == ("https://192.168.1.20:8443/phone?token=abc", "AB:CD")
    assert reply["expires_s"] == UNUSED_S
    drawn = ET.fromstring(reply["qr_svg"])  # noqa: S314 - our own
    assert drawn.tag == "{http://www.w3.org/2000/svg}svg"
    assert all("style" not in node.attrib for node in drawn.iter())
    assert len(reply["qr_svg"]) < 16_000
