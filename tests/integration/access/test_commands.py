"""Commands with --credentials, in processes of their own."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from pointit.access.site_folder import SiteFolder
from tests.integration.access.secured import make_site, routed
from tests.support.commands import Commands


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SiteFolder]:
    folder = make_site(tmp_path_factory.mktemp("site") / "lab")
    with routed(folder):
        yield folder


@pytest.fixture
def commands(tmp_path: Path) -> Iterator[Commands]:
    started = Commands(tmp_path)
    yield started
    started.kill_all()


async def test_a_service_under_a_wrong_name_says_so_and_goes_on(site: SiteFolder, commands: Commands) -> None:
    folder = str(site.identity_folder("guest1"))
    service = commands.start("service", "pointing", "--user", "anna", "--credentials", folder)
    await service.says("this identity (guest1) may not write users/anna/ray: use credentials of anna")
    assert service.is_running
    assert (await service.stop()).code == 0


async def test_the_variable_does_as_well(site: SiteFolder, commands: Commands) -> None:
    environment = {"POINTIT_CREDENTIALS": str(site.identity_folder("services"))}
    service = commands.start("service", "pui", environment=environment)
    await service.says("pui of site lab runs")
    ended = await commands.pointit(
        "call", "pui/tolerance", "--credentials", str(site.identity_folder("anna"))
    )
    assert "this identity (anna) may not ask pui/tolerance" in ended.sentence
    ended = await commands.pointit("doctor", "--credentials", str(site.identity_folder("operator")))
    assert "pui" in ended.out
    assert "Warning: the credentials of operator end on" in ended.err


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--site", "hall"], "are of site lab; leave --site out"),
        (["--connect", "tcp/127.0.0.1:7447"], "credentials are for encrypted addresses only"),
        (["--credentials", "nowhere"], "link.json: is missing"),
    ],
)
async def test_what_does_not_fit_the_credentials_is_one_sentence(
    options: list[str], sentence: str, site: SiteFolder, commands: Commands
) -> None:
    ended = await commands.pointit(
        "hz", "--all", "--credentials", str(site.identity_folder("operator")), *options
    )
    assert ended.code == 2
    assert sentence in ended.sentence
