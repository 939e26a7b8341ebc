"""The search for Art-Net nodes: which networks are asked, and why it cannot run."""

import sys

import pytest

from pointit.runtime.errors import ConfigError
from pointit.services.led_driver.output.dmx.artnet import broadcast_addresses


def test_no_loopback_is_asked() -> None:
    assert not [address for address in broadcast_addresses() if address.startswith("127.")]


def test_search_without_its_extra_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ifaddr", None)
    with pytest.raises(ConfigError, match="scripts/setup discovery"):
        broadcast_addresses()
