"""The file of a password: what it holds, who may read it, and that it is never shown."""

import os
from pathlib import Path

import pytest

from pointit.runtime.errors import ConfigError
from pointit.runtime.link.credentials import read_credentials
from tests.integration.access.secured import credentials_of, make_site, now


@pytest.mark.parametrize("held", [b"", b"\n", b"\xff\xfegeheim", b"geheim\ngeheim", b"geheim:x", b"ge heim"])
def test_what_is_no_password_is_told_without_it(tmp_path: Path, held: bytes) -> None:
    file = make_site(tmp_path / "lab", password=True).identity_folder("anna") / "password"
    file.write_bytes(held)
    with pytest.raises(ConfigError, match=r"password: is not a password made by `pointit site`") as told:
        read_credentials(file.parent, now())
    assert "heim" not in str(told.value).replace(str(file), "")


@pytest.mark.skipif(os.name != "posix", reason="modes are POSIX's")
@pytest.mark.parametrize("mode", [0o640, 0o604, 0o666])
def test_a_password_that_others_can_read_is_refused(tmp_path: Path, mode: int) -> None:
    file = make_site(tmp_path / "lab", password=True).identity_folder("anna") / "password"
    assert file.stat().st_mode & 0o777 == 0o600
    file.chmod(mode)
    with pytest.raises(ConfigError, match=r"others can read it.*chmod 600 .*password"):
        read_credentials(file.parent, now())


@pytest.mark.skipif(os.name != "posix", reason="modes are POSIX's")
def test_only_the_owner_reads_what_passwords_are_in_however_files_are_made(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        folder = make_site(tmp_path / "lab", password=True)
        folder.renew(["anna"], now())
    finally:
        os.umask(before)
    secrets = {
        credentials_of(folder, name).settings()["transport/auth/usrpwd/password"] for name in ("anna", "ben")
    }
    held = [
        file
        for file in folder.path.rglob("*")
        if file.is_file() and any(secret in file.read_text() for secret in secrets)
    ]
    assert {file.name for file in held} == {"password", "users.txt"}
    assert {file.stat().st_mode & 0o777 for file in (*held, *folder.path.rglob("key.pem"))} == {0o600}
    assert all(file.stat().st_mode & 0o077 == 0 for file in folder.path.rglob("*") if file.is_dir())


def test_credentials_that_are_shown_show_no_password(tmp_path: Path) -> None:
    credentials = credentials_of(make_site(tmp_path / "lab", password=True), "anna")
    secret = credentials.settings()["transport/auth/usrpwd/password"]
    assert len(secret) > 30
    assert secret not in f"{credentials!r} {credentials.link!r} {credentials.link.model_dump_json()}"
