"""Figures as SVG text, ready to stand in a page, and moving pictures as files."""

from trigpoint.report._animation import ANIMATIONS, animation
from trigpoint.report._curves import curves_figure, pictures_figure
from trigpoint.report._error import error_figure
from trigpoint.report._network import network_figure
from trigpoint.report._run import connectivity_figure, trajectory_figure
from trigpoint.report._staging import Staging

__all__ = [
    "ANIMATIONS",
    "Staging",
    "animation",
    "connectivity_figure",
    "curves_figure",
    "error_figure",
    "network_figure",
    "pictures_figure",
    "trajectory_figure",
]
