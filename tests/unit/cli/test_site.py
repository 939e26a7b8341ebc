"""`pointit site`: its router and the table of its identities."""

import asyncio
import contextlib
import datetime as dt
import shutil
import sys
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import pytest

from pointit.access import router_guard
from pointit.access.site_folder import SiteFolder, SiteFolderState
from pointit.cli import router
from pointit.cli.site import expiring, rows_of, section, visible_rows
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.link import read_credentials
from tests.support.invoked import python

pytestmark = pytest.mark.wall_time
PATIENCE_S = 60.0
STARTS_WITH_FEW_FILES = """
import resource
_, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
resource.setrlimit(resource.RLIMIT_NOFILE, (256, hard))
from pointit.cli import router

def run_until_shutdown(work):
    work.close()
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    print(soft == hard > 256)
    return 0

router.run_until_shutdown = run_until_shutdown
router.command([])
"""


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there may be no limit, or none that is raised")
def test_command_may_open_as_many_files_as_the_system_permits() -> None:
    started = python("-c", STARTS_WITH_FEW_FILES)
    assert (started.stdout, started.stderr) == ("True\n", "")


class Routing:
    """Stand-in for a router that keeps routing and fails to report its state."""

    listens = ("tls/127.0.0.1:7447",)
    is_open = False
    roles: Mapping[str, str] = {}
    former: frozenset[str] = frozenset()
    times_opened = 1
    has_counters = True
    is_held: object = None

    async def open(self) -> None:
        self.is_open = True

    async def reload_on_change(self) -> None:
        async with asyncio.timeout(PATIENCE_S):
            await asyncio.Event().wait()

    def links(self) -> list[tuple[str, str, str]]:
        return []

    def counters(self) -> Mapping[str, object]:
        return {}

    def cut(self, _addresses: object) -> None:
        pass

    def hold(self, _addresses: object) -> None:
        pass

    def pop_new_connections(self) -> Counter[str]:
        return Counter()

    def report(self, *_: object) -> None:
        raise UnexpectedError

    async def close(self) -> None:
        self.is_open = False


class UnexpectedError(Exception):
    pass


def _deaf(*_: object) -> contextlib.nullcontext[None]:
    return contextlib.nullcontext()


async def test_a_router_that_cannot_tell_refusals_ends_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(router, "captured_log", _deaf)
    monkeypatch.setattr(router_guard, "TELL_S", 0.0)
    routing = Routing()
    with pytest.raises(ExceptionGroup) as ended:
        await router._guard(routing, 32)  # pyrefly: ignore[bad-argument-type]  # all that it needs of one
    assert ended.group_contains(UnexpectedError)
    assert not routing.is_open


NOW = dt.datetime(2026, 1, 1, tzinfo=dt.UTC)
LATER = NOW + dt.timedelta(days=345)


def made(path: Path, *, password: bool = False) -> SiteFolder:
    folder = SiteFolder(path)
    state = SiteFolderState(
        site="lab", hosts=("127.0.0.1",), port=7447, days=365, password=password, dashboard_rate_hz=0.0,
        identities={},
    )  # fmt: skip
    folder.create(state, {"anna": "user", "ben": "user", "carla": "user", "operator": "operator"}, NOW)
    return folder


@pytest.fixture
def site(tmp_path: Path) -> SiteFolder:
    folder = made(tmp_path / "lab")
    folder.renew(["ben"], LATER)
    folder.revoke("anna")
    folder.remove("carla")
    return folder


def standing(rows: list[dict[str, object]]) -> dict[object, tuple[object, ...]]:
    return {row["name"]: (row["state"], row["until"], row["own"]) for row in rows}


def test_all_identities_are_shown_when_the_site_folder_is_available(site: SiteFolder) -> None:
    credentials = read_credentials(site.identity_folder("operator"), NOW)
    expected = {
        "anna": ("revoked", "2027-01-01", False),
        "ben": ("valid", "2027-12-12", False),
        "operator": ("ends soon", "2027-01-01", True),
        "router": ("ends soon", "2027-01-01", False),
    }
    rows = visible_rows(credentials, None, LATER)
    assert (standing(rows), expiring(rows)) == (expected, ["operator", "router"])
    assert standing(visible_rows(credentials, site.path, LATER)) == expected
    assert not any(row["own"] for row in visible_rows(None, site.path, LATER))


def test_own_identity_is_shown_without_the_site_folder(site: SiteFolder, tmp_path: Path) -> None:
    carried = tmp_path / "elsewhere" / "operator"
    shutil.copytree(site.identity_folder("operator"), carried)
    credentials = read_credentials(carried, NOW)
    assert standing(visible_rows(credentials, None, NOW)) == {"operator": ("valid", "2027-01-01", True)}
    assert standing(visible_rows(credentials, None, LATER)) == {"operator": ("ends soon", "2027-01-01", True)}
    assert visible_rows(None, None, NOW) == []


def test_broken_or_foreign_folder_does_not_spoil_the_visible_rows(site: SiteFolder, tmp_path: Path) -> None:
    other = SiteFolder(tmp_path / "hall")
    other.create(site.state().model_copy(update={"site": "hall"}), {"operator": "operator"}, NOW)
    credentials = read_credentials(site.identity_folder("operator"), NOW)
    assert not any(row["own"] for row in visible_rows(credentials, other.path, NOW))
    (site.path / "site.json").write_text("{}")
    assert list(standing(visible_rows(credentials, None, NOW))) == ["operator"]
    with pytest.raises(ConfigError, match="is not the folder of a site"):
        visible_rows(credentials, tmp_path, NOW)


def test_passwords_do_not_end(tmp_path: Path) -> None:
    site = made(tmp_path / "lab", password=True)
    credentials = read_credentials(site.identity_folder("operator"), NOW)
    rows = visible_rows(credentials, None, LATER)
    assert (standing(rows)["anna"], expiring(rows)) == (("valid", None, False), ["router"])
    assert standing(visible_rows(credentials, None, LATER))["operator"] == ("valid", None, True)
    table = {str(row["name"]): row["until"] for row in section(rows).rows}
    assert (table["operator (this one)"], table["router"]) == ("by password", "2027-01-01")


def test_certificate_past_its_end_is_expired(site: SiteFolder) -> None:
    (row,) = rows_of(site.state(), ["operator"], NOW + dt.timedelta(days=366))
    assert row["state"] == "expired"
