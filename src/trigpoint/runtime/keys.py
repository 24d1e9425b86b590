"""Certificates for mutual TLS: one authority for a network, one certificate for each node and each guest."""

from __future__ import annotations

import datetime
import ipaddress
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from trigpoint.errors import ArgumentError, MissingExtraError
from trigpoint.runtime.access import ROLES
from trigpoint.runtime.files import write_whole
from trigpoint.runtime.settings import Identity
from trigpoint.runtime.topics import written

AUTHORITY = "authority"
"""Name of the authority's two files; no node and no guest may be called so."""

GUESTS: Mapping[str, str] = {"plant": "sensor", "monitor": "monitor", "supervisor": "supervisor"}
"""Guests of a network that ``trigpoint run`` starts: the simulated plant, the log and the page, the supervisor."""

_LONGEST_COMMON_NAME = 64  # X.509 allows no more
_LOOPBACK = ("localhost", "127.0.0.1", "::1")


class _Pair(NamedTuple):
    certificate: Any
    key: Any


def make_keys(
    folder: Path,
    names: Iterable[str],
    hosts: Iterable[str] = (),
    *,
    guests: Mapping[str, str] | None = None,
    days: int = 365,
    overwrite: bool = False,
) -> Mapping[str, Identity]:
    """Make an authority and a certificate for every node and guest; elliptic curve P-256, names as ``written``.

    The folder gets ``authority.pem`` and, for each name, ``NAME.pem`` and ``NAME.key``. Every node needs its own two
    files and ``authority.pem``. The authority's own key, ``authority.key``, belongs on none of the hosts; it stays in
    the folder, so that a later call adds nodes to the same network.

    Args:
        folder: made if it is missing; readable by its owner only.
        names: of the nodes.
        hosts: names or numbers of the machines that nodes listen on, besides loopback.
        guests: further names, and the role of each (one of ``ROLES``).
        days: for how long the certificates hold.
        overwrite: make everything afresh where files of these names exist, the authority included.

    Returns:
        By name, the files for ``NodeSettings.identity``.

    We assume:
        - the folder stays with whoever runs the network; private keys are readable by their owner only (0600).

    Raises:
        ArgumentError: a name, a host or a role does not fit, or a file exists already.
        MissingExtraError: the package cryptography is not installed.
    """
    guests = {} if guests is None else guests
    everybody = [*names, *guests]
    _check_names(everybody, guests, days)
    alternative = _alternative_names([*_LOOPBACK, *hosts])
    files = {name: _files(folder, name) for name in everybody}
    authority_file, authority_key = folder / f"{AUTHORITY}.pem", folder / f"{AUTHORITY}.key"
    taken = [path for identity in files.values() for path in (identity.certificate, identity.key) if _exists(path)]
    if taken and not overwrite:
        raise ArgumentError(f"{taken[0]} exists; name another folder, or allow overwriting to make all keys afresh")
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if not overwrite and (authority_file.exists() or authority_key.exists()):
        authority = _read_pair(authority_file, authority_key)
    else:
        authority = _make_authority(days)
        _write_pair(authority, authority_file, authority_key)
    for name in everybody:
        pair = _make_member(written(name), authority, alternative, days)
        _write_pair(pair, Path(files[name].certificate), Path(files[name].key))
    return files


def find_identity(folder: Path, name: str) -> Identity:
    """The files that ``make_keys`` wrote to ``folder`` for ``name``.

    Raises:
        ArgumentError: one of them is missing.
    """
    identity = _files(folder, name)
    missing = [path for path in vars(identity).values() if not _exists(path)]
    if missing:
        raise ArgumentError(f"{missing[0]} is missing; make the keys of {name!r} with 'trigpoint keys'")
    return identity


def _files(folder: Path, name: str) -> Identity:
    """Files are named as keys are, so that any text fits and no name leaves the folder."""
    part = written(name)
    return Identity(*(str(folder / file) for file in (f"{AUTHORITY}.pem", f"{part}.pem", f"{part}.key")))


def _exists(path: str) -> bool:
    return Path(path).exists()


def _check_names(everybody: list[str], guests: Mapping[str, str], days: int) -> None:
    if not everybody:
        raise ArgumentError("names must hold at least one name; got none")
    doubled = sorted({name for name in everybody if everybody.count(name) > 1})
    if doubled:
        raise ArgumentError(f"each node and guest needs a name of its own; {doubled[0]!r} is given twice")
    for name in everybody:
        if name in ("", ".", "..", AUTHORITY):
            raise ArgumentError(f"{name!r} can be no name of a certificate; rename the node")
        if len(written(name)) > _LONGEST_COMMON_NAME:
            raise ArgumentError(
                f"the name {name!r} takes {len(written(name))} characters in a certificate, which holds"
                f" {_LONGEST_COMMON_NAME}; rename the node"
            )
    for guest, role in guests.items():
        if role not in ROLES:
            raise ArgumentError(f"the role of the guest {guest!r} must be {', '.join(ROLES)}; got {role!r}")
    if days < 1:
        raise ArgumentError(f"certificates must hold for at least one day; got {days}")


def _crypto() -> Any:
    try:
        from cryptography import x509
    except ImportError as error:
        raise MissingExtraError("cryptography", "live", "making keys") from error
    return x509


def _alternative_names(hosts: list[str]) -> Any:
    x509 = _crypto()
    names: list[Any] = []
    for host in dict.fromkeys(hosts):
        try:
            names.append(x509.IPAddress(ipaddress.ip_address(host)))
        except ValueError:  # no number: a name
            if not host or not all(part.isalnum() and part.isascii() for part in host.replace("-", "").split(".")):
                raise ArgumentError(f"host {host!r} must be the name or number of a machine, without a port") from None
            names.append(x509.DNSName(host))
    return x509.SubjectAlternativeName(names)


def _builder(x509: Any, common_name: str, days: int) -> tuple[Any, Any]:
    from cryptography.hazmat.primitives.asymmetric import ec

    key = ec.generate_private_key(ec.SECP256R1())
    now = datetime.datetime.now(datetime.UTC)
    builder = (
        x509.CertificateBuilder()
        .subject_name(_name(x509, common_name))
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(hours=1))  # clocks of hosts differ
        .not_valid_after(now + datetime.timedelta(days=days))
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    )
    return builder, key


def _name(x509: Any, common_name: str) -> Any:
    return x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, common_name)])


def _make_authority(days: int) -> _Pair:
    from cryptography.hazmat.primitives import hashes

    x509 = _crypto()
    builder, key = _builder(x509, "trigpoint authority", days)
    certificate = (
        builder.issuer_name(_name(x509, "trigpoint authority"))
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(x509, authority=True), critical=True)
        .sign(key, hashes.SHA256())
    )
    return _Pair(certificate, key)


def _make_member(common_name: str, authority: _Pair, alternative: Any, days: int) -> _Pair:
    from cryptography.hazmat.primitives import hashes

    x509 = _crypto()
    builder, key = _builder(x509, common_name, days)
    both = [x509.ExtendedKeyUsageOID.SERVER_AUTH, x509.ExtendedKeyUsageOID.CLIENT_AUTH]
    issuer = x509.AuthorityKeyIdentifier.from_issuer_public_key(authority.key.public_key())
    certificate = (
        builder.issuer_name(authority.certificate.subject)
        .add_extension(alternative, critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(x509.ExtendedKeyUsage(both), critical=False)
        .add_extension(_usage(x509, authority=False), critical=True)
        .add_extension(issuer, critical=False)
        .sign(authority.key, hashes.SHA256())
    )
    return _Pair(certificate, key)


def _usage(x509: Any, *, authority: bool) -> Any:
    unused = dict.fromkeys(
        ("content_commitment", "key_encipherment", "data_encipherment", "key_agreement", "encipher_only",
         "decipher_only"), False,
    )  # fmt: skip
    return x509.KeyUsage(digital_signature=not authority, key_cert_sign=authority, crl_sign=authority, **unused)


def _write_pair(pair: _Pair, certificate: Path, key: Path) -> None:
    from cryptography.hazmat.primitives import serialization as forms

    private = pair.key.private_bytes(forms.Encoding.PEM, forms.PrivateFormat.PKCS8, forms.NoEncryption())
    write_whole(key, private)
    write_whole(certificate, pair.certificate.public_bytes(forms.Encoding.PEM), 0o644)


def _read_pair(certificate: Path, key: Path) -> _Pair:
    from cryptography.hazmat.primitives import serialization as forms

    try:
        private = forms.load_pem_private_key(key.read_bytes(), password=None)
        pair = _Pair(_crypto().load_pem_x509_certificate(certificate.read_bytes()), private)
        _check_authority(pair)
        return pair
    except (OSError, ValueError, TypeError) as error:
        raise ArgumentError(
            f"{certificate} and {key} are no authority that can sign ({error}); name another folder, or allow"
            " overwriting to make all keys afresh"
        ) from error


def _check_authority(pair: _Pair) -> None:
    """What it signs would be refused, link by link and without a word, where the pair does not belong together."""
    x509 = _crypto()
    if pair.certificate.public_key() != pair.key.public_key():
        raise ValueError("the key belongs to another certificate")
    try:
        signs = pair.certificate.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    except x509.ExtensionNotFound:
        signs = False
    if not signs:
        raise ValueError("the certificate is a member's")
    if pair.certificate.not_valid_after_utc < datetime.datetime.now(datetime.UTC):
        raise ValueError("the certificate has expired")
