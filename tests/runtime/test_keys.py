"""Certificates: what they say, that keys stay private, and that nothing is overwritten unasked."""

from __future__ import annotations

import datetime
import stat
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec

from trigpoint.errors import ArgumentError, MissingExtraError
from trigpoint.runtime import find_identity, make_keys
from trigpoint.runtime.topics import written

ODD = "Nord 3/ü*"


def certificate(path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(Path(path).read_bytes())


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_certificates_name_their_node_and_are_signed(tmp_path) -> None:
    made = make_keys(tmp_path / "keys", ["a", ODD], ["10.0.0.1", "hub-1.lan"], guests={"m": "monitor"})
    assert list(made) == ["a", ODD, "m"]
    authority = certificate(tmp_path / "keys" / "authority.pem")
    for name, identity in made.items():
        assert find_identity(tmp_path / "keys", name) == identity
        own = certificate(identity.certificate)
        own.verify_directly_issued_by(authority)
        (common,) = own.subject.get_attributes_for_oid(x509.NameOID.COMMON_NAME)
        assert common.value == written(name)
        key = own.public_key()
        assert isinstance(key, ec.EllipticCurvePublicKey)
        assert isinstance(key.curve, ec.SECP256R1)
        hosts = own.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        assert {"localhost", "hub-1.lan"} == set(hosts.get_values_for_type(x509.DNSName))
        assert {"127.0.0.1", "::1", "10.0.0.1"} == {str(ip) for ip in hosts.get_values_for_type(x509.IPAddress)}
        assert not own.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    assert authority.extensions.get_extension_for_class(x509.BasicConstraints).value.ca


def test_private_keys_are_private_and_nothing_leaves_the_folder(tmp_path) -> None:
    make_keys(tmp_path / "keys", ["a", "../b"])
    assert [path.name for path in tmp_path.iterdir()] == ["keys"]
    assert stat.S_IMODE((tmp_path / "keys").stat().st_mode) == 0o700
    keys = sorted((tmp_path / "keys").glob("*.key"))
    assert [path.name for path in keys] == ["..%2Fb.key", "a.key", "authority.key"]
    assert {stat.S_IMODE(path.stat().st_mode) for path in keys} == {0o600}


def test_a_newcomer_joins_the_same_authority_and_nothing_is_overwritten_unasked(tmp_path) -> None:
    make_keys(tmp_path, ["a"])
    before = contents(tmp_path)
    made = make_keys(tmp_path, ["new"])
    certificate(made["new"].certificate).verify_directly_issued_by(certificate(tmp_path / "authority.pem"))
    assert before.items() <= contents(tmp_path).items()
    with pytest.raises(ArgumentError, match=r"a\.pem exists"):
        make_keys(tmp_path, ["other", "a"])
    assert len(contents(tmp_path)) == 6
    again = make_keys(tmp_path, ["a"], overwrite=True)
    assert not before.items() & contents(tmp_path).items()
    with pytest.raises(InvalidSignature):
        certificate(made["new"].certificate).verify_directly_issued_by(certificate(again["a"].authority))


@pytest.mark.parametrize("spoil", [lambda key: key.unlink(), lambda key: key.write_text("no key")])
def test_an_authority_that_cannot_sign_is_no_reason_to_replace_it(tmp_path, spoil) -> None:
    make_keys(tmp_path, ["a"])
    spoil(tmp_path / "authority.key")
    before = contents(tmp_path)
    with pytest.raises(ArgumentError, match="no authority that can sign"):
        make_keys(tmp_path, ["b"])
    assert contents(tmp_path) == before


@pytest.mark.parametrize(
    ("names", "options", "words"),
    [
        ([], {}, "at least one name"),
        (["a", "a"], {}, "'a' is given twice"),
        (["a"], {"guests": {"a": "monitor"}}, "'a' is given twice"),
        (["authority"], {}, "can be no name"),
        ([""], {}, "can be no name"),
        (["x" * 65], {}, "65 characters in a certificate, which holds 64"),
        (["ü" * 11], {}, "66 characters"),
        (["a"], {"guests": {"m": "king"}}, "role of the guest 'm' must be sensor"),
        (["a"], {"days": 0}, "at least one day"),
        (["a"], {"hosts": ["10.0.0.1:7447"]}, "without a port"),
        (["a"], {"hosts": [""]}, "without a port"),
    ],
)
def test_what_does_not_fit_is_refused_before_anything_is_written(tmp_path, names, options, words) -> None:
    with pytest.raises(ArgumentError, match=words):
        make_keys(tmp_path / "keys", names, **options)
    assert not (tmp_path / "keys").exists()


def test_missing_files_are_named(tmp_path) -> None:
    with pytest.raises(ArgumentError, match=r"authority\.pem is missing"):
        find_identity(tmp_path, "a")


def test_without_the_package_the_extra_is_named(tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "cryptography", None)
    with pytest.raises(MissingExtraError, match=r"cryptography.*trigpoint\[live\]"):
        make_keys(tmp_path / "keys", ["a"])
    assert not (tmp_path / "keys").exists()


def other_authority(folder: Path) -> None:
    make_keys(folder / "other", ["a"])
    (folder / "authority.pem").write_bytes((folder / "other" / "authority.pem").read_bytes())


def member_for_authority(folder: Path) -> None:
    for ending in ("pem", "key"):
        (folder / f"authority.{ending}").write_bytes((folder / f"a.{ending}").read_bytes())


def plain_certificate(folder: Path) -> None:
    """One of somebody's own making, which does not say that it may sign."""
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "mine")])
    key = serialization.load_pem_private_key((folder / "authority.key").read_bytes(), None)
    now = datetime.datetime.now(datetime.UTC)
    made = x509.CertificateBuilder(name, name, key.public_key(), 1, now, now + datetime.timedelta(days=9))
    (folder / "authority.pem").write_bytes(made.sign(key, hashes.SHA256()).public_bytes(serialization.Encoding.PEM))


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (other_authority, "the key belongs to another certificate"),
        (member_for_authority, "the certificate is a member's"),
        (plain_certificate, "the certificate is a member's"),
    ],
)
def test_nobody_is_signed_by_what_nobody_would_trust(tmp_path, spoil, why) -> None:
    make_keys(tmp_path, ["a"])
    spoil(tmp_path)
    with pytest.raises(ArgumentError, match=f"no authority that can sign .{why}"):
        make_keys(tmp_path, ["b"])
    assert not (tmp_path / "b.pem").exists()


def test_an_authority_that_has_expired_signs_nobody(tmp_path, monkeypatch) -> None:
    make_keys(tmp_path, ["a"], days=2)
    later = datetime.datetime.now(datetime.UTC) + datetime.timedelta(days=3)
    clock = SimpleNamespace(datetime=SimpleNamespace(now=lambda _: later), UTC=datetime.UTC)
    monkeypatch.setattr("trigpoint.runtime.keys.datetime", clock)
    with pytest.raises(ArgumentError, match="the certificate has expired"):
        make_keys(tmp_path, ["b"])
