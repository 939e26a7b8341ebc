"""A page lists wrists within reach of its machine."""

import pytest

from pointit.plugins import FoundDevice, device_search
from tests.integration.web.pages import serving
from tests.support.bench import memory_bench


async def test_a_page_finds_wrists_with_the_words_that_choose_them(monkeypatch: pytest.MonkeyPatch) -> None:
    found = (FoundDevice("F1:22", "Wristband, 80 %"), FoundDevice("Anna's phone", "Phone"))
    results = [
        device_search.SearchResult(kind="imu-source", name="band", found=found),
        device_search.SearchResult(kind="imu-source", name="other", problem="no Bluetooth adapter"),
    ]

    def find(*_arguments: object) -> list[device_search.SearchResult]:
        return results

    monkeypatch.setattr(device_search, "search", find)
    async with memory_bench() as bench, serving(bench) as server, server.page() as page:
        answer = await page.ask(deed="find_wrists")
        assert answer["reply"] == {
            "wrists": [
                {"use": "--imu band:F1:22", "label": "Wristband, 80 %"},
                {"use": """--imu 'band:Anna'"'"'s phone'""", "label": "Phone"},
            ],
            "problems": ["other: no Bluetooth adapter"],
        }
        assert "one thing at a time" in (await page.ask(key="leds/brightness", deed="find_wrists"))["error"]
