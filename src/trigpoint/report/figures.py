"""Figures as SVG text, ready to stand in a page: networks, errors over time, curves, grey pictures."""

from trigpoint.report._curves import curves_figure, pictures_figure
from trigpoint.report._error import error_figure
from trigpoint.report._network import network_figure

__all__ = ["curves_figure", "error_figure", "network_figure", "pictures_figure"]
