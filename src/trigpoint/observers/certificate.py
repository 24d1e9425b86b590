"""``Certificate``: claims about an observer with the witnesses that prove them. A pure value; no code in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from trigpoint.arrays import FloatArray, decode_array, digest_of, encode_array
from trigpoint.errors import ProtocolError

KIND = "trigpoint/certificate"
VERSION = 1

Outcome = Literal["certified", "refuted", "inconclusive"]
OUTCOMES: tuple[Outcome, ...] = ("certified", "refuted", "inconclusive")
_MOST_CLAIMS = 100
_FIELDS = {"claim", "verdict", "numbers", "assumptions", "text", "witness"}


@dataclass(frozen=True, eq=False)
class ClaimRecord:
    """One claim: its numbers, the witness that proves it, and the verdict.

    Attributes:
        claim: name of the claim.
        verdict: ``certified``, ``refuted`` or ``inconclusive``.
        numbers: the claim's numbers, by name.
        assumptions: what is taken for granted, in words.
        text: the claim in one sentence.
        witness: arrays that a checker evaluates again.
    """

    claim: str
    verdict: Outcome
    numbers: Mapping[str, float]
    assumptions: tuple[str, ...]
    text: str
    witness: Mapping[str, FloatArray]


@dataclass(frozen=True, eq=False)
class Certificate:
    """Claims about one observer of one problem.

    Attributes:
        problem_digest: SHA-256 of the problem's document.
        observer_digest: SHA-256 of the observer's document.
        records: the claims, each with its witness and verdict.
    """

    problem_digest: str
    observer_digest: str
    records: tuple[ClaimRecord, ...]

    @property
    def verdict(self) -> Outcome:
        """The worst verdict of all claims: refuted before inconclusive before certified."""
        found = {record.verdict for record in self.records}
        return "refuted" if "refuted" in found else "inconclusive" if "inconclusive" in found else "certified"

    def summary(self) -> str:
        """The claims in words, a line each."""
        return "\n".join(f"{record.verdict}: {record.text}" for record in self.records)


def certificate_document(certificate: Certificate) -> dict[str, Any]:
    """The certificate as a JSON object with a digest over its whole body."""
    body = {
        "kind": KIND,
        "version": VERSION,
        "problem": certificate.problem_digest,
        "observer": certificate.observer_digest,
        "verdict": certificate.verdict,
        "claims": [
            {
                "claim": record.claim,
                "verdict": record.verdict,
                "numbers": dict(record.numbers),
                "assumptions": list(record.assumptions),
                "text": record.text,
                "witness": {name: encode_array(array) for name, array in record.witness.items()},
            }
            for record in certificate.records
        ],
    }
    return {**body, "digest": digest_of(body)}


def read_certificate(document: Mapping[str, Any]) -> Certificate:
    """Read ``certificate_document``; a wrong digest, version or shape is a ``ProtocolError``."""
    if not isinstance(document, Mapping):
        raise ProtocolError(f"a certificate is a JSON object; got {type(document).__name__}")
    if document.get("kind") != KIND or type(document.get("version")) is not int or document["version"] != VERSION:
        raise ProtocolError(f"expected kind {KIND!r}, version {VERSION}; got {document.get('version')!r}")
    body = {key: value for key, value in document.items() if key != "digest"}
    try:
        actual = digest_of(body)
    except (RecursionError, TypeError, ValueError) as error:
        raise ProtocolError(f"the certificate holds something that JSON has no word for ({error})") from error
    if document.get("digest") != actual:
        raise ProtocolError("the certificate's digest does not match its body: it was changed or damaged")
    if set(body) != {"kind", "version", "problem", "observer", "verdict", "claims"} or type(body["claims"]) is not list:
        raise ProtocolError("a certificate holds kind, version, problem, observer, verdict, claims and digest")
    if len(body["claims"]) > _MOST_CLAIMS:
        raise ProtocolError(f"a certificate holds at most {_MOST_CLAIMS} claims; got {len(body['claims'])}")
    if not isinstance(body["problem"], str) or not isinstance(body["observer"], str):
        raise ProtocolError("problem and observer must be digests, as text")
    certificate = Certificate(body["problem"], body["observer"], tuple(_read_record(r) for r in body["claims"]))
    if not certificate.records or body["verdict"] != certificate.verdict:
        raise ProtocolError("the certificate's verdict is not that of its claims")
    return certificate


def _read_record(entry: Any) -> ClaimRecord:
    if not isinstance(entry, dict) or set(entry) != _FIELDS:
        raise ProtocolError(f"a claim holds {', '.join(sorted(_FIELDS))}")
    numbers, assumptions, witness = entry["numbers"], entry["assumptions"], entry["witness"]
    fits = (
        isinstance(entry["claim"], str)
        and isinstance(entry["text"], str)
        and entry["verdict"] in OUTCOMES
        and isinstance(numbers, dict)
        and all(_is_number(value) for value in numbers.values())
        and isinstance(assumptions, list)
        and all(isinstance(text, str) for text in assumptions)
        and isinstance(witness, dict)
    )
    if not fits:
        raise ProtocolError(f"the claim {entry['claim']!r} has a field of the wrong type")
    arrays = {name: decode_array(array, name) for name, array in witness.items()}
    return ClaimRecord(
        entry["claim"],
        entry["verdict"],
        {name: float(value) for name, value in numbers.items()},
        tuple(assumptions),
        entry["text"],
        arrays,
    )


def _is_number(value: Any) -> bool:
    return type(value) is float or (type(value) is int and abs(value) <= 2**53)
