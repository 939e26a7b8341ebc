"""Addresses and secrets of a home, killed at any moment, and what clients may ask for."""

from pathlib import Path

import pytest
from pydantic import ValidationError

from pointit.bridges.home_assistant.config import HomeAssistantConfig
from pointit.bridges.home_assistant.setup.home_address import HomeAddress
from pointit.bridges.home_assistant.setup.home_files import HomeFiles
from pointit.bridges.home_assistant.setup.progress import SetupProgress
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.mqtt.broker import client_options
from pointit.schemas import SetUpHome

URL = "http://home.local:8123"
OTHER_URL = "http://other.local:8123"
NEW = "0123456789abcdef"
NEW_FILE = f"{NEW}.new-secret"
CONFIG = HomeAssistantConfig()


def home_in(folder: Path) -> HomeAddress:
    """Return the address as a new process finds it."""
    files = HomeFiles(folder)
    return HomeAddress(files, SetupProgress(files.state.read()))


def give(folder: Path, secret: str) -> str:
    file = folder / NEW_FILE
    file.write_text(secret)
    file.chmod(0o600)
    return NEW


def store(home: HomeAddress, folder: Path) -> None:
    HomeFiles(folder).state.write(home._progress.state)


def accept(home: HomeAddress, folder: Path, url: str, secret: str) -> None:
    """Try an address that is accepted, up to the moment at which the state is stored."""
    home.connect(url, give(folder, secret))
    home.config_of(CONFIG)
    home.accept()
    store(home, folder)


def used_token(home: HomeAddress) -> tuple[str, str]:
    """Return the address in use, and the token that it gets."""
    config = home.config_of(CONFIG)
    return config.url, Path(config.token_file).read_text()


def test_accepted_secret_replaces_the_old_one_after_a_kill(tmp_path: Path) -> None:
    home = home_in(tmp_path)
    accept(home, tmp_path, URL, "first")
    home.write()
    accept(home, tmp_path, OTHER_URL, "second")

    # Killed before the file was replaced
    files = HomeFiles(tmp_path)
    assert files.token.read_text() == "first"
    assert used_token(home_in(tmp_path)) == (OTHER_URL, "second")
    assert (files.token.read_text(), files.token.stat().st_mode & 0o777) == ("second", 0o600)
    assert used_token(home_in(tmp_path)) == (OTHER_URL, "second")


def test_trial_goes_on_after_a_kill_until_it_fails(tmp_path: Path) -> None:
    home = home_in(tmp_path)
    accept(home, tmp_path, URL, "first")
    home.write()
    home.connect(OTHER_URL, give(tmp_path, "second"))
    store(home, tmp_path)

    home = home_in(tmp_path)
    assert used_token(home) == (OTHER_URL, "second")
    assert home.end_trial() == URL
    assert used_token(home) == (URL, "first")
    assert not (tmp_path / NEW_FILE).exists()


def test_secret_that_no_act_has_named_is_removed_at_the_start(tmp_path: Path) -> None:
    give(tmp_path, "lost")
    home_in(tmp_path)
    assert not (tmp_path / NEW_FILE).exists()


def test_address_that_was_corrected_needs_its_own_secret(tmp_path: Path) -> None:
    home = home_in(tmp_path)
    home.connect(URL, give(tmp_path, "first"))
    home.connect(f"{URL}/", "")
    assert used_token(home) == (URL, "first"), "the same address once more"
    home.connect(OTHER_URL, "")
    assert not home.has_secret
    assert not (tmp_path / NEW_FILE).exists()


def test_trial_that_was_replaced_is_neither_accepted_nor_ended(tmp_path: Path) -> None:
    home = home_in(tmp_path)
    accept(home, tmp_path, URL, "first")
    home.write()
    home.connect(OTHER_URL, give(tmp_path, "second"))
    home.config_of(CONFIG)
    home.connect("http://third", give(tmp_path, "third"))
    home.accept()
    assert home.end_trial() == ""
    assert home.url == "http://third"
    assert used_token(home) == ("http://third", "third")


def test_working_address_needs_no_secret_once_more(tmp_path: Path) -> None:
    home = home_in(tmp_path)
    accept(home, tmp_path, URL, "first")
    home.connect(URL, "")
    assert used_token(home_in(tmp_path)) == (URL, "first")
    home.write()
    home.connect(URL, "")
    assert used_token(home) == (URL, "first")
    with pytest.raises(RefusedError, match=f"is that of {URL}"):
        home.connect(OTHER_URL, "")


def test_password_that_nobody_would_check_is_refused(tmp_path: Path) -> None:
    home = home_in(tmp_path)
    with pytest.raises(RefusedError, match="a password needs a user name"):
        home.connect("mqtt://hub", give(tmp_path, "open sesame"))
    assert home.url == ""


def test_secret_that_was_removed_is_not_accepted(tmp_path: Path) -> None:
    home = home_in(tmp_path)
    accept(home, tmp_path, URL, "first")
    home.write()
    home.connect(OTHER_URL, give(tmp_path, "second"))
    home.config_of(CONFIG)
    (tmp_path / NEW_FILE).unlink()
    with pytest.raises(ConfigError, match="connect again"):
        home.accept()
    assert home.end_trial() == URL


def test_secret_of_a_trial_is_removed_when_there_is_no_home(tmp_path: Path) -> None:
    home = home_in(tmp_path)
    home.connect(URL, give(tmp_path, "first"))
    home.without_home()
    assert not (tmp_path / NEW_FILE).exists()
    assert home.url == ""


@pytest.mark.parametrize("name", ["../other", f"{NEW}\n", "a/b", "."])
def test_secret_is_named_without_a_folder(name: str) -> None:
    with pytest.raises(ValidationError):
        SetUpHome(act="connect", url=URL, secret=name)


@pytest.mark.parametrize(
    ("parameters", "url", "password"),
    [
        ({}, "mqtt://anna@hub", None),
        ({"broker": "mqtt://anna@hub"}, "mqtt://anna@hub", "of the run"),
        ({"broker": "mqtt://anna@hub"}, "mqtt://anna@other", None),
        ({"broker": "mqtt://anna@hub"}, "mqtt://ben@hub", None),
        ({"broker": "mqtts://anna@hub"}, "mqtt://anna@hub", None),
        ({"broker": "mqtt://anna@hub", "password_file": "/of/the/card"}, "mqtt://anna@hub", None),
    ],
)
def test_password_of_the_environment_is_sent_to_its_own_broker_alone(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    parameters: dict[str, str],
    url: str,
    password: str | None,
) -> None:
    monkeypatch.setenv("MQTT_PASSWORD", "of the run")
    home = home_in(tmp_path)
    home.connect(url, "")
    config = home.config_of(HomeAssistantConfig(**parameters))
    assert client_options(config)["password"] == password

    # The same once it was accepted, and after a restart
    home.accept()
    store(home, tmp_path)
    config = home_in(tmp_path).config_of(HomeAssistantConfig(**parameters))
    assert client_options(config)["password"] == password
