"""A certificate that this machine does not trust is said at once, by whatever asks a service."""

import ssl
import threading
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from ipaddress import ip_address
from pathlib import Path
from typing import NamedTuple

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec

from kb.core.config.settings import load_settings
from kb.core.errors import ActionNeeded, Untrusted
from kb.net.session import HttpSession, send
from kb.release.publish.hub import Hub
from kb.release.publish.zenodo import Zenodo
from tests.cli.conftest import clean_environment
from tests.inprocess import Here


class Service(NamedTuple):
    """A loopback service, and the file of the authority that signs for it, which is unknown."""

    url: str
    authority: Path


class _Empty(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Length", "2")
        self.end_headers()
        self.wfile.write(b"{}")

    def log_message(self, *arguments: object) -> None:
        """Quiet."""


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    place = tmp_path_factory.mktemp("certificate")
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "a company")])
    now = datetime.now(UTC)
    certificate = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(days=1))
        .not_valid_after(now + timedelta(days=1))
        .add_extension(
            x509.SubjectAlternativeName([x509.IPAddress(ip_address("127.0.0.1"))]), critical=False
        )
        .sign(key, hashes.SHA256())
    )
    file = place / "service.pem"
    own, unsealed = serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    pem = serialization.Encoding.PEM
    file.write_bytes(key.private_bytes(pem, own, unsealed) + certificate.public_bytes(pem))
    authority = place / "authority.pem"
    authority.write_bytes(certificate.public_bytes(pem))
    server = ThreadingHTTPServer(("127.0.0.1", 0), _Empty)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(file)
    server.socket = context.wrap_socket(server.socket, server_side=True)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield Service(f"https://127.0.0.1:{server.server_port}", authority)
    server.shutdown()
    thread.join()
    server.server_close()


def zenodo(url: str) -> object:
    return Zenodo(HttpSession(load_settings(dotenv=False)), url, "token").drafts()


def hub(url: str) -> object:
    return Hub(url, "hf_token").account()


@pytest.mark.parametrize("ask", [zenodo, hub])
def test_an_upload_goes_to_nobody_who_is_not_trusted(
    service: Service, ask: Callable[[str], object]
) -> None:
    with pytest.raises(Untrusted, match=r"certificate of \S*127\.0\.0\.1:.* self-signed") as error:
        ask(service.url)
    assert error.value.waits_for == "certificate"
    assert "REQUESTS_CA_BUNDLE" in error.value.hint


COMMANDS = {
    "youtube crawl": {"YOUTUBE_API_KEY": "key", "KB_YOUTUBE_ENDPOINT": "{url}"},
    "reddit crawl": {
        "REDDIT_CLIENT_ID": "id",
        "REDDIT_CLIENT_SECRET": "secret",
        "KB_REDDIT_ENDPOINT": "{url}",
    },
    "wiki crawl": {"KB_WIKI_URL": "{url}"},
    "models fetch": {"KB_MODELS_ENDPOINT": "{url}"},
}


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_waits_for_the_certificate(
    service: Service, command: str, here: Here, tmp_path: Path
) -> None:
    env = clean_environment() | {
        "KB_DATA": str(tmp_path / "data"),
        "KB_CONTACT": "somebody@example.org",
        "XDG_CACHE_HOME": str(tmp_path),
        **{name: value.format(url=service.url) for name, value in COMMANDS[command].items()},
    }
    done = here(*command.split(), env=env)
    assert done.code == ActionNeeded.exit_code, done.err
    assert done.said.startswith("kb: the certificate of 127.0.0.1:")
    wrong = here(*command.split(), env=env | {"REQUESTS_CA_BUNDLE": str(tmp_path / "absent.pem")})
    assert wrong.code == 2, wrong.err
    assert "absent.pem" in wrong.said


def test_a_named_authority_is_trusted(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("REQUESTS_CA_BUNDLE", str(service.authority))
    session = HttpSession(load_settings(dotenv=False))
    assert send(session, "GET", service.url).json() == {}
