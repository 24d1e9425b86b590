"""Measurement graphs: the type, its algebra, its structure, a gallery of networks and networkx in and out."""

from trigpoint.graphs.algebra import EXTERNAL
from trigpoint.graphs.gallery import chain, complete, cycle, grid, random_connected, star, within_radius
from trigpoint.graphs.measurement_graph import MeasurementGraph

__all__ = [
    "EXTERNAL",
    "MeasurementGraph",
    "chain",
    "complete",
    "cycle",
    "grid",
    "random_connected",
    "star",
    "within_radius",
]
