"""Figures and pages: SVG text of networks and errors, and one self-contained HTML file. Needs the extra ``report``.

Importing this package loads neither matplotlib nor jinja2; the first figure or page does.
"""

from trigpoint.graphs.layout import node_positions
from trigpoint.report.figures import error_figure, network_figure, series_figure
from trigpoint.report.live_page import live_page
from trigpoint.report.page import Figure, Page, Section, Table, render
from trigpoint.report.run_page import run_page

__all__ = [
    "Figure",
    "Page",
    "Section",
    "Table",
    "error_figure",
    "live_page",
    "network_figure",
    "node_positions",
    "render",
    "run_page",
    "series_figure",
]
