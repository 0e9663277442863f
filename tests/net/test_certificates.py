"""Services behind a proxy and behind a company's own authority: who is asked, who sees what, and
what the error says.
"""

import ipaddress
import os
import socket
import ssl
import threading
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import NamedTuple

import pytest

from kb.core.config.settings import load_settings
from kb.core.errors import ActionNeeded, KbError, SettingError, Untrusted
from kb.net import certificates, hub_client
from kb.net.session import HttpSession, send
from kb.release.publish.hub import Hub
from kb.release.publish.zenodo import Zenodo
from kb.store.tables.remote_files import remote_folders
from kb.youtube.crawl.transcripts import SITE, SiteDoor
from tests.conftest import needs
from tests.inprocess import Here

needs("cryptography")

HOST = "api.lorecrawl.net"  # no name server knows it: the proxy says where it is
SECRET = "AIza-never-in-the-clear"


@pytest.fixture(autouse=True)
def _no_authority_of_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in certificates.VARIABLES:
        monkeypatch.delenv(name, raising=False)


class Company(NamedTuple):
    """An authority, and a service on this machine that has a certificate of it."""

    authority: Path
    url: str
    port: int


class Answer(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Length", "4")
        self.end_headers()
        self.wfile.write(b"fine")

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture(scope="module")
def company(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Company]:
    place = tmp_path_factory.mktemp("company")
    authority, chain = issued(place)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(chain)
    with ThreadingHTTPServer(("127.0.0.1", 0), Answer) as server:
        server.handle_error = lambda *_: None  # type: ignore[method-assign]  # a refused handshake
        server.socket = context.wrap_socket(server.socket, server_side=True)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        port = server.server_address[1]
        yield Company(authority, f"https://127.0.0.1:{port}", port)
        server.shutdown()


def issued(place: Path) -> tuple[Path, Path]:
    """Files in PEM: an authority's certificate, and a key with a certificate of it."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec

    now = datetime.now(UTC)
    names = [x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, one)]) for one in "AB"]
    keys = [ec.generate_private_key(ec.SECP256R1()) for _ in names]
    here = [x509.DNSName(HOST), x509.IPAddress(ipaddress.ip_address("127.0.0.1"))]
    made = []
    for name, key, extension in (
        (names[0], keys[0], x509.BasicConstraints(ca=True, path_length=0)),
        (names[1], keys[1], x509.SubjectAlternativeName(here)),
    ):
        builder = x509.CertificateBuilder(names[0], name, key.public_key(), 7)
        valid = builder.not_valid_before(now - timedelta(1)).not_valid_after(now + timedelta(1))
        about = x509.AuthorityKeyIdentifier.from_issuer_public_key(keys[0].public_key())
        subject = x509.SubjectKeyIdentifier.from_public_key(key.public_key())
        whole = valid.add_extension(extension, critical=True).add_extension(about, critical=False)
        whole = whole.add_extension(subject, critical=False)
        if name is names[0]:
            usage = dict.fromkeys(
                (
                    *("digital_signature", "content_commitment", "key_encipherment"),
                    *("data_encipherment", "key_agreement", "encipher_only", "decipher_only"),
                ),
                False,
            )
            signs = x509.KeyUsage(**usage, key_cert_sign=True, crl_sign=True)
            whole = whole.add_extension(signs, critical=True)
        made.append(whole.sign(keys[0], hashes.SHA256()).public_bytes(serialization.Encoding.PEM))
    key = keys[1].private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    (place / "authority.pem").write_bytes(made[0])
    (place / "service.pem").write_bytes(key + made[1])
    return place / "authority.pem", place / "service.pem"


class Proxy:
    """Connects to the service whatever is asked for, and keeps what it was told and passed on."""

    def __init__(self, port: int) -> None:
        self._port, self.asked, self.seen = port, list[str](), bytearray()
        self.listening = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self.listening.getsockname()[1]}"
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while True:
            try:
                client, _ = self.listening.accept()
            except OSError:
                return
            told = client.recv(1 << 16)
            self.asked.append(told.partition(b"\r\n")[0].decode())
            self.seen += told
            service = socket.create_connection(("127.0.0.1", self._port))
            client.sendall(b"HTTP/1.1 200 OK\r\n\r\n")
            for one, other in ((client, service), (service, client)):
                threading.Thread(target=self._pass_on, args=(one, other), daemon=True).start()

    def _pass_on(self, one: socket.socket, other: socket.socket) -> None:
        try:
            while data := one.recv(1 << 16):
                self.seen += data
                other.sendall(data)
            other.shutdown(socket.SHUT_WR)
        except OSError:
            pass


@pytest.fixture
def proxy(company: Company, monkeypatch: pytest.MonkeyPatch) -> Iterator[Proxy]:
    """The proxy of all kinds of addresses, on a machine that trusts the company."""
    for name in [one for one in os.environ if one.lower().endswith("_proxy")]:
        monkeypatch.delenv(name)
    proxy = Proxy(company.port)
    for name in ("http_proxy", "https_proxy", "all_proxy"):
        monkeypatch.setenv(name, proxy.url)
    monkeypatch.setenv("REQUESTS_CA_BUNDLE", str(company.authority))
    yield proxy
    proxy.listening.close()


def asked(url: str) -> str:
    with HttpSession(load_settings(dotenv=False)) as session:
        return send(session, "GET", url).text


def test_an_authority_that_nobody_named_is_not_trusted(company: Company, here: Here) -> None:
    with pytest.raises(Untrusted, match=f"certificate of 127.0.0.1:{company.port} is not trusted"):
        asked(company.url)
    with pytest.raises(Untrusted, match="is not trusted"):
        remote_folders(f"{company.url}/release")
    env = {"YOUTUBE_API_KEY": SECRET, "KB_YOUTUBE_ENDPOINT": company.url}
    done = here("youtube", "crawl", "--only", "channels", env=env)
    assert (done.code, "is not trusted" in done.said) == (4, True), done.err
    assert "REQUESTS_CA_BUNDLE" in done.said


@pytest.mark.parametrize("name", certificates.VARIABLES)
def test_each_variable_names_an_authority(
    company: Company, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(name, str(company.authority))
    assert asked(company.url) == "fine"


def test_a_service_is_asked_through_the_proxy_which_sees_no_key(proxy: Proxy) -> None:
    assert asked(f"https://{HOST}/list?key={SECRET}") == "fine"
    with pytest.raises(KbError):  # the answer is no listing
        remote_folders(f"https://{HOST}/release?key={SECRET}")
    assert {line.rpartition(" ")[0] for line in proxy.asked} == {f"CONNECT {HOST}:443"}
    assert len(proxy.asked) >= 2
    assert SECRET.encode() not in proxy.seen


def test_what_stands_for_the_web_site_on_this_machine_is_asked_directly(
    proxy: Proxy, company: Company
) -> None:
    with HttpSession(load_settings(dotenv=False)) as session:
        session.mount("", SiteDoor(company.url, lambda _: None))
        assert session.get(f"{SITE}watch?v=x").text == "fine"
    assert proxy.asked == []


def test_the_hub_has_the_same_proxy_and_authorities(proxy: Proxy, company: Company) -> None:
    needs("huggingface_hub")
    import huggingface_hub
    from huggingface_hub.utils import get_session

    try:
        hub_client.use_own_client(company.url)
        assert get_session().get(company.url).text == "fine"
        assert proxy.asked == []
        hub_client.use_own_client(f"https://{HOST}")
        assert get_session().get(f"https://{HOST}/?key={SECRET}").text == "fine"
        assert get_session().get(company.url).text == "fine"  # as after a redirect
        assert [line.rpartition(" ")[0] for line in proxy.asked] == [f"CONNECT {HOST}:443"]
        assert SECRET.encode() not in proxy.seen
        with pytest.raises(SettingError, match="not https"):
            hub_client.use_own_client(f"http://{HOST}")
    finally:
        huggingface_hub.set_client_factory(huggingface_hub.utils._http.default_client_factory)


def test_the_doctor_checks_the_file_of_authorities(
    company: Company, here: Here, tmp_path: Path
) -> None:
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "text").write_text("no certificate")
    for name, why in (
        ("absent", "No such file or directory"),
        ("fifo", "it is a FIFO, not a file"),
        ("text", "it has no certificate in PEM"),
    ):
        done = here("doctor", env={"SSL_CERT_FILE": str(tmp_path / name)})
        line = next(one for one in done.out.splitlines() if " certificates: " in one)
        assert line.startswith("problem "), line
        assert why in line
    done = here("doctor", env={"SSL_CERT_FILE": str(company.authority), "https_proxy": "p:1"})
    assert f"certificates: {company.authority} (SSL_CERT_FILE)" in done.out
    assert "proxy of https: p:1" in done.out


@pytest.mark.parametrize(("mode", "told"), [(0o600, False), (0o644, True), (0o640, True)])
def test_the_doctor_says_when_others_can_read_the_keys(
    here: Here, tmp_path: Path, mode: int, told: bool
) -> None:
    (tmp_path / "here" / ".env").write_text("")
    (tmp_path / "here" / ".env").chmod(mode)
    assert ("run `chmod 600 .env`" in here("doctor").out) == told


def zenodo(url: str) -> object:
    return Zenodo(HttpSession(load_settings(dotenv=False)), url, "token").drafts()


def hub(url: str) -> object:
    return Hub(url, "hf_token").account()


@pytest.mark.parametrize("ask", [zenodo, hub])
def test_an_upload_goes_to_nobody_who_is_not_trusted(
    company: Company, ask: Callable[[str], object]
) -> None:
    with pytest.raises(Untrusted, match=r"certificate of \S*127\.0\.0\.1:") as error:
        ask(company.url)
    assert error.value.waits_for == "certificate"


COMMANDS = {
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
    company: Company, command: str, here: Here, tmp_path: Path
) -> None:
    env = {
        "KB_DATA": str(tmp_path / "data"),
        "KB_CONTACT": "somebody@example.org",
        "XDG_CACHE_HOME": str(tmp_path),
        **{name: value.format(url=company.url) for name, value in COMMANDS[command].items()},
    }
    done = here(*command.split(), env=env)
    assert done.code == ActionNeeded.exit_code, done.err
    assert done.said.startswith("kb: the certificate of 127.0.0.1:")
