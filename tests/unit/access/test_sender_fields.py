"""Fields in which a person can name others: each has a row in the documents, and false ones do nothing."""

import fnmatch
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pointit.access.rights import rights_of
from pointit.schemas import Configuration, Deployment, Health, Message, ServedRequest
from pointit.schemas.base import NAME_PATTERN
from pointit.schemas.system import ExpectedService, split_instance
from pointit.schemas.topics import TOPICS

SECURITY = Path(__file__).parents[3] / "docs/explanation/security.md"
OWN = Health(stamp_ns=1, service="pui", instance="pui.guest", pid=1, user="guest")
COMPARED: list[Message] = [
    OWN,
    Configuration(stamp_ns=1, service="pui", instance="pui.guest", user="guest"),
    ServedRequest(stamp_ns=1, service="pui", instance="pui.guest", request="a", query="{}"),
]
OTHERS = {"service": "selector", "instance": "pui.anna", "user": "anna"}


def name_fields() -> Iterator[str]:
    """Yield the fields, with their messages, in which a person writes the name of a part of the site."""
    writes = rights_of("user", "guest").writes
    for topic in TOPICS:
        if not any(fnmatch.fnmatch(key, re.sub(r"{\w+}", "*", topic.key)) for key in writes):
            continue
        for name, info in topic.message.model_fields.items():
            if any(NAME_PATTERN in str(getattr(each, "pattern", "")) for each in _metadata(info)):
                yield f"{topic.message.__name__}.{name}"


def _metadata(info: Any) -> Iterator[Any]:
    for each in info.metadata:
        yield each
        yield from getattr(each, "__dict__", {}).values() if hasattr(each, "__dict__") else ()


def test_each_field_with_a_name_has_a_row() -> None:
    fields = set(name_fields())
    assert {"Health.instance", "Goal.robot", "Hover.taken_by"} <= fields
    table = SECURITY.read_text()
    assert {field for field in fields if f"`{field}`" not in table} == set()


@pytest.mark.parametrize("message", COMPARED, ids=lambda message: type(message).__name__)
def test_name_of_another_in_each_field_contradicts_the_key(message: Message) -> None:
    assert not message.contradiction("pui.guest")
    for field, value in OTHERS.items():
        if field in type(message).model_fields:
            assert (
                message.model_copy(update={field: value}).contradiction("pui.guest")
                == f"states the {field} {value}"
            )


@pytest.mark.parametrize("instance", ["router-hall", "pui", "selector.shard1", "imu-bridge.anna"])
def test_names_that_services_have_contradict_nothing(instance: str) -> None:
    service, owner = split_instance(instance)
    service = "router" if service.startswith("router") else service
    for user in ("", owner):
        health = OWN.model_copy(update={"service": service, "instance": instance, "user": user})
        assert not health.contradiction(instance)


def test_deployment_of_a_person_states_services_of_no_other() -> None:
    services = tuple(ExpectedService(service="pui", user=user) for user in ("guest", "anna"))
    stated = Deployment(stamp_ns=1, name="anna", services=services)
    assert [service.user for service in stated.believed("guest").services] == ["guest"]
