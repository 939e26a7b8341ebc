"""Hashes against those of a running ROS 2."""

from typing import Literal

import pytest

from pointit.bridges.ros2.types.definitions import Definitions
from pointit.bridges.ros2.types.rihs01 import ARRAY, BASE, NAME, SEQUENCE, Fields, Rihs01
from pointit.bridges.ros2.types.types import Types
from tests.unit.ros2.facts import definitions, golden

TEXT: Fields = [("data", (BASE, ("string", 0)))]


def computed(hashes: Rihs01, name: str) -> str:
    """Our description of a message, a service, or one of a service's halves or events."""
    if "/srv/" not in name:
        return hashes.message(name)
    service = name.partition("_Event")[0]
    if name.endswith(("_Request", "_Response")):
        return hashes.message(name)
    of_service = hashes.service(service)
    return of_service if service == name else hashes.message(name)


@pytest.mark.parametrize(("distro", "count"), [("jazzy", 296), ("kilted", 269)])
def test_every_known_hash_is_computed(distro: Literal["jazzy", "kilted"], count: int) -> None:
    extra, store = definitions(), Definitions(distro).store
    hashes = Rihs01(lambda name: extra[name] if name in extra else store.fielddefs[name][1])
    known = {name: each["hash"] for name, each in golden("hashes").items() if distro in each["in"]}
    assert len(known) == count
    assert {name: computed(hashes, name).removeprefix("RIHS01_") for name in known} == known


def test_hashes_of_an_action_are_those_of_a_running_ros_2(monkeypatch: pytest.MonkeyPatch) -> None:
    name, list_of_ints = "test_msgs/action/Fibonacci", "int32[] sequence\n"
    text = f"int32 order\n---\n{list_of_ints}---\n{list_of_ints}"

    def actions(_distro: object) -> dict[str, str]:
        return {name: text}

    monkeypatch.setattr("pointit.bridges.ros2.types.definitions.actions", actions)
    types = Types("jazzy")
    for part, expected in (
        ("SendGoal", "d807633803e38e164276573cd97e9fbd71e109c290bbf4cc312a0a1c9da7bbd9"),
        ("GetResult", "5d30fdeb21d20e117aa5f36c7b4f0b6874f1a8cf7a9c038d58f1156c5737b209"),
        ("FeedbackMessage", "37487bae8cea358366b97003c1ef1ca7ce7c08df36f9e8cca496624226aee64e"),
    ):
        assert types.kind(f"{name}_{part}").hash == f"RIHS01_{expected}"


def of(fields: Fields) -> str:
    types = {"a/msg/A": fields, "a/msg/B": TEXT}
    return Rihs01(types.__getitem__).message("a/msg/A")


@pytest.mark.parametrize(
    "other",
    [
        [],
        [("renamed", (BASE, ("string", 0)))],
        [("data", (BASE, ("string", 9)))],
        [("data", (BASE, ("wstring", 0)))],
        [("data", (NAME, "a/msg/B"))],
        [("data", (ARRAY, ((BASE, ("string", 0)), 3)))],
        [("data", (SEQUENCE, ((BASE, ("string", 0)), 3)))],
        [("data", (SEQUENCE, ((BASE, ("string", 0)), 0)))],
        [("data", (BASE, ("string", 0))), ("more", (BASE, ("bool", 0)))],
    ],
)
def test_another_definition_has_another_hash(other: Fields) -> None:
    assert of(other) != of(TEXT)


def test_what_a_hash_does_not_see() -> None:
    assert of([("data", (BASE, ("char", 0)))]) == of([("data", (BASE, ("uint8", 0)))])


def test_an_unknown_type_is_told() -> None:
    with pytest.raises(KeyError, match="a/msg/C"):
        of([("data", (NAME, "a/msg/C"))])
