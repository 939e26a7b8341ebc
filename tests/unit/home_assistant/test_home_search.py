"""Home Assistants in the network: their announcements, and the command for each."""

import json

import pytest
from click.testing import CliRunner

from pointit.cli.main import command
from pointit.cli.plugins import devices
from pointit.plugins import device_search
from pointit.plugins.device_search import SearchResult, announced_home, import_options
from pointit.runtime.host.name_lookup import NetworkService

PROPERTIES = {
    "location_name": "Our home",
    "uuid": "3b8f",
    "version": "2025.4.4",
    "external_url": "https://home.example.org",
    "internal_url": "http://192.168.1.5:8123",
    "base_url": "https://home.example.org",
    "requires_api_password": "True",
}
"""As Home Assistant 2025.4.4 announces itself."""


def announced(**properties: str | None) -> NetworkService:
    return NetworkService("Our home", "192.168.1.7", 8123, "3b8f.local", {**PROPERTIES, **properties})


def test_network_address_is_the_one_that_home_assistant_states() -> None:
    home = announced_home(announced())
    assert home.address == "http://192.168.1.5:8123"
    assert home.label == (
        "Our home, 2025.4.4, announced by 192.168.1.7; it names another host, 192.168.1.5: send no token "
        "there unless that is yours"
    )
    assert import_options(home) == "--url http://192.168.1.5:8123 --token-file ~/ha.token"


@pytest.mark.parametrize(
    "internal_url", ["", None, "no address", "ftp://hub", "http://a:b@hub:8123", "http://"]
)
def test_address_of_the_machine_is_used_if_it_states_none(internal_url: str | None) -> None:
    assert announced_home(announced(internal_url=internal_url)).address == "http://192.168.1.7:8123"


def test_announcement_without_properties_or_with_controls_has_a_label() -> None:
    assert announced_home(NetworkService("Home", "10.0.0.2", 80, "")).label == "Home, announced by 10.0.0.2"
    own_name = announced(internal_url="http://3b8f.local:8123")
    assert announced_home(own_name).label == "Our home, 2025.4.4, announced by 192.168.1.7"
    assert announced_home(
        announced(location_name="a\x1b[31m\n" + "b" * 500, version=None)
    ).label.isprintable()


def test_url_of_another_machine_is_quoted_for_a_shell() -> None:
    home = announced_home(announced(internal_url="http://hub;reboot:8123"))
    assert ";" not in import_options(home) or "'" in import_options(home)


def test_found_home_assistant_is_listed_with_the_next_command(monkeypatch: pytest.MonkeyPatch) -> None:
    result = SearchResult(kind="home-assistant", name="home-assistant", found=(announced_home(announced()),))

    def search(*_: object) -> list[SearchResult]:
        return [result]

    monkeypatch.setattr(devices, "search", search)
    shown = CliRunner().invoke(command, ["devices"], env={"COLUMNS": "200"}).output
    assert "Home assistants: `pointit map import home-assistant --url …` uses one" in " ".join(shown.split())
    assert "--url http://192.168.1.5:8123 --token-file ~/ha.token" in shown
    rows = json.loads(CliRunner().invoke(command, ["devices", "--json"]).output)["home_assistants"]
    assert (rows[0]["address"], rows[0]["details"]["version"]) == ("http://192.168.1.5:8123", "2025.4.4")


async def test_services_of_its_kind_are_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    async def browse(kind: str, _seconds: float) -> list[NetworkService]:
        return [announced()] if kind == "_home-assistant._tcp" else []

    monkeypatch.setattr(device_search, "browse", browse)
    plugin = device_search.HOME_ASSISTANTS.get("home-assistant")
    assert plugin.discover is not None
    assert [each.label[:18] for each in await plugin.discover(1.0)] == ["Our home, 2025.4.4"]
