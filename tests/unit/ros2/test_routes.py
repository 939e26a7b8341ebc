"""The route table, the file that changes it, its documentation, and numbers for names."""

import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import get_types_from_msg

from pointit.bridges.ros2.routing import names as ros_names
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.names import Frames, RosNames
from pointit.bridges.ros2.routing.routes import Routes, routes
from pointit.bridges.ros2.routing.uids import MAX_NUMBER, Kinds, Uids
from pointit.bridges.ros2.types.definitions import Definitions
from pointit.runtime.errors import ConfigError
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
        if "{" in ros and ours:  # one route only adds to what another one publishes
            assert {"{" + each.placeholder + "}" for each in ours} == {
                ros[ros.index("{") : ros.index("}") + 1]
            }


def test_latched_and_yielding_routes_are_listed(table: Routes) -> None:
    latched = {row.name for row in table.outward if row.qos.latched}
    assert {"button", "state_transition", "selected_packages", "tf_static", "map_markers"} <= latched
    assert "packages" not in latched
    # of what comes too fast, the newest of each name is sent
    assert {row.name for row in table.outward if row.is_each} >= {"tf", "diagnostics", "rosout"}
    both = {row.ros for row in table.outward} & {row.ros for row in table.inward}
    gives_way = {row.ros for row in table.outward if row.yields}
    theirs = {row.ros for row in table.outward if row.has_user_publisher}
    for_guests = {row.ros for row in table.inward if row.of_ros_users}
    # frames are published beside those of others, each its own; what is taken of guests is not said of them
    assert both - {"/tf", "/tf_static"} <= gives_way | (theirs & for_guests)
    assert for_guests <= theirs
    assert all(row.yields for row in table.served)


def test_file_changes_routes_and_disabled_ones_free_their_names(tmp_path: Path) -> None:
    path = tmp_path / "routes.yaml"
    path.write_text(
        "prefix: /site1\nworld: map\nroutes:\n"
        "  pointing_ray: {ros: '/{user}/ray', rate_hz: 5}\n"
        "  rotation_in: {enabled: false}\n"
        "  selected_packages: {ros: /site1/pointers}\n"
        "  pointers: {enabled: false}\n"
    )
    table = routes(path)
    rows = {row.name: row for row in table.all}
    scene = ConversionState(jazzy(), world=table.file.world)

    ray = next(row for row in table.outward if row.name == "pointing_ray")
    assert (ray.ros, ray.rate_hz) == ("/{user}/ray", 5)
    assert scene.frames.resolve(rows["pose"].frame, "anna") == "map"
    assert scene.frames.resolve(ray.frame, "anna") == scene.frames.person("anna") == "anna/human_footprint"
    assert (rows["rotation_in"].enabled, rows["rotation"].enabled) == (False, True)
    assert (rows["packages"].ros, rows["selected_packages"].ros) == ("/site1/packages", "/site1/pointers")
    assert (rows["tf"].ros, rows["rosout"].ros) == ("/tf", "/rosout")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("routes: {pointing_rey: {rate_hz: 5}}", "did you mean pointing_ray"),
        ("routes: {pose: {ros: '/pose'}}", r"routes.pose.ros: write {user} into it"),
        ("routes: {packages: {ros: '/{user}/packages'}}", "leave { } out"),
        ("routes: {packages: {ros: 'packages'}}", "begin with /"),
        ("routes: {pose: {ros: '/{user}/{user}'}}", "at most one"),
        ("routes: {pose: {rate_hz: 0}}", "must be above 0"),
        ("routes: {pose: {rate: 5}}", "no parameter rate"),
        ("routes: {add_pack: {rate_hz: 5}}", "a service has none"),
        ("routes: {packages: {ros: /pointers}}", "'/pointers' is that of packages already"),
        ("routes: {packages: {ros: /tf}}", "'/tf' is that of tf already"),
        ("prefix: site1", "begin with /"),
        ("world: '{user}/map'", "no { }"),
        ("world: /map", "no leading /"),
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


def test_people_whose_names_ros_cannot_have_stay_apart() -> None:
    names = RosNames()
    made = [names.of(name) for name in ("anna-b", "anna.b", "anna_b", "7", "anna-b")]
    assert made == ["anna_b", "anna_b_2", "anna_b_3", "_7", "anna_b"]
    frames = Frames(names)
    assert frames.person("anna.b") == "anna_b_2/human_footprint"
    assert frames.resolve("{world}", "anna.b") == "world"


def test_oldest_ros_names_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ros_names, "MAX_FRAME_NAMES", 2)
    names = RosNames()
    assert [names.of(name) for name in ("a-b", "a.b", "c")] == ["a_b", "a_b_2", "c"]
    assert [names.of(name) for name in ("a_b", "a.b")] == ["a_b", "a_b_2"]


DOCS = Path(__file__).parents[3] / "docs"
TEXT = (DOCS / "reference/ros2.md").read_text(encoding="utf-8")
PROPOSAL = (DOCS / "explanation/pointing-messages-proposal.md").read_text(encoding="utf-8")


def test_every_route_is_documented_and_no_other() -> None:
    rows = [line.split("|") for line in TEXT.splitlines() if line.startswith("| `") and line.count("|") == 5]
    told = {tuple(cell.strip(" `") for cell in row[1:4]): "|".join(row) for row in rows}
    routes_of = routes(ros4hri=True).all
    names = {
        (route.name, route.ros, route.type.replace("/msg/", "/").replace("/srv/", "/")): route
        for route in routes_of
    }
    assert told.keys() == names.keys()
    for key, route in names.items():
        assert ("yields" in told[key]) is route.yields
        assert ("off by default" in told[key]) is not route.enabled


def test_proposed_messages_are_valid_definitions() -> None:
    texts = dict(
        re.findall(r"^## (hri_msgs/msg/\w+)\n\n```text\n(.+?)```", PROPOSAL, re.MULTILINE | re.DOTALL)
    )
    store = Definitions("jazzy").store
    for name, text in texts.items():
        store.register(get_types_from_msg(text, name))
    assert len(texts) == 3
    for name in texts:
        assert store.hash_rihs01(name).startswith("RIHS01_")


def test_digits_are_kept_where_they_are_free() -> None:
    uids = Uids()
    assert uids.number("package12") == 12
    assert uids.number("19a1-12") != 12
    assert uids.number("package12") == 12
    assert uids.number("robot") != uids.number("drone")
    assert uids.number("a-4294967296") <= MAX_NUMBER
    assert Uids(255).number("strip-300") <= 255
    assert Uids(255).number("strip-255") == 255


@given(st.lists(st.text(max_size=12) | st.integers(0, 30).map(lambda n: f"p{n}"), max_size=60))
def test_numbers_are_stable_and_apart(names: list[str]) -> None:
    uids = Uids()
    numbers = {name: uids.number(name) for name in names}
    assert len(set(numbers.values())) == len(numbers)
    for name, number in numbers.items():
        assert uids.number(name) == number
        assert 0 <= number <= MAX_NUMBER


@given(
    st.lists(
        st.tuples(st.sampled_from(("number", "bind")), st.integers(0, 9), st.integers(0, 9)), max_size=80
    )
)
def test_numbers_and_names_agree_after_any_binding(steps: list[tuple[str, int, int]]) -> None:
    uids = Uids(max_number=9, max_names=6)
    for what, number, who in steps:
        name = f"p{who}"
        if what == "bind":
            uids.bind(number, name)
            assert uids.number(name) == number
        uids.number(name)
        assert {number: name for name, number in uids._numbers.items()} == uids._names


def test_reserved_number_goes_to_the_next_new_name() -> None:
    uids = Uids()
    uids.number("old-1")
    uids.reserve(7)
    assert uids.is_settled("old-1")
    assert not uids.is_settled("new-2")
    uids.bind(7, "new-2")
    uids.end_reservation(7)
    assert uids.is_settled("other-3")
    assert uids.number("new-2") == 7
    uids.bind(1, "new-2")  # takes it from the other, and leaves its own
    assert (uids.number("new-2"), uids.number("third-7")) == (1, 7)
    assert uids.number("old-1") != 1


def test_oldest_names_are_forgotten_and_all_numbers_used_before_reuse() -> None:
    uids = Uids(max_names=3)
    for name in ("a1", "b2", "c3", "a1", "d4"):
        uids.number(name)
    assert uids._names == {1: "a1", 3: "c3", 4: "d4"}
    uids = Uids(max_number=9)
    assert {uids.number(f"p{chr(97 + n)}") for n in range(10)} == set(range(10))
    assert uids.number("one more") in range(10)


def test_kinds_have_numbers_and_back() -> None:
    kinds = Kinds(("blue", "red", "blue"))
    assert [kinds.number(kind) for kind in ("blue", "red", "pink")] == [0, 1, Kinds.OTHER]
    assert [kinds.kind(number) for number in (0, 1, 2, 3, 255, -1)] == ["blue", "red", "blue", *[None] * 3]
