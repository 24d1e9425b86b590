"""Figures as SVG text, ready to stand in a page: the network, and the error over time."""

from trigpoint.report._error import error_figure
from trigpoint.report._network import network_figure
from trigpoint.report._series import series_figure

__all__ = ["error_figure", "network_figure", "series_figure"]
