"""The tree of routers, people over hosts, and the processes at each machine."""

import pytest

from pointit_lab.loadtest.layout import Load, host_groups
from pointit_lab.loadtest.network.tree import router_of, spread, tree


def load(*, central: bool) -> Load:
    return Load(
        rate_hz=100.0,
        duration_s=1.0,
        layout="one",
        shards=1,
        router="pointit",
        secured=False,
        site="lab",
        connect=(),
        hosts=2,
        routers=3,
        fan=2,
        central=central,
    )


@pytest.mark.parametrize("hosts", [1, 2, 5, 8])
@pytest.mark.parametrize("routers", [1, 2, 4, 9])
@pytest.mark.parametrize("fan", [1, 2, 32])
def test_every_machine_reaches_the_root_and_no_router_has_more_than_fan_below(
    hosts: int, routers: int, fan: int
) -> None:
    machines = tree(hosts, routers, fan)
    assert sum(machine.has_people for machine in machines) == hosts
    assert sum(machine.has_router for machine in machines) == routers
    assert len({machine.name for machine in machines}) == len(machines)
    for index, machine in enumerate(machines):
        assert machines[router_of(machines, index)].has_router
        assert machine.uplink < max(1, index)
    below = [machine.uplink for machine in machines[1:] if machine.has_router]
    assert all(below.count(uplink) <= fan for uplink in below)


def test_two_hosts_of_a_campus_are_below_their_buildings() -> None:
    machines = tree(2, 5, 2)
    assert [(machine.name, machine.uplink) for machine in machines] == [
        ("above 1", 0),
        ("above 2", 0),
        ("above 3", 0),
        ("host 1", 1),
        ("host 2", 1),
    ]


def test_hosts_without_a_router_share_those_of_others() -> None:
    machines = tree(4, 2, 32)
    assert [router_of(machines, index) for index in range(4)] == [0, 1, 0, 1]


def test_people_are_spread_evenly_over_hosts_only() -> None:
    names = [f"load{index}" for index in range(5)]
    assert spread(names, tree(2, 3, 2)) == {1: ["load0", "load2", "load4"], 2: ["load1", "load3"]}


def test_shards_serve_the_people_of_their_host_and_are_observed_there() -> None:
    made = host_groups(load(central=False), 3, tree(2, 3, 2))
    assert [[group.name for group in groups] for groups in made.values()] == [
        ["site", "people 1"],
        ["people 2"],
    ]
    (site, first), (second,) = made.values()
    assert {"pui", "selector", "led-driver"} <= {launch.instance for launch in site.launches}
    assert (site.watched, site.watches_light) == ([], True)
    for group, name, people in ((first, "host1", ("load0", "load2")), (second, "host2", ("load1",))):
        shards = {launch.instance: launch for launch in group.launches if not launch.user}
        assert set(shards) == {f"pui.{name}", f"selector.{name}"}
        assert all(launch.config.model_dump()["people"] == people for launch in shards.values())
        assert tuple(group.wrists) == tuple(group.watched) == people


def test_a_central_load_is_observed_at_the_site() -> None:
    (site, first), (second,) = host_groups(load(central=True), 3, tree(2, 3, 2)).values()
    assert set(site.watched) == {"load0", "load1", "load2"}
    assert all(launch.user for group in (first, second) for launch in group.launches)
    assert not first.watched


def test_a_host_without_people_has_no_process() -> None:
    made = host_groups(load(central=True), 1, tree(2, 2, 32))
    assert [len(groups) for groups in made.values()] == [2, 0]
