"""The route table and the file that changes it."""

import re
from pathlib import Path
from typing import Any

import pytest

from pointit.bridges.ros2.outbound.table import CLOCK_S
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.frames import Frames, RosNames
from pointit.bridges.ros2.routing.route_types import ServiceRoute
from pointit.bridges.ros2.routing.routes import Routes, routes
from pointit.runtime.bus.site_clock import SILENT_NS
from pointit.runtime.errors import ConfigError
from pointit.schemas import NS_PER_S
from pointit.schemas.topics import Request, Topic
from tests.unit.ros2.scenes import jazzy


@pytest.fixture(scope="module")
def table() -> Routes:
    return routes()


def test_names_are_apart_and_resolve(table: Routes) -> None:
    names = [row.name for row in table.all]
    assert len(set(names)) == len(names)
    scene = ConversionState(jazzy())
    for row in table.all:
        found = row.ros_name(scene, "3d-printer.1")
        assert re.fullmatch(r"(/[A-Za-z_][A-Za-z0-9_]*)+", found), found


def test_placeholders_are_those_of_what_a_row_stands_for(table: Routes) -> None:
    stands_for: list[tuple[str, tuple[Topic[Any] | Request[Any, Any], ...]]] = [
        *((row.ros, row.reads) for row in table.outward),
        *((row.ros, row.into) for row in table.inward),
        *((row.ros, (row.request,)) for row in table.served),
    ]
    for ros, ours in stands_for:
        if "{" in ros:
            assert {"{" + each.placeholder + "}" for each in ours} == {
                ros[ros.index("{") : ros.index("}") + 1]
            }


def test_every_type_is_known_with_its_hash(table: Routes) -> None:
    for row in table.all:
        assert jazzy().kind(row.type).hash.startswith("RIHS01_")
        assert ("/srv/" in row.type) == isinstance(row, ServiceRoute)


def test_what_is_latched_and_what_gives_way(table: Routes) -> None:
    latched = {row.name for row in table.outward if row.qos.latched}
    assert {"button", "state_transition", "selected_packages", "tf_static", "map_markers"} <= latched
    assert "packages" not in latched
    both = {row.ros for row in table.outward} & {row.ros for row in table.inward}
    gives_way = {row.ros for row in table.outward if row.yields}
    theirs = {row.ros for row in table.outward if row.is_theirs}
    for_guests = {row.ros for row in table.inward if row.of_guests}
    # frames are published beside those of others, each its own; what is taken of guests is not said of them
    assert both - {"/tf", "/tf_static"} <= gives_way | (theirs & for_guests)
    assert for_guests <= theirs
    assert all(row.yields for row in table.served)


def test_a_file_changes_routes(tmp_path: Path) -> None:
    path = tmp_path / "routes.yaml"
    path.write_text(
        "prefix: /site1\nworld: map\nperson: '{user}/base'\nkinds: [box]\nroutes:\n"
        "  pointing_ray: {ros: '/{user}/ray', rate_hz: 5, frame: odom}\n"
        "  rotation_in: {enabled: false}\n"
    )
    table = routes(path)
    rows = {row.name: row for row in table.all}
    scene = ConversionState(jazzy(), world=table.file.world, person=table.file.person, kinds=table.file.kinds)
    ray = next(row for row in table.outward if row.name == "pointing_ray")
    assert (ray.ros, ray.rate_hz) == ("/{user}/ray", 5)
    assert scene.frames.resolve(ray.frame, "anna") == "odom"
    assert scene.frames.resolve(rows["pose"].frame, "anna") == "map"
    assert scene.frames.person("anna") == "anna/base"
    assert not rows["rotation_in"].enabled
    assert rows["rotation"].enabled
    assert rows["packages"].ros == "/site1/packages"
    assert (rows["tf"].ros, rows["rosout"].ros) == ("/tf", "/rosout")
    assert scene.kinds.kind(0) == "box"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("routes: {pointing_rey: {rate_hz: 5}}", "did you mean pointing_ray"),
        ("routes: {pose: {ros: '/pose'}}", r"routes.pose.ros: write {user} into it"),
        ("routes: {packages: {ros: '/{user}/packages'}}", "leave { } out"),
        ("routes: {packages: {ros: 'packages'}}", "begin with /"),
        ("routes: {packages: {ros: '/7packages'}}", "begin with /"),
        ("routes: {pose: {ros: '/{user}/{user}'}}", "at most one"),
        ("routes: {pose: {rate_hz: 0}}", "must be above 0"),
        ("routes: {pose: {rate: 5}}", "no parameter rate"),
        ("routes: {pose: {frame: '/map'}}", "no leading /"),
        ("routes: {pose: {enabled: maybe}}", "true or false"),
        ("routes: {add_pack: {rate_hz: 5}}", "a service has none"),
        ("routes: {packages: {ros: /pointers}}", "'/pointers' is that of packages already"),
        ("routes: {packages: {ros: /tf}}", "'/tf' is that of tf already"),
        ("prefix: site1", "begin with /"),
        ("world: '{user}/map'", "leave {user} out"),
        ("person: human", "write {user}"),
        ("kinds: []", "kinds"),
        ("[1, 2]", "mapping"),
    ],
)
def test_a_wrong_file_is_refused_in_one_sentence(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "routes.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=re.escape(told)) as caught:
        routes(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_a_switched_off_route_frees_its_name(tmp_path: Path) -> None:
    path = tmp_path / "routes.yaml"
    path.write_text("routes: {packages: {ros: /pointers}, pointers: {enabled: false}}")
    assert {row.ros for row in routes(path).outward if row.name == "packages"} == {"/pointers"}


def test_people_whose_names_ros_cannot_have_stay_apart() -> None:
    names = RosNames()
    made = [names.of(name) for name in ("anna-b", "anna.b", "anna_b", "7", "anna-b")]
    assert made == ["anna_b", "anna_b_2", "anna_b_3", "_7", "anna_b"]
    frames = Frames(names)
    assert frames.person("anna.b") == "anna_b_2/human_footprint"
    assert frames.resolve("{world}", "anna.b") == "world"


def test_ros_and_the_site_agree_on_when_a_clock_has_ended() -> None:
    assert CLOCK_S * NS_PER_S == SILENT_NS
