"""Figures and pages: SVG text of networks and errors, and one self-contained HTML file. Needs the extra ``report``.

Importing this package loads neither matplotlib nor jinja2; the first figure or page does.
"""

from trigpoint.graphs.layout import node_positions
from trigpoint.report._engines import require_engines
from trigpoint.report._facts import rate_of
from trigpoint.report.figures import (
    ANIMATIONS,
    Staging,
    animation,
    connectivity_figure,
    curves_figure,
    error_figure,
    network_figure,
    pictures_figure,
    trajectory_figure,
)
from trigpoint.report.live_page import live_page
from trigpoint.report.page import Figure, Page, Section, Table, render
from trigpoint.report.run_page import run_page

__all__ = [
    "ANIMATIONS",
    "Figure",
    "Page",
    "Section",
    "Staging",
    "Table",
    "animation",
    "connectivity_figure",
    "curves_figure",
    "error_figure",
    "live_page",
    "network_figure",
    "node_positions",
    "pictures_figure",
    "rate_of",
    "render",
    "require_engines",
    "run_page",
    "trajectory_figure",
]
