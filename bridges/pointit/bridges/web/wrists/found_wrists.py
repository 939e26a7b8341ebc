"""Wrists within reach of the page's machine, with the words that connect them."""

from typing import Any

from pointit.runtime.host.threads import in_daemon_thread

SEARCH_S = 3.0
MAX_SHOWN = 50


async def find_wrists() -> dict[str, Any]:
    """Search with all installed IMU sources, and return the reply to `find_wrists`."""
    # only here: they load what services load, and a page of a site elsewhere may never search
    from pointit.plugins import GROUPS  # noqa: PLC0415
    from pointit.plugins.device_search import search, words  # noqa: PLC0415

    def searched() -> dict[str, Any]:
        results = search({"imu-source": GROUPS["imu-source"]}, SEARCH_S, lambda _done: None)
        wrists = [
            {"use": f"--imu {words(result, found)}", "label": found.label}
            for result in results
            for found in result.found
        ]
        return {
            "wrists": wrists[:MAX_SHOWN],
            "problems": [f"{result.name}: {result.problem}" for result in results if result.problem],
        }

    return await in_daemon_thread(searched, "search for wrists")
