"""Files in and out: edge lists, GNU Gama, GraphML, JSON node-link, scenarios. No mathematics."""

from trigpoint.io.atomic import write_atomically
from trigpoint.io.edge_list import edge_list_text, parse_edge_list, read_edge_list, write_edge_list
from trigpoint.io.files import DOCUMENT_WRITERS, DOCUMENTS, FORMATS, load, require_writer, save
from trigpoint.io.formats import Format
from trigpoint.io.gama import parse_gama, read_gama
from trigpoint.io.gama_writer import gama_text, write_gama
from trigpoint.io.graphml import graphml_text, parse_graphml, read_graphml, write_graphml
from trigpoint.io.nodelink import nodelink_text, parse_json, read_nodelink, write_nodelink
from trigpoint.io.scenario import ScenarioFile, parse_scenario, read_scenario
from trigpoint.io.sections import DesignSection, NoiseSection, RunSection, SimulateSection

__all__ = [
    "DOCUMENTS",
    "DOCUMENT_WRITERS",
    "FORMATS",
    "DesignSection",
    "Format",
    "NoiseSection",
    "RunSection",
    "ScenarioFile",
    "SimulateSection",
    "edge_list_text",
    "gama_text",
    "graphml_text",
    "load",
    "nodelink_text",
    "parse_edge_list",
    "parse_gama",
    "parse_graphml",
    "parse_json",
    "parse_scenario",
    "read_edge_list",
    "read_gama",
    "read_graphml",
    "read_nodelink",
    "read_scenario",
    "require_writer",
    "save",
    "write_atomically",
    "write_edge_list",
    "write_gama",
    "write_graphml",
    "write_nodelink",
]
