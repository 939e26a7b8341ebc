"""`pointit router`, without routing."""

import asyncio
import contextlib
import sys
from collections.abc import Mapping

import pytest

from pointit.cli.site import router
from tests.support.invoked import python

pytestmark = pytest.mark.wall_time

PATIENCE_S = 60.0

STARTS_WITH_FEW_FILES = """
import resource
_, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
resource.setrlimit(resource.RLIMIT_NOFILE, (256, hard))
from pointit.cli.site import router

def run_until_shutdown(work):
    work.close()
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    print(soft == hard > 256)
    return 0

router.run_until_shutdown = run_until_shutdown
router.command([])
"""


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there may be no limit, or none that is raised")
def test_it_may_have_as_many_files_open_as_the_system_lets_it() -> None:
    started = python("-c", STARTS_WITH_FEW_FILES)
    assert (started.stdout, started.stderr) == ("True\n", "")


class Routing:
    """Stand-in for a router that keeps routing and fails to report its state."""

    listens = ("tls/127.0.0.1:7447",)
    is_open = False
    roles: Mapping[str, str] = {}

    async def open(self) -> None:
        self.is_open = True

    async def reload_on_change(self) -> None:
        async with asyncio.timeout(PATIENCE_S):
            await asyncio.Event().wait()

    def links(self) -> list[tuple[str, str, str]]:
        return []

    def cut(self, _addresses: object) -> None:
        pass

    def unread(self, _addresses: object) -> dict[str, int]:
        return {}

    def report(self, *_: object) -> None:
        raise UnexpectedError

    async def close(self) -> None:
        self.is_open = False


class UnexpectedError(Exception):
    pass


def _deaf(*_: object) -> contextlib.nullcontext[None]:
    return contextlib.nullcontext()


async def test_a_router_that_cannot_tell_any_more_who_was_refused_ends_and_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(router, "captured_log", _deaf)
    monkeypatch.setattr(router, "TELL_S", 0.0)
    routing = Routing()
    with pytest.raises(ExceptionGroup) as ended:
        await router._guard(routing)  # type: ignore[arg-type]  # all that it needs of one
    assert ended.group_contains(UnexpectedError)
    assert not routing.is_open
