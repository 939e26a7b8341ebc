"""Commands with --credentials, in processes of their own."""

import asyncio
import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from pointit.access.site_folder import SiteFolder
from pointit.recording.reader import Recording
from pointit.runtime.link.link import Link, read_credentials
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Cursor, ImuSample
from pointit.schemas.topics import CURSOR, IMU, SERVICE_ALIVE
from tests.integration.access.secured import NAMES, PATIENCE_S, link_of, make_site, now, routed
from tests.support.commands import Command, Commands, Ended


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SiteFolder]:
    folder = make_site(tmp_path_factory.mktemp("site") / "lab")
    with routed(folder):
        yield folder


@pytest.mark.slow
async def test_service_under_a_wrong_name_reports_it_and_keeps_running(
    site: SiteFolder, commands: Commands
) -> None:
    folder = str(site.identity_folder("guest1"))
    service = commands.start("service", "run", "pointing", "--user", "anna", "--credentials", folder)
    await service.says("this identity (guest1) may not write users/anna/ray: use credentials of anna")
    assert service.is_running
    assert (await service.stop()).code == 0


async def test_a_person_is_not_added_under_a_shards_name(site: SiteFolder, commands: Commands) -> None:
    bus = await ZenohBus.open(link_of(site, "services"), patience_s=PATIENCE_S)
    try:
        bus.announce(SERVICE_ALIVE, "pui.hall")
        add = commands.start("site", "user", "add", "hall", "fritz", "--folder", str(site.path))
        refused = await add.end()
        assert refused.code == 2
        assert "hall: pui.hall on site lab is a shard that serves nobody of this name" in refused.err
        assert not site.state().identities.keys() & {"hall", "fritz"}
    finally:
        await bus.close()


async def test_the_variable_does_as_well(site: SiteFolder, commands: Commands) -> None:
    environment = {"POINTIT_CREDENTIALS": str(site.identity_folder("services"))}
    service = commands.start("service", "run", "pui", environment=environment)
    await service.says("pui runs on site lab")
    ended = await commands.pointit(
        "service", "call", "pui/tolerance", "--credentials", str(site.identity_folder("anna"))
    )
    assert "this identity (anna) may not ask pui/tolerance" in ended.sentence
    ended = await commands.pointit("doctor", "--credentials", str(site.identity_folder("operator")))
    assert "pui" in ended.out
    assert "Warning: the credentials of operator end on" in ended.err


async def test_press_without_the_right_is_one_error(site: SiteFolder, commands: Commands) -> None:
    ended = await commands.pointit(
        "person", "press", "anna", "--credentials", str(site.identity_folder("operator"))
    )
    assert ended.code != 0
    assert "this identity (operator) may not write users/anna/button" in ended.sentence
    assert ended.err.count("may not write") == 1


async def test_trace_needs_the_right_to_read_movements(site: SiteFolder, commands: Commands) -> None:
    traces = {
        name: commands.start("trace", "anna", "--credentials", str(site.identity_folder(name)))
        for name in ("operator", "guest1", "anna")
    }
    for name in ("operator", "guest1"):
        ended = await traces[name].end(code=1)
        assert f"this identity ({name}) may not read users/anna/imu" in ended.sentence
        assert "only anna and the supervisor may trace samples of anna" in ended.sentence
    ended = await traces["anna"].end()
    assert "no sample of anna came within 3 s" in ended.sentence


@pytest.mark.parametrize(
    ("name", "role"), [("guest1", "user"), ("services", "services"), ("operator", "operator")]
)
async def test_person_add_rejects_credentials_of_others(
    name: str, role: str, site: SiteFolder, commands: Commands
) -> None:
    ended = await commands.pointit("person", "add", "anna", "--credentials", str(site.identity_folder(name)))
    assert ended.code == 2
    assert f"these are of {name} (role {role}), who may not take part as anna" in ended.sentence


async def test_doctor_of_a_revoked_identity_says_that_it_was(tmp_path: Path, commands: Commands) -> None:
    folder = make_site(tmp_path / "lab")
    folder.revoke("guest1")
    with routed(folder):
        identity = str(folder.identity_folder("guest1"))
        doctors = [
            commands.start("doctor", "--credentials", identity, *options)
            for options in ([], ["--only", "pui"])
        ]
        for doctor in doctors:
            ended = await doctor.end(code=1)
            told = " ".join(ended.out.split())
            assert "error: this identity (guest1) may do nothing here: it was revoked" in told
            assert "no service runs" not in told


async def test_doctor_without_credentials_says_that_the_site_is_secured(
    site: SiteFolder, commands: Commands
) -> None:
    addresses = [f"{protocol}/127.0.0.1:{site.state().port}" for protocol in ("tcp", "tls")]
    doctors = [commands.start("doctor", "--json", "--connect", at) for at in addresses]
    identity = str(site.identity_folder("operator"))
    mending = commands.start("doctor", "--json", "--credentials", identity)
    for at, doctor in zip(addresses, doctors, strict=True):
        ended = await doctor.end()
        (finding,) = json.loads(ended.out)["findings"]
        assert (ended.code, finding["code"]) == (1, "denied")
        assert (
            f"the router at {at} is of a secured site: give your identity by --credentials"
            in finding["sentence"]
        )
    mended = await mending.end()
    assert "denied" not in {each["code"] for each in json.loads(mended.out)["findings"]}


async def test_doctor_names_the_revocation_of_an_identity_that_goes_on(
    tmp_path: Path, commands: Commands
) -> None:
    folder = make_site(tmp_path / "lab")
    router = commands.start("router", "--site-folder", str(folder.path))
    await router.says("router listens")
    anna = str(folder.identity_folder("anna"))
    pointing = commands.start("service", "run", "pointing", "--user", "anna", "--credentials", anna)
    await pointing.says("runs")
    folder.revoke("anna")
    await pointing.says("may do nothing here")
    operator = str(folder.identity_folder("operator"))
    findings: list[dict[str, str]] = []
    while not any("hall/anna" in each["sentence"] or "lab/anna" in each["sentence"] for each in findings):
        ended = await commands.pointit("doctor", "--json", "--credentials", operator)
        findings = json.loads(ended.out)["findings"]
    (denied,) = (each for each in findings if each["code"] == "denied")

    assert denied["sentence"].startswith("lab/anna may not ")
    assert "it was revoked or its certificate replaced" in denied["sentence"]
    assert "`pointit site renew anna`" in denied["sentence"]


async def test_doctor_tells_until_when_certificates_last(site: SiteFolder, commands: Commands) -> None:
    folder = site.identity_folder("operator")
    ended = await commands.pointit("doctor", "--json", "--credentials", str(folder))
    told = {row["name"]: row for row in json.loads(ended.out)["identities"]}
    assert told.keys() == {*NAMES, "router"}
    assert [name for name, row in told.items() if row["own"]] == ["operator"]
    until = site.state().identities["operator"].valid_until
    assert (told["operator"]["state"], told["operator"]["until"]) == ("ends soon", f"{until:%Y-%m-%d}")
    ended = await commands.pointit("doctor", "--credentials", str(folder))
    assert "operator (this one)" in ended.out
    assert ended.err.count("Warning: ") == 2, ended.err
    _, _, others = ended.err.rpartition("Warning: ")
    assert others.startswith("anna, ben, ")
    assert "operator" not in others


FEED_S = 0.05


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


async def test_identities_record_readable_topics_and_report_the_others(
    site: SiteFolder, commands: Commands, tmp_path: Path
) -> None:
    credentials = read_credentials(site.identity_folder("supervisor"), now())
    link = Link(site="lab", connect=credentials.link.endpoints, credentials=credentials)
    bus = await ZenohBus.open(link)
    feeding = asyncio.create_task(feed(bus))
    seen: list[tuple[str, bool]] = []
    bus.watch(SERVICE_ALIVE, lambda name, *, present: seen.append((name, present)))
    recorders: dict[str, Command] = {}
    ended: dict[str, Ended] = {}
    try:
        # both at once: each records for as long as a busy machine may take to tell of the writers
        for identity in ("supervisor", "anna"):
            folder = f"{site.identity_folder(identity)}"
            path = tmp_path / f"{identity}.mcap"
            recorders[identity] = commands.start(
                "record", f"{path}", "--credentials", folder, "--duration", "8"
            )
        for identity, recorder in recorders.items():
            ended[identity] = await recorder.end(code=0)
    finally:
        feeding.cancel()
        await bus.close()
    assert ("recorder", True) in seen

    assert "not everything is recorded" not in ended["supervisor"].err
    assert "not everything is recorded" in ended["anna"].err
    assert "this identity (anna) may not read" in ended["anna"].err
    movements = {"supervisor": {"users/anna/imu", "users/ben/imu"}, "anna": {"users/anna/imu"}}
    for identity, expected in movements.items():
        with Recording.open(tmp_path / f"{identity}.mcap") as recording:
            recorded = set(recording.counts)
        assert {key for key in recorded if key.endswith("/imu")} == expected
        assert {"users/anna/cursor", "users/ben/cursor"} <= recorded


async def test_unseen_identity_does_not_record(site: SiteFolder, commands: Commands, tmp_path: Path) -> None:
    folder = f"{site.identity_folder('operator')}"
    ended = await commands.pointit("record", f"{tmp_path / 'session.mcap'}", "--credentials", folder)
    assert ended.code != 0
    assert "nobody would see it record" in ended.err
