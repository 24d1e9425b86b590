"""The public conformance kit: checks for your own observers and formats. ``strategies`` needs Hypothesis."""

from trigpoint.testing.formats import check_format
from trigpoint.testing.observers import check_design, check_observer

__all__ = ["check_design", "check_format", "check_observer"]
