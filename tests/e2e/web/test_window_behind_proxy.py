"""The page behind a reverse proxy that is not set up for it: it says what the server says."""

from pathlib import Path

import pytest
from playwright.async_api import Browser, expect

from tests.e2e.web.site import SitePage
from tests.e2e.web.window import Window
from tests.support.bench import until
from tests.support.buses import is_listening
from tests.support.nginx import nginx

pytestmark = [pytest.mark.slow, pytest.mark.long]


async def test_page_shows_the_reason_of_its_server(browser: Browser, site: SitePage, tmp_path: Path) -> None:
    with nginx(tmp_path, f"location / {{ proxy_pass {site.origin}; }}") as port:
        await until(lambda: is_listening(port), what="nginx")
        window = await Window.open(browser, site.url.replace(site.origin, f"http://127.0.0.1:{port}"))
        lost = window.page.get_by_role("alert")
        await expect(lost).to_contain_text(f"This page is opened at http://127.0.0.1:{port}, and the proxy")
        await expect(lost).to_contain_text("let it pass on the Host")
        await expect(lost).to_contain_text("docs/how-to/network.md")
