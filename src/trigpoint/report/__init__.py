"""Figures and pages: SVG text of networks and errors, and one self-contained HTML file. Needs the extra ``report``.

Importing this package loads neither matplotlib nor jinja2; the first figure or page does.
"""

from trigpoint.graphs.layout import node_positions
from trigpoint.report._engines import require_engines
from trigpoint.report.figures import (
    ANIMATIONS,
    Scene,
    animation,
    connectivity_figure,
    curves_figure,
    error_figure,
    network_figure,
    pictures_figure,
    series_figure,
    trajectory_figure,
)
from trigpoint.report.live_page import live_page
from trigpoint.report.page import Figure, Page, Section, Table, render
from trigpoint.report.run_page import run_page

__all__ = [
    "ANIMATIONS",
    "Figure",
    "Page",
    "Scene",
    "Section",
    "Table",
    "animation",
    "connectivity_figure",
    "curves_figure",
    "error_figure",
    "live_page",
    "network_figure",
    "node_positions",
    "pictures_figure",
    "render",
    "require_engines",
    "run_page",
    "series_figure",
    "trajectory_figure",
]
