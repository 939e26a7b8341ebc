"""Choices a joining person adopts from the site, and time for which a page counts as having viewers."""

import asyncio
import time
from pathlib import Path

import pytest

from pointit.cli.recordings.run_recorder import recorded, recorder_launch
from pointit.launch.plan.launches import CURSOR_COLORS
from pointit.launch.plan.plan import USUAL, Plan
from pointit.launch.run.run_site import LISTEN_S, ViewerPresence, check_names, surroundings
from pointit.launch.run.running_scenario import DeploymentPublisher
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.link import SILENT_S, Link
from pointit.runtime.service.service import Launch, check_launches
from pointit.schemas import Deployment, ExpectedService, Figure, Health, UserProfile
from pointit.schemas.topics import DEPLOYMENT, PROFILE, SERVICE_ALIVE, SHARD_ALIVE
from pointit.services.pointing.service import Pointing
from tests.support.bench import until
from tests.support.recorded import session, write_recording


def runs(bus: MemoryBus, name: str) -> None:
    """Publish a deployment as `run` and `user` do; a person's has no scenario."""
    scenario, key = ("", name) if name == "anna" else (name, f"run.{name}")
    bus.publisher(DEPLOYMENT, key).put(Deployment(stamp_ns=1, name=name, scenario=scenario))


@pytest.mark.parametrize(
    ("names", "scenario"),
    [
        (["scenario_4", "anna"], "scenario_4"),
        (["scenario_1"], "scenario_1"),
        ([], USUAL),
        (["mine"], USUAL),
        (["scenario_1", "scenario_2"], USUAL),
    ],
)
async def test_who_joins_takes_part_in_what_runs_there(names: list[str], scenario: str) -> None:
    bus = MemoryBus(LocalBroker())
    for name in names:
        runs(bus, name)
    assert await surroundings(bus) == (scenario, 1)
    await bus.close()


async def test_who_joins_has_the_first_colour_that_nobody_has() -> None:
    bus = MemoryBus(LocalBroker())
    for user, color in (("user1", CURSOR_COLORS[0]), ("ben", CURSOR_COLORS[2])):
        bus.publisher(PROFILE, user).put(UserProfile(stamp_ns=1, cursor_color=color))
    assert await surroundings(bus) == (USUAL, 2)
    await bus.close()


async def test_a_person_may_not_be_called_like_a_shard_of_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pointit.launch.run.run_site.SILENT_S", 0.01)
    bus = MemoryBus(LocalBroker())
    for instance in ("pui", "pui.hall", "pui.anna", "robot.quad", "pointing.carl"):
        bus.announce(SERVICE_ALIVE, instance)
    for served in ("pui.anna", "pui.ben"):
        bus.announce(SHARD_ALIVE, served)
    await check_names(bus, ["anna", "ben", "carl", "quad"])
    with pytest.raises(ConfigError, match=r"^hall: pui.hall on site .* is a shard that serves nobody"):
        await check_names(bus, ["anna", "hall"])
    await bus.close()


async def test_a_shard_that_is_about_to_serve_its_person_is_waited_for() -> None:
    bus = MemoryBus(LocalBroker())
    bus.announce(SERVICE_ALIVE, "selector.anna")
    asyncio.get_running_loop().call_later(LISTEN_S + 0.2, bus.announce, SHARD_ALIVE, "selector.anna")
    await check_names(bus, ["anna"])
    await bus.close()


def health(viewers: float | None, service: str = "web") -> Health:
    figures = () if viewers is None else (Figure(name="viewers", value=viewers),)
    return Health(stamp_ns=1, service=service, instance=f"{service}.2", pid=1, figures=figures)


def test_who_has_a_page_open_looks_on_until_it_was_not_heard_for_a_while() -> None:
    onlookers = ViewerPresence()
    assert onlookers.until_s <= 0.0
    assert onlookers.on_health(health(2.0), 10.0)
    assert onlookers.until_s > 10.0 + SILENT_S - 0.1
    assert not onlookers.on_health(health(0.0), 11.0)  # closed, or only reloaded
    assert onlookers.until_s > 10.0 + SILENT_S - 0.1
    assert onlookers.until_s <= 10.0 + SILENT_S


PLAN = Plan(name="anna", person="anna", launches=(), link=Link())
LINES = [(Launch(service=Pointing, config=Pointing.CONFIG(), user="anna"), ("pointit", "user", "anna"))]
AWAY_NS = 10**9


def posted(bus: MemoryBus) -> tuple[DeploymentPublisher, list[Deployment]]:
    """Tell of anna's run; return what tells it, and all that is told under her name."""
    told: list[Deployment] = []
    bus.subscribe(DEPLOYMENT, lambda deployment, _name: told.append(deployment), "anna")
    notice = DeploymentPublisher(bus)
    notice.post(PLAN, LINES)
    return notice, told


def other(stamp_ns: int) -> Deployment:
    services = (ExpectedService(service="pointing", user="anna", command=("elsewhere",)),)
    return Deployment(stamp_ns=stamp_ns, name="anna", services=services)


async def test_who_is_asked_to_end_takes_it_back() -> None:
    bus = MemoryBus(LocalBroker())
    notice, told = posted(bus)
    await until(lambda: len(told) == 1, what="the run")
    notice.retract()
    await until(lambda: len(told) == 2, what="its end")
    assert [len(each.services) for each in told] == [1, 0]
    notice.retract()
    await bus.close()


async def test_what_another_has_told_since_is_not_taken_back() -> None:
    bus = MemoryBus(LocalBroker())
    notice, told = posted(bus)
    bus.publisher(DEPLOYMENT, "anna").put(other(time.time_ns() + AWAY_NS))
    await until(lambda: bool(told) and told[-1].services[0].command == ("elsewhere",), what="the other one")
    later: list[str] = []
    bus.subscribe(DEPLOYMENT, lambda _deployment, name: later.append(name), "ben")
    notice.retract()
    bus.publisher(DEPLOYMENT, "ben").put(other(0))
    await until(lambda: bool(later), what="what is told after it")
    assert all(each.services for each in told)
    await bus.close()


def test_recording_that_was_cut_off_is_not_told_as_a_success(tmp_path: Path) -> None:
    launch = recorder_launch(tmp_path / "session.mcap")
    assert "is not there" in recorded(launch)
    write_recording(tmp_path / "session.mcap", session("scenario_1", 1.0))
    content = (tmp_path / "session.mcap").read_bytes()
    assert recorded(launch).endswith(" MB")
    (tmp_path / "session.mcap").write_bytes(content[:-100])
    assert recorded(launch).endswith("cut off; the log says why")


@pytest.mark.parametrize(
    ("file", "sentence"),
    [
        ("/proc/x.mcap", r"/proc/x\.mcap: cannot be written \(.+\); record in another folder"),
        ("/none/x.mcap", "its folder does not exist; create it, or record elsewhere"),
        ("/proc", "/proc is a folder; give a file in it, such as /proc/session.mcap"),
    ],
)
def test_a_file_that_cannot_be_written_is_refused_before_anything_starts(file: str, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        check_launches([recorder_launch(Path(file))])


def test_a_check_leaves_no_file(tmp_path: Path) -> None:
    check_launches([recorder_launch(tmp_path / "x.mcap")])
    assert list(tmp_path.iterdir()) == []
