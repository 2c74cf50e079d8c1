"""Certificates that TLS libraries other than ours believe, made once and never overwritten."""

import asyncio
import ssl
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from daemon.host.clock import MonotonicClock, run_in_real_time
from daemon.remote.certificates import CertificateError, CertificateFolder


def folder(path: Path, days: int = 30) -> CertificateFolder:
    return CertificateFolder(path, MonotonicClock().wall_time_ns(), days)


def certificate(path: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(path.read_bytes())


def test_what_is_made_for_a_host_and_users(tmp_path: Path) -> None:
    made = folder(tmp_path / "c").make(["192.168.1.10", "robot.lab", "::1"], ["alice", "bob"])
    assert sorted(path.name for path in made) == sorted(
        f"{name}.{ending}" for name in ("ca", "server", "alice", "bob") for ending in ("key", "pem")
    )
    assert (tmp_path / "c").stat().st_mode & 0o777 == 0o700
    for path in made:
        assert path.stat().st_mode & 0o777 == (0o600 if path.suffix == ".key" else 0o644)
    server, alice = certificate(tmp_path / "c/server.pem"), certificate(tmp_path / "c/alice.pem")
    names = server.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["robot.lab"]
    assert list(map(str, names.get_values_for_type(x509.IPAddress))) == ["192.168.1.10", "::1"]
    (name,) = alice.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    assert name.value == "alice"
    for one, purpose in (
        (server, ExtendedKeyUsageOID.SERVER_AUTH),
        (alice, ExtendedKeyUsageOID.CLIENT_AUTH),
    ):
        usage = one.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
        assert list(usage) == [purpose]
        one.verify_directly_issued_by(certificate(tmp_path / "c/ca.pem"))
        days = (one.not_valid_after_utc - one.not_valid_before_utc).days
        assert days == 30
    key = (tmp_path / "c/alice.key").read_bytes()
    assert key.startswith(b"-----BEGIN PRIVATE KEY-----")
    private = load_pem_private_key(key, None)
    assert isinstance(private, ec.EllipticCurvePrivateKey)
    assert private.curve.name == "secp256r1"


def test_python_s_own_tls_shakes_hands_with_them(tmp_path: Path) -> None:
    folder(tmp_path).make(["127.0.0.1"], ["alice"])

    async def test() -> None:
        names: list[object] = []
        done = asyncio.Event()

        async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            names.append(writer.get_extra_info("peercert")["subject"])
            writer.write(b"hello")
            writer.close()
            done.set()

        listening = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH, cafile=tmp_path / "ca.pem")
        listening.verify_mode = ssl.CERT_REQUIRED
        listening.load_cert_chain(tmp_path / "server.pem", tmp_path / "server.key")
        asking = ssl.create_default_context(cafile=tmp_path / "ca.pem")
        asking.load_cert_chain(tmp_path / "alice.pem", tmp_path / "alice.key")
        server = await asyncio.start_server(serve, "127.0.0.1", 0, ssl=listening)
        port = server.sockets[0].getsockname()[1]
        async with asyncio.timeout(20):
            reader, writer = await asyncio.open_connection("127.0.0.1", port, ssl=asking)
            assert await reader.read() == b"hello"
            await done.wait()
        writer.close()
        server.close()
        assert names == [((("commonName", "alice"),),)]

    run_in_real_time(test())


def test_nothing_is_ever_overwritten(tmp_path: Path) -> None:
    folder(tmp_path).make(["localhost"], ["alice"])
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    for hosts, users in ((["localhost"], []), ([], ["alice"]), ([], ["carol", "alice"])):
        with pytest.raises(CertificateError, match="would be overwritten"):
            folder(tmp_path).make(hosts, users)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_user_who_comes_later_is_signed_by_the_same_authority(tmp_path: Path) -> None:
    folder(tmp_path).make(["localhost"], [])
    made = folder(tmp_path, days=365).make([], ["carol"])
    assert [path.name for path in made] == ["carol.key", "carol.pem"]
    certificate(tmp_path / "carol.pem").verify_directly_issued_by(certificate(tmp_path / "ca.pem"))


@pytest.mark.parametrize("users", [["ca"], ["server"], ["alice", "alice"]])
def test_names_that_would_clash_are_refused(tmp_path: Path, users: list[str]) -> None:
    with pytest.raises(CertificateError, match="a name of its own"):
        folder(tmp_path).make(["localhost"], users)
    assert list(tmp_path.iterdir()) == []


def test_half_an_authority_and_a_broken_one_are_refused(tmp_path: Path) -> None:
    folder(tmp_path).make([], ["alice"])
    (tmp_path / "ca.key").write_bytes(b"not a key")
    with pytest.raises(CertificateError, match="the authority is bad"):
        folder(tmp_path).make([], ["bob"])
    (tmp_path / "ca.key").unlink()
    with pytest.raises(CertificateError, match="one is missing"):
        folder(tmp_path).make([], ["bob"])


def test_certificates_never_outlive_their_authority(tmp_path: Path) -> None:
    folder(tmp_path).make([], ["alice"])
    with pytest.raises(CertificateError, match="ends on"):
        folder(tmp_path, days=5000).make([], ["bob"])


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(CertificateError, match="file"):
        folder(tmp_path / "file" / "c").make([], ["alice"])
