"""Two bridges of PointIt at one ROS router."""

import pytest

from tests.integration.ros2.nodes import BOOL, DOMAIN, POSE, RELIABLE, arrives, cdr_of, graphs, met
from tests.support.bench import until


@pytest.mark.parametrize("name", ["/pointit", "/pointit2"])
async def test_bridges_in_one_domain_are_named_and_do_not_hear_each_other(name: str) -> None:
    async with graphs() as at:
        a = await at.node("/pointit", "router", is_bridge=True)
        b = await at.node(name, is_bridge=True)
        robot = await at.node("/robot")
        to_a, to_b, to_robot = (each.hears("/user1/rotation", POSE) for each in (a, b, robot))
        writers = [each.backend.advertise("/user1/rotation", POSE, RELIABLE) for each in (a, b, robot)]
        await met(a, b, robot)
        for count, writer in enumerate(writers[:2]):
            await arrives(
                lambda count=count, writer=writer: writer.put(cdr_of(count)),  # type: ignore[misc]
                to_robot,
                number=count,
            )
        for seen in (to_a, to_b):
            await arrives(lambda: writers[2].put(cdr_of(2)), seen)
        assert set(to_a) == set(to_b) == {2}
        for node, other in ((a, name), (b, "/pointit")):
            told = f"another PointIt bridge is node {other} in this domain ({DOMAIN}): "
            await until(lambda node=node, told=told: node.shown.now.get("bridge", "").startswith(told))  # type: ignore[misc]
        assert not robot.shown.ever
        await b.backend.close()
        await until(lambda: not a.shown.now)


async def test_a_bridge_in_another_domain_is_where_it_belongs() -> None:
    async with graphs() as at:
        a = await at.node("/pointit", "router", is_bridge=True)
        b = await at.node("/pointit", is_bridge=True, domain_id=0)
        robot = await at.node("/robot", domain_id=0)
        to_a, to_robot = a.hears("/x", BOOL), robot.hears("/x", BOOL)
        writer = b.backend.advertise("/x", BOOL, RELIABLE)
        await arrives(lambda: writer.put(cdr_of(1)), to_robot, 3)
        assert not [said for said in a.shown.ever if "/pointit" in said or "stray" in said]
        assert "stray /x" not in a.shown.now
        other = robot.backend.advertise("/x", BOOL, RELIABLE)

        def is_named() -> bool:
            other.put(cdr_of(2))
            return "stray /x" in a.shown.now

        await until(is_named, what="a plain node that is in another domain to be named")
        assert not to_a
