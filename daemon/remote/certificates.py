"""Certificates for `tls`: an authority of the lab's own, the daemon's, and one per user."""

import ipaddress
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
)
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

_AUTHORITY: Final = "tentacled lab authority"
_NS_PER_S: Final = 1_000_000_000
_S_PER_DAY: Final = 86_400
_AUTHORITY_DAYS: Final = 3650
_EARLIER_S: Final = 3600
"""Clocks of other machines may be behind."""


class CertificateError(RuntimeError):
    """Certificates were not made; the text says why."""


@dataclass(frozen=True)
class _Pair:
    """A key and the certificate for it."""

    key: ec.EllipticCurvePrivateKey
    certificate: x509.Certificate


class CertificateFolder:
    """A folder with `ca`, `server` and users' certificates (`.pem`) and keys (`.key`).

    `ca.key` belongs in a safe place: whoever has it can be anybody. Nothing is ever overwritten.
    """

    def __init__(self, path: Path, wall_time_ns: int, days: int) -> None:
        """wall_time_ns: now. days: how long new certificates are good for."""
        self._path = path
        now_s = wall_time_ns // _NS_PER_S
        self._from, self._until = _utc(now_s - _EARLIER_S), _utc(now_s + days * _S_PER_DAY)
        self._authority_until = _utc(now_s + max(days, _AUTHORITY_DAYS) * _S_PER_DAY)

    def make(self, hosts: Sequence[str], users: Sequence[str]) -> list[Path]:
        """Make what is missing for these hosts and users. Returns the new files.

        An authority that is there already signs the new ones. Raises CertificateError.
        """
        wanted = [*(["server"] if hosts else []), *users]
        names = [f"{name}{ending}" for name in wanted for ending in (".pem", ".key")]
        there = [name for name in names if (self._path / name).exists()]
        if there:
            raise CertificateError(
                f"{', '.join(there)} in {self._path} would be overwritten: take them away first"
            )
        if len(set(wanted)) < len(wanted) or {"ca", "server"} & set(users):
            raise CertificateError("each user needs a name of its own, and not 'ca' or 'server'")
        try:
            self._path.mkdir(parents=True, exist_ok=True, mode=0o700)
            authority, made = self._authority()
            if hosts:
                made += self._write("server", self._server(authority, hosts))
            for user in users:
                made += self._write(user, self._user(authority, user))
        except OSError as error:
            raise CertificateError(f"{error.filename}: {error.strerror}") from None
        return made

    def _authority(self) -> tuple[_Pair, list[Path]]:
        certificate, key = self._path / "ca.pem", self._path / "ca.key"
        if certificate.exists() and key.exists():
            return self._read_authority(certificate, key), []
        if certificate.exists() or key.exists():
            raise CertificateError(f"{certificate} and {key} belong together: one is missing")
        made = self._self_signed()
        return made, self._write("ca", made)

    def _read_authority(self, certificate: Path, key: Path) -> _Pair:
        try:
            loaded = load_pem_private_key(key.read_bytes(), password=None)
            found = x509.load_pem_x509_certificate(certificate.read_bytes())
        except (ValueError, TypeError) as error:
            raise CertificateError(f"{certificate.parent}: the authority is bad: {error}") from None
        if not isinstance(loaded, ec.EllipticCurvePrivateKey):
            raise CertificateError(f"{key} is no elliptic-curve key")
        if found.not_valid_after_utc.replace(tzinfo=None) < self._until:
            raise CertificateError(
                f"the authority in {certificate} ends on {found.not_valid_after_utc:%Y-%m-%d}: "
                "make certificates for fewer days, or a new folder"
            )
        return _Pair(loaded, found)

    def _self_signed(self) -> _Pair:
        key = ec.generate_private_key(ec.SECP256R1())
        builder = self._builder(_AUTHORITY, key.public_key(), _name(_AUTHORITY))
        builder = builder.not_valid_after(self._authority_until)
        usage = x509.KeyUsage(
            digital_signature=True,
            key_cert_sign=True,
            crl_sign=True,
            content_commitment=False,
            key_encipherment=False,
            data_encipherment=False,
            key_agreement=False,
            encipher_only=False,
            decipher_only=False,
        )
        builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), True)
        builder = builder.add_extension(usage, True)
        identifier = x509.SubjectKeyIdentifier.from_public_key(key.public_key())
        builder = builder.add_extension(identifier, False)
        return _Pair(key, builder.sign(key, hashes.SHA256()))

    def _server(self, authority: _Pair, hosts: Sequence[str]) -> _Pair:
        names = x509.SubjectAlternativeName([_host(host) for host in hosts])
        return self._signed(authority, hosts[0], ExtendedKeyUsageOID.SERVER_AUTH, names)

    def _user(self, authority: _Pair, user: str) -> _Pair:
        names = x509.SubjectAlternativeName([x509.DNSName(user)])
        return self._signed(authority, user, ExtendedKeyUsageOID.CLIENT_AUTH, names)

    def _signed(
        self,
        authority: _Pair,
        common_name: str,
        purpose: x509.ObjectIdentifier,
        names: x509.SubjectAlternativeName,
    ) -> _Pair:
        key = ec.generate_private_key(ec.SECP256R1())
        issuer = authority.certificate.subject
        authority_identifier = x509.AuthorityKeyIdentifier.from_issuer_public_key(
            authority.key.public_key()
        )
        builder = (
            self._builder(common_name, key.public_key(), issuer)
            .not_valid_after(self._until)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), True)
            .add_extension(x509.ExtendedKeyUsage([purpose]), False)
            .add_extension(authority_identifier, False)
            .add_extension(names, False)
        )
        return _Pair(key, builder.sign(authority.key, hashes.SHA256()))

    def _builder(
        self, common_name: str, key: ec.EllipticCurvePublicKey, issuer: x509.Name
    ) -> x509.CertificateBuilder:
        return (
            x509.CertificateBuilder()
            .subject_name(_name(common_name))
            .issuer_name(issuer)
            .public_key(key)
            .serial_number(x509.random_serial_number())
            .not_valid_before(self._from)
        )

    def _write(self, name: str, pair: _Pair) -> list[Path]:
        key = pair.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
        certificate = pair.certificate.public_bytes(Encoding.PEM)
        return [
            _new_file(self._path / f"{name}.key", key, 0o600),
            _new_file(self._path / f"{name}.pem", certificate, 0o644),
        ]


def _utc(wall_time_s: int) -> Any:
    """As cryptography takes it: a date without a zone, in UTC."""
    return np.datetime64(wall_time_s, "s").item()


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host.strip("[]")))
    except ValueError:
        return x509.DNSName(host)


def _new_file(path: Path, content: bytes, mode: int) -> Path:
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode)
    with os.fdopen(descriptor, "wb") as file:
        file.write(content)
    return path
