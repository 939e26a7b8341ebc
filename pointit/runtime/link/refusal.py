"""Reasons of routers that reject credentials. Zenoh reports every refusal as a time-out."""

import socket
import ssl

from pointit.runtime.host.advised_commands import advised_commands
from pointit.runtime.link.link import CA, CERTIFICATE, ENDPOINT, KEY, SECURE, Credentials, PassingRefusal
from pointit.schemas.text import system_reason

HANDSHAKE_S = 1.0
"""Time limit of each step when probing for the reason of a refusal."""
NO_SECURED_ROUTER = (
    "{} is not a router of a secured site; give its address with --connect, or continue it if it is stopped"
)
X509_TOO_OLD = 10
"""OpenSSL's verify code: the certificate has expired."""
X509_TOO_YOUNG = 9
"""OpenSSL's verify code: it is not yet valid."""
X509_OTHER_HOST = (62, 64)
"""OpenSSL's verify codes: it names another host or address."""

REFUSALS = {
    "CERTIFICATE_EXPIRED": "has expired or is not valid yet, by the router's clock",
    "UNKNOWN_CA": "is of another authority than the router's site",
    "BAD_CERTIFICATE": "is none that the router takes",
    "CERTIFICATE_UNKNOWN": "is none that the router takes",
    "DECRYPT_ERROR": "is of another authority of the same name",
    "CERTIFICATE_REQUIRED": "was not shown, and the router wants one",
}
"""Meaning of a router's alert on our certificate, by the end of OpenSSL's name for it."""


def connection_refusal(credentials: Credentials | None, endpoint: str) -> str:
    """Return a message if the router at `endpoint` rejects a connection, else `""` (also without an answer).

    Without `credentials`, a router that speaks TLS does: it is one of a secured site.

    A `PassingRefusal` is not certain. Zenoh reports every refusal as a time-out, so the handshake is tried
    again without it. Blocks for up to 3 s: call it in a thread.
    """
    if credentials is None:
        wants = f"the router at {endpoint} is of a secured site: give your identity by --credentials FOLDER"
        return wants if _speaks_tls(endpoint) else ""
    address = SECURE.match(endpoint)
    if not address:
        return ""
    host = address["ipv6"] or address["host"]
    port = int(address["port"])
    name = credentials.link.name
    try:
        context = _context(credentials)
    except OSError as error:
        return f"{credentials.folder}: its certificates cannot be used ({system_reason(error)})"
    try:
        plain = socket.create_connection((host, port), timeout=HANDSHAKE_S)
    except OSError:
        return ""  # no answer or no route: the usual message fits
    # TLS 1.3 ends the handshake on our side before the router has judged our certificate
    is_secured = False
    try:
        with plain, context.wrap_socket(plain, server_hostname=host) as secured:
            is_secured = True
            secured.recv(1)  # the router's verdict on our certificate follows the handshake
    except ssl.SSLError as error:
        is_close = isinstance(error, ssl.SSLEOFError | ssl.SSLZeroReturnError)  # to OpenSSL 3.5
        if is_secured or not is_close:
            return _handshake_problem(error, endpoint, credentials)
        return PassingRefusal(NO_SECURED_ROUTER.format(endpoint))
    except OSError:  # includes a time-out, which means success once the connection is secured
        if not is_secured:
            return PassingRefusal(NO_SECURED_ROUTER.format(endpoint))
    # The router is asked only because Zenoh timed out: without a refusal by TLS, it was the password
    if credentials.link.password:
        return PassingRefusal(
            f"the router at {endpoint} refuses {name}'s password, or is too busy to check it; if that "
            f"persists, renew it with {advised_commands().renewal(name)}"
        )
    return ""


def _speaks_tls(endpoint: str) -> bool:
    address = ENDPOINT.fullmatch(endpoint)
    if address is None or address[1] not in ("tcp", "tls"):
        return False
    context = ssl.create_default_context()
    # nothing is sent
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    try:
        host = address[2].strip("[]")
        with socket.create_connection((host, int(address["port"])), HANDSHAKE_S) as plain:
            context.wrap_socket(plain).close()
    except OSError:
        return False
    return True


def _context(credentials: Credentials) -> ssl.SSLContext:
    context = ssl.create_default_context(cafile=str(credentials.folder / CA))
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    if not credentials.link.password:
        context.load_cert_chain(credentials.folder / CERTIFICATE, credentials.folder / KEY)
    return context


def _handshake_problem(error: ssl.SSLError, endpoint: str, credentials: Credentials) -> str:
    if isinstance(error, ssl.SSLCertVerificationError):
        return _distrust(error, endpoint, credentials)
    name = credentials.link.name
    for alert, cause in REFUSALS.items():
        if (error.reason or "").endswith(alert):
            return (
                f"the router at {endpoint} refuses {name}'s certificate: it {cause}; "
                f"renew it with {advised_commands().site(f'renew {name}')}"
            )
    return PassingRefusal(f"{endpoint} does not speak TLS as a router does ({system_reason(error)})")


def _distrust(error: ssl.SSLCertVerificationError, endpoint: str, credentials: Credentials) -> str:
    router = f"the router at {endpoint}"
    commands = advised_commands()
    if error.verify_code == X509_TOO_OLD:
        return f"{router} has a certificate that expired; renew it with {commands.site('renew router')}"
    if error.verify_code == X509_TOO_YOUNG:
        return f"{router} has a certificate that is not valid yet by this machine's clock; set the clock"
    if error.verify_code in X509_OTHER_HOST:
        return (
            f"{router} has a certificate for other names; "
            f"add this one with {commands.site('renew router --host NAME')}"
        )
    return (
        f"{router} is not the one of site {credentials.link.site}: another authority certified it; "
        "use that site's credentials, or the right address"
    )
