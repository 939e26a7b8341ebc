"""Body measures: from the stature, given, seated, and what is refused."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.runtime.config.config import Layers
from pointit.runtime.errors import ConfigError
from pointit.schemas import BodyMeasures
from pointit.services.supervisor.config import DEFAULT_STATURE_M, SupervisorConfig, measures
from pointit.services.supervisor.service import profile


def configured(**values: object) -> SupervisorConfig:
    layers = Layers()
    layers.add({"profile": values}, "anna.yaml")
    return layers.build(SupervisorConfig)


def test_default_measures_are_the_common_ones() -> None:
    assert profile(configured().profile, 1).body == BodyMeasures()


@given(st.floats(0.9, 2.5))
def test_lengths_grow_with_the_stature(stature_m: float) -> None:
    body = measures(stature_m, {})
    common = BodyMeasures()
    for name, value in common.model_dump().items():
        assert math.isclose(getattr(body, name), value * stature_m / 1.835, abs_tol=1e-12)


def test_measured_lengths_replace_those_of_the_stature() -> None:
    sent = profile(configured(stature_m=1.5, body={"wrist_to_finger_m": 0.2}).profile, 1)
    assert sent.body.wrist_to_finger_m == 0.2
    assert sent.body.footprint_to_neck_m == pytest.approx(1.43 * 1.5 / 1.835)


def test_seated_people_are_lower_by_legs_less_the_seat() -> None:
    # 0.48 of the stature is below the seat of somebody who stands
    seated = measures(1.835, {}, seated=True, seat_height_m=0.45)
    assert seated.footprint_to_neck_m == pytest.approx(1.43 - 0.48 * 1.835 + 0.45)
    assert seated.neck_to_eyes_m == 0.21
    own = measures(1.6, {}, seated=True)
    assert own.footprint_to_neck_m == pytest.approx(1.43 * 1.6 / 1.835 - (0.48 - 0.247) * 1.6)


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"seat_height_m": 0.5}, "set seated, or leave it out"),
        ({"seated": True, "body": {"footprint_to_neck_m": 1.1}}, "and seated exclude each other"),
        ({"body": {"shoulder_to_wrist_m": 0.05}}, "does not reach past eyes 0.21 m from the shoulder"),
        ({"stature_m": 3.0}, "profile.stature_m: must be at most 2.5"),
        ({"stature_m": 183.5}, "profile.stature_m: must be at most 2.5"),
        ({"ray_model": "finger"}, "profile.ray_model"),
    ],
)
def test_contradictions_are_refused_in_one_sentence(values: dict[str, object], sentence: str) -> None:
    with pytest.raises(ConfigError, match=r"^anna\.yaml: profile") as error:
        configured(**values)
    assert sentence in str(error.value)
    assert "\n" not in str(error.value)


def test_short_arm_is_accepted_when_it_points_along_itself() -> None:
    body = measures(DEFAULT_STATURE_M, {"shoulder_to_wrist_m": 0.05}, ray_model="shoulder_arm")
    assert body.shoulder_to_wrist_m == 0.05
