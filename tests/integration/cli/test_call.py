"""`pointit service call` and `pointit person press` against a real bus, in processes of their own."""

import json
from typing import Any

import pytest
import yaml
from click.testing import CliRunner

from pointit.cli.main import command
from pointit.runtime.errors import RefusedError
from pointit.schemas import AddPackage, AddPackageReply, ButtonEvent, Done, SetPose, SetSpeed
from pointit.schemas.topics import ADD_PACKAGE, BUTTON, REQUESTS, SET_POSE, SET_SPEED
from pointit.services.supervisor.service import Supervisor
from tests.support.bench import until
from tests.support.cli_site import Site


async def test_it_asks_and_prints_the_answer(site: Site) -> None:
    asked: list[Any] = []

    async def set_speed(query: SetSpeed, _name: str) -> Done:
        asked.append(query)
        return Done(message=f"the speed is {query.speed_mps} m/s")

    async def set_pose(query: SetPose, user: str) -> Done:
        asked.append((user, query))
        return Done()

    async def add(query: AddPackage, _name: str) -> AddPackageReply:
        asked.append(query)
        return AddPackageReply(object_id="p7")

    site.bus.serve(SET_SPEED, set_speed)
    site.bus.serve(SET_POSE, set_pose)
    site.bus.serve(ADD_PACKAGE, add)
    ended = await site.pointit("service", "call", "conveyor/set_speed", "speed_mps=-0.5")
    assert (ended.code, ended.out, ended.err) == (0, "the speed is -0.5 m/s\n", "")

    ended = await site.pointit(
        "service", "call", "localizer/anna/set_pose", "position_m=[1, 2, 0]", "yaw_rad=1"
    )
    assert (ended.code, ended.out) == (0, "done\n")

    ended = await site.pointit("service", "call", "conveyor/add_package", "kind=7")
    assert (ended.code, ended.out.splitlines()[0]) == (0, "done")
    assert yaml.safe_load(ended.out.splitlines()[1]) == {"object_id": "p7"}

    ended = await site.pointit("service", "call", "conveyor/add_package", "kind=no", "lane=left", "--json")
    assert json.loads(ended.out) == {"key": "conveyor/add_package", "message": "", "object_id": "p7"}
    assert asked == [
        SetSpeed(speed_mps=-0.5),
        ("anna", SetPose(position_m=(1.0, 2.0, 0.0), yaw_rad=1.0)),
        AddPackage(kind="7"),
        AddPackage(kind="no", lane="left"),
    ]


async def test_a_refusal_and_no_answer_are_one_sentence_each(site: Site) -> None:
    async def refuse(_query: SetSpeed, _name: str) -> Done:
        raise RefusedError("the conveyor is locked")

    site.bus.serve(SET_SPEED, refuse)
    ended = await site.pointit("service", "call", "conveyor/set_speed", "speed_mps=1")
    assert (ended.code, ended.out, ended.err) == (1, "", "Error: the conveyor is locked\n")
    ended = await site.pointit("service", "call", "localizer/anna/start", "--timeout", "0.5", code=1)
    assert ended.err.startswith("Error: localizer does not answer")
    assert ended.err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("conveyor/set_sped", "speed_mps=1"), "did you mean conveyor/set_speed"),
        (("zzz",), "`pointit service call` lists all requests"),
        (("users/anna/imu",), "is a topic (orientation of the arm)"),
        (("localizer/*/start",), "user '*': use 1 to 64"),
        (("conveyor/set_speed",), "conveyor/set_speed: speed_mps is missing: write speed_mps=VALUE, float"),
        (("conveyor/set_speed", "speed_mps=9"), "speed_mps: must be at most 5 (got"),
        (("conveyor/set_speed", "speed_mps=.nan"), "speed_mps: "),
        (("conveyor/set_speed", "speed=1"), "no field 'speed'; did you mean speed_mps?"),
        (("localizer/anna/start", "by=1"), "localizer/anna/start: no field 'by'"),
        (("conveyor/set_speed", "speed_mps"), "'speed_mps': write FIELD=VALUE"),
        (("conveyor/set_speed", "speed_mps=1", "speed_mps=2"), "speed_mps is given twice"),
        (("localizer/anna/set_pose", "position_m=[1, 2"), "position_m=[1, 2: is not a value"),
    ],
)
def test_wrong_arguments_of_a_call_are_named_without_connecting(
    arguments: tuple[str, ...], said: str
) -> None:
    result = CliRunner().invoke(command, ["service", "call", *arguments, "--connect", "tcp/127.0.0.1:1"])
    assert result.exit_code == 2
    assert said in result.output
    assert result.output.count("\n") == 1


def test_alone_it_lists_what_can_be_asked() -> None:
    rows = json.loads(CliRunner().invoke(command, ["service", "call", "--json"]).output)["requests"]
    assert {row["key"] for row in rows} == {request.key for request in REQUESTS}
    (speed,) = (row for row in rows if row["field"] == "speed_mps")
    assert (speed["type"], speed["unit"], speed["range"], speed["default"]) == (
        "float",
        "m/s",
        "from -5 to 5",
        "required",
    )
    fields = {(request.key, field) for request in REQUESTS for field in request.query.model_fields}
    assert fields <= {(row["key"], row["field"]) for row in rows}


async def test_a_button_pressed_from_another_process(site: Site) -> None:
    buttons: list[ButtonEvent] = []
    site.bus.subscribe(BUTTON, lambda event, _user: buttons.append(event), "anna")
    ended = await site.pointit("person", "press", "anna", code=1)
    assert ended.err.startswith("Error: anna has no supervisor: ")
    site.start(Supervisor, "anna")
    await site.arrived("supervisor.anna")
    ended = await site.pointit("person", "press", "anna", "--gesture", "hold", "--json", code=0)
    answer = json.loads(ended.out)
    assert (answer["user"], answer["state"]) == ("anna", "idle")
    assert "not known" in answer["reason"]
    await until(lambda: [event.gesture for event in buttons] == ["hold"])
    assert (await site.pointit("person", "press", "an/na")).code == 2
