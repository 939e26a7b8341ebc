"""Selection of lamps, and a map that changes while a person points at them."""

from typing import Literal

import pytest

from pointit.schemas import NS_PER_S, Environment, Lamp, Localization
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation.estimator import SAME_PLACE_M, Refusal
from pointit.services.localizer.pose_manager import PoseManager, Response
from pointit.services.localizer.procedures.lamps import lamps_for_pose, map_change_reason
from tests.unit.localizer.person import START_NS, config

A, B, C = (
    Lamp(id="a", position_m=(3.0, 2.0, 0.1)),
    Lamp(id="b", position_m=(-3.0, 2.5, 0.9)),
    Lamp(id="c", position_m=(-2.5, -3.0, 2.0)),
)

AT_ORIGIN = Lamp(id="zero", position_m=(0.0, 0.0, 0.1))


def at(lamp: Lamp, x_m: float = 0.0, z_m: float = 0.0, name: str = "") -> Lamp:
    x, y, z = lamp.position_m
    return Lamp(id=name or f"{lamp.id}2", position_m=(x + x_m, y, z + z_m))


def room(*lamps: Lamp) -> Environment:
    return Environment(stamp_ns=0, name="lab", lamps=lamps)


NEEDS = "needs two at different places"


@pytest.mark.parametrize(
    ("lamps", "choice", "sentence"),
    [
        ((A, B), config(), ""),
        ((A,), config(), NEEDS),
        (tuple(at(A, 1e-6 * n, name=f"led_{n}") for n in range(5)), config(order="informative"), NEEDS),
        ((A, at(A, 0.04)), config(order="informative"), NEEDS),
        ((A, at(A, 0.06)), config(order="informative"), ""),
        ((AT_ORIGIN, at(AT_ORIGIN, SAME_PLACE_M)), config(), ""),  # exactly at the limit
        ((A, at(A), B), config(targets=2), NEEDS),
        ((A, at(A), B), config(), ""),
        ((A, at(A), B), config(order="informative", targets=2), ""),
        ((A, at(A, 0.04, 1.0)), config(order="informative"), "above one another"),
        ((A, at(A, 0.0, 1.0), B), config(targets=2), "above one another"),
    ],
)
def test_lamps_that_can_tell_no_pose_are_refused_at_once(
    lamps: tuple[Lamp, ...], choice: LocalizerConfig, sentence: str
) -> None:
    result = lamps_for_pose(room(*lamps), choice)
    if sentence:
        assert isinstance(result, Refusal)
        assert sentence in result.reason
        assert "; " not in result.reason or result.reason.count(";") == 1
    else:
        assert result == list(lamps)


def test_configured_lamps_come_in_their_order() -> None:
    assert lamps_for_pose(room(A, B, C), config(lamps=("c", "a"))) == [C, A]


def test_the_choice_is_that_of_the_configuration() -> None:
    locating = PoseManager("anna", LocalizerConfig(method="static_targets", order="given", targets=2))
    locating.begin(START_NS)
    locating.on_map(room(A, at(A), B), START_NS)
    assert isinstance(locating.start(None, START_NS), Refusal)


def test_map_change_reason_names_lamps_that_left_or_moved() -> None:
    assert map_change_reason([A, B], room(B, A, C)) == ""
    assert map_change_reason([A, B], room(A, at(B, 0.04, name="b"))) == ""
    assert map_change_reason([A, B], room(A, at(B, 0.06, name="b"))) == "lamp b moved by 0.06 m"
    assert map_change_reason([A, B], room(B)) == "lamp a left"


def localizing(procedure: Literal["pose", "anchor"]) -> PoseManager:
    """Return one that points at a, or may."""
    config = LocalizerConfig(position_m=(0.5, 0.5, 0.0))
    locating = PoseManager("anna", config)
    locating.begin(START_NS)
    locating.on_map(room(A, B, C), START_NS)
    if procedure == "pose":
        answer = locating.start("static_targets", START_NS)
    else:
        answer = locating.point_anchor("a", START_NS)
    assert isinstance(answer, Response)
    return locating


@pytest.mark.parametrize("procedure", ["pose", "anchor"])
@pytest.mark.parametrize("lamps", [(B, C), (at(A, 0.5, name="a"), B, C), ()])
def test_a_map_that_changes_ends_it_with_a_sentence(
    procedure: Literal["pose", "anchor"], lamps: tuple[Lamp, ...]
) -> None:
    locating = localizing(procedure)
    (news,) = locating.on_map(room(*lamps), START_NS + NS_PER_S)
    assert not locating.is_busy
    assert isinstance(news, Localization)
    assert news.phase == "cancelled"
    assert news.reason.startswith("the map changed while anna was pointing at its lamps: lamp a ")
    assert news.reason.endswith("; start again")


def test_a_map_that_changes_elsewhere_is_taken() -> None:
    locating = localizing("pose")
    assert locating.on_map(room(A, B, C, at(C)), START_NS) == []
    assert locating.is_busy
    locating = localizing("anchor")
    assert locating.on_map(room(A), START_NS) == []
    assert locating.is_busy
