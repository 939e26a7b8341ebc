"""Changes of people and certificates at a running router, several sites and several routers."""

import asyncio
import json
import shutil
import socket
from pathlib import Path

import pytest

from pointit.access.rights import Role
from pointit.access.site_folder import SiteFolder
from pointit.runtime.router import Router
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Health, ImuSample
from pointit.schemas.topics import ANY, BUTTON, HEALTH, IMU, SERVICE_ALIVE, SET_BRIGHTNESS, USER_ALIVE
from tests.integration.access.secured import (
    Member,
    RouterProgram,
    endpoint_of,
    joined,
    link_of,
    make_site,
    now,
    routed,
    wait,
)
from tests.support.bench import until
from tests.support.buses import free_port

FEW: dict[str, Role] = {"anna": "user", "services": "services", "supervisor": "supervisor"}


def carried(folder: SiteFolder, to: Path) -> SiteFolder:
    """A copy of the site's folder as it is now."""
    shutil.copytree(folder.path, to)
    return SiteFolder(to)


def hears(listener: Member, key: str, speaker: Member) -> None:
    with listener.listening(key) as ear:
        ear.hears(key, lambda: speaker.put(key))


def is_silent(listener: Member, speaker: Member, key: str, witness: Member, known: str) -> bool:
    """Return True if nothing of `speaker` arrives, while a witness's does."""

    def say() -> None:
        speaker.put(key)
        witness.put(known)

    with listener.listening("**") as ear:
        for _ in range(3):
            ear.keys.clear()
            ear.hears(known, say)
            if key in ear.keys:
                return False
    return True


@pytest.mark.slow
async def test_the_router_follows_who_comes_and_goes(tmp_path: Path) -> None:
    folder = make_site(tmp_path / "lab", names=FEW)
    with RouterProgram("--config", str(folder.path / "router" / "router.json5")):
        anna = await ZenohBus.open(link_of(folder, "anna"), patience_s=30)
        services = await ZenohBus.open(link_of(folder, "services"), patience_s=30)
        anna.publisher(IMU, "anna").put(ImuSample(stamp_ns=1, orientation_xyzw=(0, 0, 0, 1)))
        old = carried(folder, tmp_path / "old")

        folder.add({"carla": "user"}, now())
        with Member(folder, "carla") as carla, Member(folder, "supervisor") as supervisor:
            hears(supervisor, IMU.at("carla"), carla)

        folder.revoke("anna")
        await until(lambda: "may do nothing here" in anna.problem, 10, "anna to know that she is revoked")
        assert services.problem == ""

        folder.renew(["anna"], now())
        again = await ZenohBus.open(link_of(folder, "anna"), patience_s=30)
        again.publisher(IMU, "anna")
        with Member(folder, "supervisor") as supervisor, Member(folder, "anna") as new:
            hears(supervisor, IMU.at("anna"), new)
            with Member(old, "anna") as stale:
                assert is_silent(supervisor, stale, BUTTON.at("anna"), new, IMU.at("anna"))
        assert again.problem == ""
        assert "may do nothing here" in anna.problem  # her process has the certificate it began with
        for bus in (anna, services, again):
            await bus.close()


async def test_router_opens_again_while_connections_of_its_former_listener_live(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A listener for QUIC keeps its port for as long as one of its connections lives; here a socket does."""
    caplog.set_level("INFO")
    rules = tmp_path / "rules"
    rules.write_text("tcp")

    def make() -> str:
        return f'{{"mode": "router", "listen": {{"endpoints": ["{rules.read_text()}/127.0.0.1:{port}"]}}}}'

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as left:
        port = free_port()
        left.bind(("127.0.0.1", port))
        router = Router(make, tmp_path, [rules])
        await router.open()
        task = asyncio.create_task(router.reload_on_change())
        rules.write_text("udp")
        await until(lambda: "that there are now" in caplog.text, what="the new rules")
        assert router.listens == (f"udp/127.0.0.1:{port}",)
        task.cancel()
        await asyncio.wait([task])
        await router.close()


def test_a_configuration_that_cannot_be_used_is_left(tmp_path: Path) -> None:
    folder = make_site(tmp_path / "lab", names=FEW)
    file = folder.path / "router" / "router.json5"
    good = file.read_text()
    with RouterProgram("--config", str(file)) as router, Member(folder, "anna") as anna:
        for number, text in enumerate(('{"password": geheim', '{"mode": "geheim"}', '{"geheim": 5}'), 1):
            file.write_text(text)
            words = "goes on by what it has read before"
            wait(lambda: router.said.count(words) == number, words)  # noqa: B023 - called at once
        with Member(folder, "supervisor") as supervisor:
            hears(supervisor, IMU.at("anna"), anna)
        assert "that there are now" not in router.said
        file.write_text(good)
        wait(lambda: "that there are now" in router.said, "the router to go on")
        assert router.said.count("geheim") == 1  # the name of a field, which is no secret


def test_two_sites_on_one_router_are_apart(tmp_path: Path) -> None:
    a, b = (make_site(tmp_path / name, name, names=FEW) for name in ("a", "b"))
    dim = SET_BRIGHTNESS.at()
    here = USER_ALIVE.at("anna")
    with (
        RouterProgram("--site-folder", str(a.path), "--site-folder", str(b.path)),
        joined(a, "supervisor", "anna") as (mine, anna),
        joined(b, "supervisor") as (other,),
        mine.listening("**") as ear,
        other.listening("**", "@may/**") as elsewhere,
        other.serving(dim, "**") as asked,
        other.present(here),
    ):
        elsewhere.hears("map", lambda: other.put("map"))
        elsewhere.keys.clear()
        ear.hears(IMU.at("anna"), lambda: anna.put(IMU.at("anna")))
        mine.put("map")
        ear.hears("map")
        assert mine.answered(dim, "**", "*") == set()
        assert mine.sees(USER_ALIVE.at(ANY), "**") == {SERVICE_ALIVE.at("router")}

        elsewhere.hears(mark := other.mark())
        strange = [key for key in elsewhere.keys if key not in ("map", HEALTH.at("router"))]
        assert (strange, asked) == ([mark], [])


def test_a_chain_of_routers_passes_what_it_should(tmp_path: Path) -> None:
    building = make_site(tmp_path / "lab")
    hall_port = free_port()
    # the same site seen from its own hall: another port, joined to the building's
    hall = carried(building, tmp_path / "hall")

    def change(file: Path, **fields: object) -> None:
        file.write_text(json.dumps(json.loads(file.read_text()) | fields))

    change(hall.path / "site.json", port=hall_port)
    hall.renew([], now())
    for name in ("anna", "services", "supervisor"):
        change(hall.identity_folder(name) / "link.json", endpoints=[f"tls/127.0.0.1:{hall_port}"])
    dim = SET_BRIGHTNESS.at()
    mine = IMU.at("anna")
    bens = IMU.at("ben")
    with (
        RouterProgram("--site-folder", str(hall.path), "--uplink", endpoint_of(building)),
        routed(building),
        joined(hall, "anna", "supervisor") as (anna, inside),
        joined(building, "dashboard1", "supervisor", "ben") as (dashboard, outside, ben),
        dashboard.listening("users/*/cursor", "users/*/imu", "map") as seen,
        outside.listening("users/**") as outer,
        inside.listening("users/**") as inner,
        inside.serving(dim),
        inside.present(USER_ALIVE.at("anna")),
    ):
        seen.hears("map", lambda: inside.put("map"))  # from the hall to the building
        outer.hears(mine, lambda: anna.put(bens, mine))
        assert bens not in outer.keys

        anna.settle(inside)  # nothing of hers is on its way any more
        inner.keys.clear()
        inner.hears(bens, lambda: ben.put(mine, bens))
        assert mine not in inner.keys
        assert not any("imu" in key for key in seen.keys)

        wait(lambda: outside.answered(dim) != set(), "an answer across both")
        wait(lambda: dashboard.sees(USER_ALIVE.at(ANY)) != set(), "presence across both")


async def test_router_alone_reports_refused_messages_to_the_operator(tmp_path: Path) -> None:
    folder = make_site(tmp_path / "lab")
    seen: dict[str, Health] = {}
    present: set[str] = set()
    long = IMU.message.max_bytes + 1
    with RouterProgram("--site-folder", str(folder.path)), Member(folder, "anna") as anna:
        operator = await ZenohBus.open(link_of(folder, "operator"), patience_s=30)
        operator.subscribe(HEALTH, lambda health, instance: seen.update({instance: health}))
        operator.watch(SERVICE_ALIVE, lambda instance, **_: present.add(instance))
        await until(lambda: "router" in seen and "router" in present, 10, "the router's account")
        assert (seen["router"].status, seen["router"].warnings) == ("ok", ())

        def told(words: str) -> bool:
            return any(words in sentence for sentence in seen["router"].warnings)

        anna.put(IMU.at("ben"))
        await until(lambda: told(f"lab/anna may not write {IMU.at('ben')}: refused"), 10, "the attempt")
        anna.put(IMU.at("anna"), size=long)
        await until(lambda: told(f"lab/anna may not write such long messages to {IMU.at('anna')}"), 10)
        before = seen["router"].seq
        for name in ("anna", "services", "web", "operator", "dashboard1"):
            with Member(folder, name) as liar:
                liar.put(HEALTH.at("router"))
                await until(lambda name=name: told(f"lab/{name} may not write health/router"), 10)
        assert seen["router"].seq > before
        with Member(folder, "guest1") as revoked:
            folder.revoke("guest1")

            def is_told() -> bool:
                revoked.put(IMU.at("guest1"))
                return told("lab/guest1 may not write")

            await until(is_told, 10, "the revoked to be named, too")
        assert set(seen) == present == {"router"}
        await operator.close()
