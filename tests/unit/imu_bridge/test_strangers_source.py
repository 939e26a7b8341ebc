"""An IMU source of another package that misbehaves: named, replaced, and refused what harms others."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from pointit.runtime.errors import ConfigError
from pointit.runtime.service import plugin_guard
from pointit.runtime.service.service import Launch, check_launches
from pointit.schemas import NS_PER_S, Health
from pointit.schemas.topics import HEALTH, IMU
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.service import ImuBridge
from pointit.services.imu_bridge.sources import MAX_ITEMS_PER_S, SHOWN_NS, Press, Reading, ReadingCheck
from tests.support import strangers
from tests.support.bench import memory_bench, until

MODULE = """
from pydantic import BaseModel

from pointit.plugins import Config, ImuSource, Reading, rotation

class Kept(BaseModel):
    lives: int = 0

class Mortal:
    def __init__(self, config, surroundings):
        self.clock = surroundings.clock
        self.file = surroundings.state_file(Kept)
        self.is_dead = False

    async def run(self, deliver):
        assert not self.is_dead
        self.is_dead = True
        lives = (self.file.read() or Kept()).lives + 1
        self.file.write(Kept(lives=lives))
        deliver(Reading(self.clock.now_ns(), (float("nan"), 0.0, 0.0, 1.0)))
        deliver(Reading(self.clock.now_ns(), rotation.from_yaw(lives / 10)))
        raise OSError("the battery is empty")

MORTAL = ImuSource(summary="dies soon", config=Config, make=Mortal)
UNCHECKED = ImuSource(summary="", config=Config, make=Mortal, check=lambda config: 1 // 0)
"""
LABEL = "IMU source 'mortal' of strangers-parts"


@pytest.fixture(autouse=True)
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("POINTIT_STATE", str(tmp_path / "state"))
    names = ("mortal", "unchecked")
    entries = "\n".join(f"{name} = strangers_sources:{name.upper()}" for name in names)
    with strangers.installed(tmp_path, "strangers_sources", MODULE, imu_sources=entries):
        yield


async def test_failed_source_is_named_and_replaced_with_its_stored_state(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(plugin_guard, "FIRST_WAIT_S", 0.001)
    async with memory_bench() as bench:
        samples = bench.collect(IMU, "anna")
        health = bench.collect(HEALTH, "imu-bridge.anna")
        bench.start(ImuBridge, ImuBridgeConfig(source="mortal"), "anna")
        await until(lambda: len(samples) >= 3)
        assert len({sample.orientation_xyzw for sample in samples}) >= 3  # a new one in each life
        warned = {
            f"{LABEL} failed (OSError: the battery is empty), ",  # at least twice
            f"{LABEL} delivers orientations of norm nan; they are dropped: it must be 1",
        }

        def names_both(each: Health) -> bool:
            found = {begin for begin in warned for warning in each.warnings if warning.startswith(begin)}
            return found == warned

        await until(lambda: any(map(names_both, health)))


def test_source_is_refused_when_its_check_fails() -> None:
    launch = Launch(service=ImuBridge, config=ImuBridgeConfig(source="unchecked"), user="anna")
    with pytest.raises(ConfigError, match=r"imu-bridge\.anna: .*'unchecked' of strangers-parts .*\(ZeroDiv"):
        check_launches([launch])


def test_flood_is_limited_and_reported_for_a_while() -> None:
    check = ReadingCheck()
    now_ns = 1_700_000_000 * NS_PER_S
    taken = 0
    problem = ""
    for _ in range(3 * MAX_ITEMS_PER_S):
        problem = check.problem(Reading(now_ns, (0.0, 0.0, 0.0, 1.0)), now_ns)
        taken += not check.is_refused
    assert taken == MAX_ITEMS_PER_S
    assert problem == f"delivers more than {MAX_ITEMS_PER_S} readings a second; the rest is dropped"
    assert check.problem(Press(now_ns), now_ns + NS_PER_S) == problem
    assert not check.is_refused
    assert check.problem(Press(now_ns), now_ns + SHOWN_NS) == ""
