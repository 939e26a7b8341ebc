"""`pointit doctor --only NAME`: by it a container tells whether it is well."""

import json

from pointit.schemas import ExpectedService
from tests.integration.cli.test_doctor import content, expect, findings, pointing_process
from tests.support.cli_site import Site


async def test_what_else_is_wrong_does_not_count(site: Site) -> None:
    async with pointing_process(site):
        expect(site, ExpectedService(service="pui"), name="run.another")
        assert (await site.pointit("doctor")).code == 1
        ended = await content(site, "--only", "anna")
        assert [service["instance"] for service in json.loads(ended.out)["services"]] == ["pointing.anna"]


async def test_what_does_not_run_is_not_well(site: Site) -> None:
    async with pointing_process(site):
        ended = await site.pointit("doctor", "--only", "selector", "--json")
    assert ended.code == 1
    assert findings(ended) == [("absent", "selector")]
