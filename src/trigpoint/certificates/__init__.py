"""Claims about an observer that somebody else can check: rigorous arithmetic, nothing shared with the design."""

from trigpoint.certificates.base import Claim
from trigpoint.certificates.convergence import Convergence
from trigpoint.certificates.locality import Locality
from trigpoint.certificates.smallest_eigenvalue import SmallestEigenvalue
from trigpoint.certificates.verb import CLAIMS, Verdict, certify, verify
from trigpoint.observers.certificate import Certificate, ClaimRecord

__all__ = [
    "CLAIMS",
    "Certificate",
    "Claim",
    "ClaimRecord",
    "Convergence",
    "Locality",
    "SmallestEigenvalue",
    "Verdict",
    "certify",
    "verify",
]
