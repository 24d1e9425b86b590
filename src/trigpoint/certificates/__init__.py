"""Claims about an observer that somebody else can check: rigorous arithmetic, nothing shared with the design."""

from trigpoint.certificates.base import Claim
from trigpoint.certificates.convergence import Convergence
from trigpoint.certificates.covariance import CovarianceBound
from trigpoint.certificates.delay import DelayMargin
from trigpoint.certificates.locality import Locality
from trigpoint.certificates.mean_square import MeanSquareStability
from trigpoint.certificates.noise import NoiseBudget
from trigpoint.certificates.observable import Observable
from trigpoint.certificates.sampled import SampledStability
from trigpoint.certificates.smallest_eigenvalue import SmallestEigenvalue
from trigpoint.certificates.switching import SwitchingStability
from trigpoint.certificates.verb import CLAIMS, Verdict, certify, verify
from trigpoint.observers.certificate import Certificate, ClaimRecord

__all__ = [
    "CLAIMS",
    "Certificate",
    "Claim",
    "ClaimRecord",
    "Convergence",
    "CovarianceBound",
    "DelayMargin",
    "Locality",
    "MeanSquareStability",
    "NoiseBudget",
    "Observable",
    "SampledStability",
    "SmallestEigenvalue",
    "SwitchingStability",
    "Verdict",
    "certify",
    "verify",
]
