"""The public conformance kit: checks your own observers, formats and transports. ``strategies`` needs Hypothesis."""

from trigpoint.testing.formats import check_format
from trigpoint.testing.observers import check_design, check_observer
from trigpoint.testing.transports import check_transport

__all__ = ["check_design", "check_format", "check_observer", "check_transport"]
