"""The folder of a site: what is made, what changes, what is never left half done."""

import datetime as dt
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from cryptography import x509

from pointit.access.authority import Authority, create_authority
from pointit.access.rights import Role
from pointit.access.site_folder import SiteFolder, SiteFolderState, locked
from pointit.cli.main import command
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.link import read_credentials
from pointit.schemas import KeyNameError
from tests.integration.access.secured import make_site, now

NOW = dt.datetime(2030, 1, 1, tzinfo=dt.UTC)
ROLES: dict[str, Role] = {"anna": "user", "services": "services"}


def site_of(path: Path, *, password: bool = False) -> SiteFolder:
    site = SiteFolder(path / "lab")
    state = SiteFolderState(
        site="lab",
        hosts=("router", "10.0.0.1", "fd00::1"),
        port=7447,
        days=90,
        password=password,
        dashboard_rate_hz=0,
        identities={},
    )
    site.create(state, ROLES, NOW)
    return site


def certificate(path: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(path.read_bytes())


def test_git_never_tracks_a_sites_keys(tmp_path: Path) -> None:
    assert (site_of(tmp_path).path / ".gitignore").read_text() == "*\n"


@pytest.mark.skipif(os.name != "posix", reason="modes are POSIX's")
@pytest.mark.parametrize("password", [False, True], ids=["keys", "passwords"])
def test_secrets_are_the_owners_alone_however_files_are_made(tmp_path: Path, *, password: bool) -> None:
    before = os.umask(0)
    try:
        site = site_of(tmp_path, password=password)
        site.renew(["anna"], NOW)
    finally:
        os.umask(before)
    files = [file for file in site.path.rglob("*") if file.is_file()]
    named = {file for file in files if file.name in ("key.pem", "router.json5", "users.txt", "password")}

    assert {file.stat().st_mode & 0o777 for file in named} == {0o600}
    assert all(file.stat().st_mode & 0o077 == 0 for file in site.path.rglob("*") if file.is_dir())
    own = {"password"} if password else {"cert.pem", "key.pem"}
    assert {file.name for file in site.identity_folder("anna").iterdir()} == {"ca.pem", "link.json", *own}

    secrets = [b"PRIVATE", *(file.read_bytes() for file in files if file.name == "password")]
    held = {file.name for file in files if any(secret in file.read_bytes() for secret in secrets)}
    assert held == ({"key.pem", "password", "users.txt"} if password else {"key.pem"})


def test_certificates_say_who_it_is_and_for_how_long(tmp_path: Path) -> None:
    site = site_of(tmp_path)
    anna = certificate(site.identity_folder("anna") / "cert.pem")
    assert anna.subject.rfc4514_string() == "CN=lab/anna/1"
    assert anna.not_valid_after_utc == NOW + dt.timedelta(days=90)
    anna.verify_directly_issued_by(certificate(site.path / "authority" / "ca.pem"))
    with pytest.raises(x509.ExtensionNotFound):
        anna.extensions.get_extension_for_class(x509.SubjectAlternativeName)
    router = certificate(site.path / "router" / "cert.pem")
    names = router.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["router", "localhost"]
    addresses = [str(address) for address in names.get_values_for_type(x509.IPAddress)]
    assert addresses == ["10.0.0.1", "fd00::1", "127.0.0.1", "::1"]
    link = read_credentials(site.identity_folder("anna"), NOW).link
    assert link.endpoints == ("tls/router:7447", "tls/10.0.0.1:7447", "tls/[fd00::1]:7447")


def test_renewed_and_readded_identities_have_new_generations(tmp_path: Path) -> None:
    site = site_of(tmp_path)

    def known() -> list[str]:
        return [member.common_name for member in site.router_site().members if member.name == "anna"]

    assert known() == ["lab/anna/1"]
    site.renew(["anna"], NOW)
    assert known() == ["lab/anna/2"]

    site.revoke("anna")
    assert known() == []
    assert site.router_site().former == ["lab/anna/1", "lab/anna/2"]
    assert '"lab/anna/write"' not in (site.path / "router" / "router.json5").read_text()

    site.renew(["anna"], NOW)
    assert known() == ["lab/anna/3"]
    site.remove("anna")
    assert known() == []
    assert not site.identity_folder("anna").exists()

    site.add({"anna": "user"}, NOW)
    assert known() == ["lab/anna/4"]
    assert certificate(site.identity_folder("anna") / "cert.pem").subject.rfc4514_string() == "CN=lab/anna/4"


def test_passwords_end_with_their_owner(tmp_path: Path) -> None:
    site = site_of(tmp_path, password=True)
    users = site.path / "router" / "users.txt"
    before = users.read_text()
    assert before.startswith("lab/anna/1:")
    assert not (site.identity_folder("anna") / "key.pem").exists()
    site.renew(["anna"], NOW)
    assert users.read_text().splitlines()[0].startswith("lab/anna/2:")
    assert before.splitlines()[0].partition(":")[2] not in users.read_text()
    site.revoke("anna")
    assert "anna" not in users.read_text()
    assert "password" not in (site.path / "site.json").read_text().replace('"password": true', "")


IMPOSSIBLE: list[tuple[Callable[[SiteFolder], object], str]] = [
    (lambda site: site.renew(["zoe"], NOW), "site lab has no zoe; it has router, anna, services"),
    (lambda site: site.revoke("router"), "the router cannot be without a certificate"),
    (lambda site: site.add({"anna": "user"}, NOW), "anna exists already"),
    (lambda site: site.add({"router": "user"}, NOW), "router"),
    (lambda site: site.add({"x" * 64: "user"}, NOW), "choose shorter names"),
    (lambda site: site.renew(["router"], NOW, ["no host!"]), "'no host!' is not a name or address"),
]


@pytest.mark.parametrize(("do", "sentence"), IMPOSSIBLE)
def test_the_impossible_changes_nothing(
    do: Callable[[SiteFolder], object], sentence: str, tmp_path: Path
) -> None:
    site = site_of(tmp_path)
    before = {file: file.read_bytes() for file in site.path.rglob("*") if file.is_file()}
    with pytest.raises(ConfigError, match=sentence):
        do(site)
    assert {file: file.read_bytes() for file in site.path.rglob("*") if file.is_file()} == before


def test_a_name_that_would_be_a_path_is_refused(tmp_path: Path) -> None:
    site = site_of(tmp_path)
    for name in ("../x", "a/b", "", "*", ".x"):
        with pytest.raises(KeyNameError):
            site.add({name: "user"}, NOW)


def test_a_folder_holds_one_site(tmp_path: Path) -> None:
    site = site_of(tmp_path)
    with pytest.raises(ConfigError, match="holds a site already"):
        site.create(site.state(), ROLES, NOW)
    with pytest.raises(ConfigError, match=r"is not the folder of a site .*pointit site init"):
        SiteFolder(tmp_path / "other").state()
    (site.path / "site.json").write_text("{}")
    with pytest.raises(ConfigError, match=r"site\.json"):
        site.state()


def test_two_at_once_are_one_after_the_other(tmp_path: Path) -> None:
    site = site_of(tmp_path)
    with locked(site.path), pytest.raises(ConfigError, match="another process is changing it"):
        site.renew(["anna"], NOW)
    site.renew(["anna"], NOW)


def test_no_certificate_outlives_its_authority() -> None:
    made = create_authority("lab", NOW)
    issued = Authority(made.certificate, made.key).issue("lab/anna/1", NOW, 100_000)
    assert issued.valid_until == made.valid_until
    with pytest.raises(ConfigError, match="not that of its certificate"):
        Authority(made.certificate, create_authority("lab", NOW).key)
    with pytest.raises(ConfigError, match="damaged"):
        Authority(b"x", made.key)


@pytest.fixture(scope="module")
def by_password(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the credentials of a person by password."""
    return make_site(tmp_path_factory.mktemp("site") / "lab", password=True).identity_folder("anna")


@pytest.mark.parametrize("held", [b"", b"\xff\xfegeheim", b"geheim\ngeheim", b"ge heim"])
def test_invalid_password_file_is_reported_without_its_content(
    tmp_path: Path, by_password: Path, held: bytes
) -> None:
    file = Path(shutil.copytree(by_password, tmp_path / "anna")) / "password"
    file.write_bytes(held)
    with pytest.raises(ConfigError, match=r"password: is not a password made by `pointit site`") as told:
        read_credentials(file.parent, now())
    assert "heim" not in str(told.value).replace(str(file), "")


@pytest.mark.skipif(os.name != "posix", reason="modes are POSIX's")
@pytest.mark.parametrize("mode", [0o640, 0o604, 0o666])
def test_a_password_that_others_can_read_is_refused(tmp_path: Path, by_password: Path, mode: int) -> None:
    file = Path(shutil.copytree(by_password, tmp_path / "anna")) / "password"
    assert file.stat().st_mode & 0o777 == 0o600
    file.chmod(mode)
    with pytest.raises(ConfigError, match=r"others can read it.*chmod 600 .*password"):
        read_credentials(file.parent, now())


def test_credentials_that_are_shown_show_no_password(by_password: Path) -> None:
    credentials = read_credentials(by_password, now())
    secret = credentials.settings()["transport/auth/usrpwd/password"]
    assert len(secret) > 30
    assert secret not in f"{credentials!r} {credentials.link!r} {credentials.link.model_dump_json()}"


def site_command(*arguments: str) -> Result:
    return CliRunner().invoke(command, ["site", *arguments])


def refused(*arguments: str) -> str:
    result = site_command(*arguments)
    assert isinstance(result.exception, ConfigError | KeyNameError), result.output
    return str(result.exception)


@pytest.fixture
def folder(tmp_path: Path) -> str:
    path = str(tmp_path / "lab")
    result = site_command(*f"init lab --folder {path} --users anna,ben --guests 2 --days 90".split())
    assert result.exit_code == 0, result.output
    assert "keep" in result.output
    return path


def names_of(folder: str) -> set[str]:
    return {
        row["name"]
        for row in json.loads(site_command("show", "--folder", folder, "--json").output)["identities"]
    }


def test_people_are_added_and_removed(folder: str) -> None:
    result = site_command("user", "add", "carla", "--folder", folder)
    assert "identities/carla" in result.output
    assert (Path(folder) / "identities/carla/key.pem").exists()
    site_command("user", "remove", "carla", "--folder", folder)
    assert "carla" not in names_of(folder)
    assert "services is a reserved name of the site" in refused("user", "add", "services", "--folder", folder)
    assert "is not a person" in refused("user", "remove", "web", "--folder", folder)
    assert "'run.bob': names that begin with 'run.'" in refused("user", "add", "run.bob", "--folder", folder)
    assert refused("user", "add", "carla", "carla", "--folder", folder).startswith("carla is named twice")
    assert "carla" not in names_of(folder)


def test_a_single_service_gets_an_identity_if_it_is_one(folder: str) -> None:
    assert site_command("service", "add", "foxglove", "--folder", folder).exit_code == 0
    assert SiteFolder(Path(folder)).state().identities["foxglove"].role == "service"
    assert "foxglove exists already, as service" in refused("service", "add", "foxglove", "--folder", folder)
    unknown = refused("service", "add", "foxglove", "web", "--folder", folder)
    assert unknown.startswith("web is not a shared service here; there are agv-tracker, ")


@pytest.mark.parametrize(
    ("users", "sentence"),
    [
        ("a,b,a", "a is named twice; name each person once"),
        ("web", "web is a reserved name of the site"),
        ("dashboard7", "dashboard7 is a reserved name of the site"),
        ("a,mqtt", "user 'mqtt': is the name of a service; choose another for a person"),
        ("a,run.bob", "user 'run.bob': names that begin with 'run.' are those of runs; choose another"),
    ],
)
def test_names_that_cannot_be_given_are_told_apart(users: str, sentence: str, tmp_path: Path) -> None:
    path = tmp_path / "lab"
    said = refused("init", "lab", "--folder", str(path), "--users", users)
    assert said.startswith(sentence)
    assert not path.exists()


def test_certificate_that_expires_soon_causes_a_warning(tmp_path: Path) -> None:
    path = str(tmp_path / "lab")
    site_command("init", "lab", "--folder", path, "--days", "20", "--guests", "0")
    result = site_command("show", "--folder", path)
    assert result.exit_code == 1
    assert "ends soon" in result.output
    assert "renew with `pointit site renew`" in result.output
    assert "router has a new certificate" in site_command("renew", "--folder", path).output


def test_passwords_are_kept_when_the_routers_certificate_is_renewed(tmp_path: Path) -> None:
    path = str(tmp_path / "lab")
    site_command(*f"init lab --folder {path} --days 20 --guests 0 --users anna --password".split())
    users = tmp_path / "lab" / "router" / "users.txt"
    before = users.read_text()
    said = site_command("renew", "--folder", path).output
    assert said.startswith("router has a new certificate")
    assert said.count("\n") == 1
    assert users.read_text() == before
    assert "anna has a new password: copy" in site_command("renew", "anna", "--folder", path).output
    assert users.read_text() != before


@pytest.mark.parametrize("options", [[], ["--password"]], ids=["keys", "passwords"])
def test_no_secret_is_printed(tmp_path: Path, options: list[str]) -> None:
    path = tmp_path / "lab"

    def secrets() -> list[str]:
        keys = [file.read_text().splitlines()[1] for file in path.glob("identities/*/key.pem")]
        users = path / "router" / "users.txt"
        lines = users.read_text().splitlines() if options else []
        return [*keys, *(line.rpartition(":")[2] for line in lines)]

    said = site_command("init", "lab", "--folder", str(path), "--users", "anna,ben", *options).output
    for arguments in (["show"], ["show", "--json"], ["user", "list"], ["renew", "anna"], ["revoke", "ben"]):
        before = secrets()
        said += site_command(*arguments, "--folder", str(path)).output
        assert before
        assert not any(secret in said for secret in (*before, *secrets()))
