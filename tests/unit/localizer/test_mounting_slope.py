"""Messages about the mounting by the slope of the elevations."""

import dataclasses

import pytest

from pointit.services.localizer.estimation import mounting
from pointit.services.localizer.estimation.estimator import Refusal, SolverSettings
from pointit.services.localizer.estimation.mounting import Slope, mounting_fault
from tests.unit.localizer.person import solved
from tests.unit.localizer.test_mounting_fault import TURNS, following

SURE = Slope(value=0.0, sigma=0.05, freedom=18.0, sideways_rad=0.03)
"""Slope of a sensor across the arm, in a window of 10 s."""


def said(monkeypatch: pytest.MonkeyPatch, slope: Slope, *, is_refused: bool = False) -> str:
    """Return the message about `slope` with accepted or refused rays."""
    gathered = following(1, TURNS["along"])

    def measured(*_: object, independent: float) -> Slope:
        del independent
        return slope

    monkeypatch.setattr(mounting, "mounting_slope", measured)
    result = Refusal("the rays miss", 0.3) if is_refused else solved(gathered)
    return mounting_fault(gathered, result, SolverSettings(), 0.0)


@pytest.mark.parametrize(("value", "how"), [(0.2, "across"), (-0.4, "across"), (-0.6, "backwards on")])
@pytest.mark.parametrize("is_refused", [False, True])
def test_recorded_slopes_are_told_apart(
    monkeypatch: pytest.MonkeyPatch, value: float, how: str, *, is_refused: bool
) -> None:
    """People's arms with a sensor across them have slopes of -0.6 to 0.5, backwards of -1 to -0.6."""
    fault = said(monkeypatch, dataclasses.replace(SURE, value=value), is_refused=is_refused)
    assert f"seems to be mounted {how} the arm" in fault


@pytest.mark.parametrize(("freedom", "is_wrong"), [(2.0, False), (18.0, True)])
def test_few_pointings_need_a_wider_margin(
    monkeypatch: pytest.MonkeyPatch, freedom: float, *, is_wrong: bool
) -> None:
    slope = dataclasses.replace(SURE, value=0.2, sigma=0.2, freedom=freedom)
    assert slope.is_wrong == is_wrong
    assert ("seems to be mounted" in said(monkeypatch, slope)) == is_wrong


@pytest.mark.parametrize(
    ("sigma", "value", "is_told"), [(0.2, 0.6, True), (0.3, 0.6, False), (0.2, 0.8, False)]
)
def test_slope_that_is_uncertain_is_no_reason_for_doubt(
    monkeypatch: pytest.MonkeyPatch, sigma: float, value: float, *, is_told: bool
) -> None:
    slope = dataclasses.replace(SURE, value=value, sigma=sigma)
    fault = said(monkeypatch, slope)
    assert ("the rays rise and sink only 0.6 times as much as the robot" in fault) == bool(fault) == is_told
    assert said(monkeypatch, slope, is_refused=True) == ""  # then the rays miss for another reason


@pytest.mark.parametrize(
    "aside", [{"freedom": mounting.FOLLOWS_FREEDOM - 0.1, "sigma": 0.01}, {"sideways_rad": 0.1}]
)
def test_refused_rays_are_blamed_on_the_sensor_only_if_their_azimuths_follow(
    monkeypatch: pytest.MonkeyPatch, aside: dict[str, float]
) -> None:
    slope = dataclasses.replace(SURE, **aside)
    assert "seems to be mounted across" in said(monkeypatch, slope)
    assert said(monkeypatch, slope, is_refused=True) == ""
