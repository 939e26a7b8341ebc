"""`pointit record` on a secured site: what an identity may read is recorded, the rest is named."""

import asyncio
from collections.abc import Iterator
from pathlib import Path

import pytest

from pointit.access.site_folder import SiteFolder
from pointit.recording.reader import Recording
from pointit.runtime.link.credentials import read_credentials
from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Cursor, ImuSample
from pointit.schemas.topics import CURSOR, IMU, SERVICE_ALIVE
from tests.integration.access.secured import make_site, now, routed
from tests.support.commands import Commands

FEED_S = 0.05


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SiteFolder]:
    folder = make_site(tmp_path_factory.mktemp("site") / "lab")
    with routed(folder):
        yield folder


async def feed(bus: ZenohBus) -> None:
    """Put what two people's services would."""
    samples = [bus.publisher(IMU, user) for user in ("anna", "ben")]
    cursors = [bus.publisher(CURSOR, user) for user in ("anna", "ben")]
    number = 0
    while True:
        number += 1
        for sample in samples:
            sample.put(ImuSample(stamp_ns=number, seq=number, orientation_xyzw=(0.0, 0.0, 0.0, 1.0)))
        for cursor in cursors:
            cursor.put(Cursor(stamp_ns=number, seq=number))
        await asyncio.sleep(FEED_S)


@pytest.mark.parametrize(
    ("identity", "movements", "denied"),
    [
        ("supervisor", {"users/anna/imu", "users/ben/imu"}, ""),
        ("anna", {"users/anna/imu"}, "this identity (anna) may not read"),
    ],
)
async def test_identity_records_what_it_may_read_and_says_what_it_may_not(
    *, identity: str, movements: set[str], denied: str, site: SiteFolder, commands: Commands, tmp_path: Path
) -> None:
    credentials = read_credentials(site.identity_folder("supervisor"), now())
    link = Link(site="lab", connect=credentials.link.endpoints, credentials=credentials)
    bus = await ZenohBus.open(link)
    feeding = asyncio.create_task(feed(bus))
    seen: list[tuple[str, bool]] = []
    bus.watch(SERVICE_ALIVE, lambda name, present: seen.append((name, present)))
    path = tmp_path / "session.mcap"
    folder = f"{site.identity_folder(identity)}"
    try:
        ended = await commands.pointit("record", f"{path}", "--credentials", folder, "--duration", "5")
    finally:
        feeding.cancel()
        await bus.close()
    assert ended.code == 0
    assert ("recorder", True) in seen
    assert ("not everything is recorded" in ended.err) is bool(denied)
    assert denied in ended.err
    with Recording.open(path) as recording:
        recorded = set(recording.counts)
    assert {key for key in recorded if key.endswith("/imu")} == movements
    assert {"users/anna/cursor", "users/ben/cursor"} <= recorded


async def test_identity_that_cannot_be_seen_does_not_record(
    site: SiteFolder, commands: Commands, tmp_path: Path
) -> None:
    folder = f"{site.identity_folder('operator')}"
    ended = await commands.pointit("record", f"{tmp_path / 'session.mcap'}", "--credentials", folder)
    assert ended.code != 0
    assert "nobody would see it record" in ended.err
