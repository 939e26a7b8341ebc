"""`pointit doctor` against real services, also killed and stopped ones."""

import asyncio
import contextlib
import json
import re
import sys
from collections.abc import AsyncGenerator
from typing import Any, ClassVar

from pointit.runtime.config.config import Config
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import Deployment, ExpectedService, PointingRay, UserProfile
from pointit.schemas.topics import DEPLOYMENT, IMU, PROFILE, RAY
from pointit.services.pointing.service import Pointing
from tests.support.bench import until
from tests.support.cli_site import Site, interrupt
from tests.support.commands import Ended, start_delay_s
from tests.support.pace import Patience, within

NOTICED_S = 5.0
"""Limit of the time in which doctor answers, on a quiet machine."""
POINTING = ("-m", "pointit.services", "pointing", "--user", "anna")


class QuietPui(Service[Config]):
    """Makes no cursors, as of people without a pose."""

    NAME: ClassVar[str] = "pui"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = Config


class QuietSelector(Service[Config]):
    NAME: ClassVar[str] = "selector"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = Config


def start_shared(site: Site) -> None:
    """Start what people need for pointing."""
    site.start(QuietPui)
    site.start(QuietSelector)


def expect(site: Site, *services: ExpectedService, name: str = "run.test") -> None:
    site.bus.publisher(DEPLOYMENT, name).put(Deployment(stamp_ns=1, name=name, services=services))


async def content(site: Site, *options: str, is_json: bool = True) -> Ended:
    """Ask until doctor is content, and return its answer: who was held up may still say so for a moment."""
    patience = Patience(30.0)
    while (ended := await site.pointit("doctor", *options, *(("--json",) if is_json else ()))).code != 0:
        assert not patience.is_over(), ended.out
    return ended


def findings(ended: Ended) -> list[tuple[str, str]]:
    return [(finding["code"], finding["service"]) for finding in json.loads(ended.out)["findings"]]


@contextlib.asynccontextmanager
async def pointing_process(site: Site) -> AsyncGenerator[asyncio.subprocess.Process]:
    """Run pointing of anna by itself, expected to be there, with input and with what she needs."""
    start_shared(site)
    site.bus.publisher(PROFILE, "anna").put(UserProfile(stamp_ns=1))
    site.feed_imu("anna")
    expect(site, ExpectedService(service="pointing", user="anna", command=("python", *POINTING)))
    async with site.python(*POINTING) as process:
        await site.arrived("pointing.anna")
        yield process


async def test_all_is_well(site: Site) -> None:
    async with pointing_process(site) as process:
        delay_s = await start_delay_s(site.pointit)
        ended = await content(site)
        assert within(ended.took_s, NOTICED_S + delay_s)

        report: dict[str, Any] = json.loads(ended.out)
        assert report["healthy"] is True
        assert report["findings"] == []

        (service,) = (each for each in report["services"] if each["user"])
        assert service["instance"] == "pointing.anna"
        assert service["present"]
        assert service["expected"]
        assert service["health"]["pid"] == process.pid

        (expected,) = report["deployments"]["run.test"]["services"]
        assert expected == {"service": "pointing", "user": "anna", "name": ""}
        text = await content(site, is_json=False)
        assert text.out.rstrip().endswith("all is well: 3 services run")

        (row,) = (line for line in text.out.splitlines() if line.split()[:1] == ["pointing"])
        assert (row.split()[1:3], row.split()[-1]) == (["anna", str(process.pid)], "ok")


async def test_an_expected_service_that_is_absent(site: Site) -> None:
    site.start(Pointing, "anna")
    site.start(QuietSelector)
    expect(site, ExpectedService(service="pui", command=(sys.executable, "-m", "pui of mine")))
    ended = await site.pointit("doctor", code=1)
    assert "error: pui: should run and does not" in ended.out
    assert re.search(
        r"start it again: `pointit service run pui --connect tcp/127\.0\.0\.1:\d+` \(the log of", ended.out
    )
    assert "pui of mine" not in ended.out


async def test_killed_service_is_noticed_within_five_seconds_until_its_restart(site: Site) -> None:
    async with pointing_process(site) as process:
        delay_s = await start_delay_s(site.pointit)
        process.kill()
        ended = await site.pointit("doctor", "--json")
        assert within(ended.took_s, NOTICED_S + delay_s)
        assert (ended.code, findings(ended)) == (1, [("absent", "pointing.anna")])
    async with site.python(*POINTING):
        await site.arrived("pointing.anna")
        ended = await content(site)
        assert findings(ended) == []


class DryBridge(Service[Config]):
    """Should write the IMU, and does not."""

    NAME: ClassVar[str] = "imu-bridge"
    SCOPE: ClassVar[Scope] = "user"
    CONFIG = Config

    def __init__(self, config: Config, context: Context) -> None:
        super().__init__(config, context)
        self.bus.publisher(IMU, self.user)


async def test_a_source_that_ran_dry(site: Site) -> None:
    rays: list[PointingRay] = []
    site.bus.subscribe(RAY, lambda ray, _user: rays.append(ray))
    site.bus.publisher(PROFILE, "anna").put(UserProfile(stamp_ns=1))
    start_shared(site)
    site.start(DryBridge, "anna")
    site.start(Pointing, "anna")
    feeding = site.feed_imu("anna")
    await until(lambda: bool(rays))
    feeding.cancel()
    ended = await site.pointit("doctor", "--json")
    assert (ended.code, findings(ended)) == (1, [("stale", "pointing.anna")])
    assert "imu-bridge.anna" in json.loads(ended.out)["findings"][0]["sentence"]


async def test_nothing_runs_there(site: Site) -> None:
    await site.stop()
    ended = await site.pointit("doctor", "--timeout", "0.1", code=1)
    assert f"nothing runs at {site.endpoint}" in ended.out
    assert "`pointit run`" in ended.out
    assert ended.err == ""
    parsed = json.loads((await site.pointit("doctor", "--timeout", "0.1", "--json")).out)
    assert parsed["healthy"] is False
    assert parsed["findings"][0]["code"] == "unreachable"


async def test_nobody_on_this_site(site: Site) -> None:
    site.start(Pointing, "anna")
    ended = await site.pointit("doctor", "--json", "--site", "elsewhere")
    assert (ended.code, findings(ended)) == (1, [("empty", "")])
    (finding,) = json.loads(ended.out)["findings"]
    assert finding["sentence"] == f"no service runs on this site, but a site is there: {site.bus.site}"
    assert finding["remedy"] == f"name the right one: --site {site.bus.site}"


async def test_ctrl_c_before_the_answer_is_no_answer(site: Site) -> None:
    async with site.command("doctor") as process:
        await until(lambda: bool(site.bus.session.info.transports()), 20, "doctor is connected")
        code, took_s = await interrupt(process)
        assert code == 130
        assert within(took_s, 5.0)


async def test_only_ignores_problems_of_others(site: Site) -> None:
    async with pointing_process(site):
        expect(site, ExpectedService(service="led-driver"), name="run.another")
        assert (await site.pointit("doctor")).code == 1
        ended = await content(site, "--only", "anna")
        assert [service["instance"] for service in json.loads(ended.out)["services"]] == ["pointing.anna"]
        ended = await site.pointit("doctor", "--only", "recorder", "--json")
    assert (ended.code, findings(ended)) == (1, [("absent", "recorder")])
