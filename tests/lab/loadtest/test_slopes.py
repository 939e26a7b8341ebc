"""Slopes: exact without scatter, honest with it, and silent where nothing can be known."""

from dataclasses import replace

import numpy as np
import pytest

from pointit_lab.loadtest.layout import LoadParameters, host_groups
from pointit_lab.loadtest.load_result import LoadResult, Usage
from pointit_lab.loadtest.network.tree import router_of, spread, tree
from pointit_lab.loadtest.slopes import PER_PERSON, LoadSlope, PartSlopes, fit, slopes

STEPS = [(hosts, users) for hosts in (1, 2, 4) for users in (4, 8, 16)]


def result(hosts: int, users: int) -> LoadResult:
    """Return a result with 3 % for the site, 2 % for each host, 0.8 % for each person beside their wrist."""
    people = [
        Usage(name=f"people {host + 1}", cpu=0.02 + 0.008 * users / hosts, memory_mb=70 + users / hosts)
        for host in range(hosts)
    ]
    routers = [Usage(name="router host 1", cpu=0.01 + 0.001 * users, memory_mb=20.0)]
    return LoadResult(
        users=users, hosts=hosts, rate_hz=100.0, duration_s=1.0, layout="", sent=users * 100,
        pointed=users * 100, hovered=0, light_s=[0.001], cursor_s=[0.001],
        processes=[Usage(name="site", cpu=0.03 + 0.005 * users, memory_mb=80.0), *people, *routers],
        load_average=0.0,
    )  # fmt: skip


def error_of(slope: LoadSlope) -> float:
    assert slope.error is not None
    return slope.error


def test_known_coefficients_are_found() -> None:
    users = [float(users) for _, users in STEPS]
    hosts = [float(hosts) for hosts, _ in STEPS]
    values = [5.0 + 0.8 * person + 2.0 * host for person, host in zip(users, hosts, strict=True)]
    found = fit({"fixed": [1.0] * len(STEPS), "per_person": users, "per_host": hosts}, values)
    assert {name: round(slope.value, 6) for name, slope in found.items()} == {
        "fixed": 5.0,
        "per_person": 0.8,
        "per_host": 2.0,
    }
    assert all(error_of(slope) < 1e-6 for slope in found.values())


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    random = np.random.default_rng(1)
    people = [2.0, 4.0, 8.0, 16.0]
    inside = 0
    for _ in range(400):
        values = [3.0 + 0.8 * person + float(random.normal(0, 0.5)) for person in people]
        slope = fit({"fixed": [1.0] * 4, "per_person": people}, values)["per_person"]
        inside += abs(slope.value - 0.8) <= error_of(slope)
    assert 0.92 < inside / 400 < 0.98


def test_two_measurements_have_a_slope_without_an_error() -> None:
    found = fit({"fixed": [1.0, 1.0], "per_person": [1.0, 3.0]}, [1.0, 2.0])
    assert found["per_person"].value == pytest.approx(0.5)
    assert found["per_person"].error is None
    assert str(found["per_person"]) == "0.5 ± ?"


@pytest.mark.parametrize(
    ("slope", "people", "shown"),
    [
        (LoadSlope(value=0.8, error=0.3), (125.0, 100 / 1.1, 200.0), "125 [91, 200]"),
        (LoadSlope(value=0.8, error=0.9), (125.0, 100 / 1.7, None), "125 [59, ?]"),
        (LoadSlope(value=0.5, error=None), (200.0, None, None), "200 [?, ?]"),
        (LoadSlope(value=-0.1, error=0.9), None, None),
    ],
)
def test_people_a_core_is_the_inverse_with_its_interval(
    slope: LoadSlope, people: tuple[float, float | None, float | None] | None, shown: str | None
) -> None:
    part = PartSlopes(part="site", points=4, cpu_percent={PER_PERSON: slope}, memory_mb={})
    assert part.people_a_core == (None if people is None else pytest.approx(people))
    assert part.row()["people_a_core"] == shown


def test_each_part_has_its_slopes() -> None:
    found = {part.part: part for part in slopes([result(*step) for step in STEPS])}
    assert list(found) == ["all processes", "people", "site", "all routers", "root router"]
    people = found["people"]
    assert people.cpu_percent["per_person"].value == pytest.approx(0.8)
    assert people.cpu_percent["per_host"].value == pytest.approx(2.0)
    assert people.memory_mb["per_host"].value == pytest.approx(70.0)
    assert people.record()["people_a_core"][0] == pytest.approx(125.0)
    assert found["root router"].cpu_percent["per_person"].value == pytest.approx(0.1)
    assert found["site"].cpu_percent["per_person"].value == pytest.approx(0.5)


def test_machine_that_sent_too_few_samples_does_not_count() -> None:
    whole = [result(1, users) for users in (4, 8, 16)]
    late = replace(result(1, 16), users=32)
    found = slopes([*whole, late])[2]
    assert found.points == 3
    assert error_of(found.cpu_percent["per_person"]) < 1e-6


def test_cost_of_a_sample_counts_all_processes() -> None:
    one = result(1, 4)  # (3 + 2) + (2 + 3.2) + (1 + 0.4) % of a core at 400 samples a second
    assert one.us_per_sample == pytest.approx(290.0)


def load(*, central: bool) -> LoadParameters:
    return LoadParameters(
        rate_hz=100.0, duration_s=1.0, layout="one", shards=1, router="pointit", secured=False, site="lab",
        connect=(), hosts=2, routers=3, fan=2, central=central,
    )  # fmt: skip


@pytest.mark.parametrize("hosts", [1, 5])
@pytest.mark.parametrize("routers", [1, 4, 9])
@pytest.mark.parametrize("fan", [1, 2])
def test_every_machine_reaches_the_root_no_router_has_over_fan(hosts: int, routers: int, fan: int) -> None:
    machines = tree(hosts, routers, fan)
    assert sum(machine.has_people for machine in machines) == hosts
    assert sum(machine.has_router for machine in machines) == routers
    assert len({machine.name for machine in machines}) == len(machines)
    for index, machine in enumerate(machines):
        assert machines[router_of(machines, index)].has_router
        assert machine.uplink < max(1, index)
    below = [machine.uplink for machine in machines[1:] if machine.has_router]
    assert all(below.count(uplink) <= fan for uplink in below)


def test_people_are_spread_evenly_over_hosts_only() -> None:
    names = [f"load{index}" for index in range(5)]
    assert spread(names, tree(2, 3, 2)) == {1: ["load0", "load2", "load4"], 2: ["load1", "load3"]}


def test_shards_serve_and_observe_the_people_of_their_host() -> None:
    made = host_groups(load(central=False), 3, tree(2, 3, 2))
    assert [[one.name for one in groups] for groups in made.values()] == [["site", "people 1"], ["people 2"]]
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
