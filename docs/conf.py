"""How the documentation is built: `make docs`, warnings are errors, nothing is fetched from outside."""

from __future__ import annotations

import importlib
import pkgutil
from typing import Any

from docutils import nodes
from pybtex.plugin import register_plugin
from pybtex.style.formatting.plain import Style as PlainStyle
from pybtex.style.labels import BaseLabelStyle

import trigpoint

project = "Trigpoint"
author = "The Trigpoint developers"
copyright = "the Trigpoint developers"
release = trigpoint.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinxcontrib.bibtex"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"Trigpoint {release}"

myst_heading_anchors = 3
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = False
napoleon_attr_annotations = False
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "show-inheritance": True}

bibtex_bibfiles = ["references.bib"]
bibtex_default_style = "keys"

nitpick_ignore_regex = [
    (r"py:.*", r"(?!trigpoint\b).*"),  # other people's pages are not fetched, so such a link cannot be checked
    (r"py:.*", r"trigpoint(\.\w+){3,}"),  # what a module keeps to itself has no page
]

PACKAGES = sorted(found.name for found in pkgutil.iter_modules(trigpoint.__path__))


class KeyLabels(BaseLabelStyle):  # type: ignore[misc]
    """Labels that are the keys themselves, since docstrings cite keys."""

    def format_labels(self, sorted_entries: Any) -> Any:
        return (entry.key for entry in sorted_entries)


class KeyStyle(PlainStyle):  # type: ignore[misc]
    default_label_style = KeyLabels


register_plugin("pybtex.style.formatting", "keys", KeyStyle)


autodoc_type_aliases = {"ArrayLike": "ArrayLike", "FloatArray": "FloatArray", "IntArray": "IntArray"}


def load_lazy_names() -> None:
    """Put the lazily loaded public names into their packages, where autodoc looks for them.

    What cannot be imported is left to autodoc, whose warning names the package and fails the build.
    """
    for name in PACKAGES:
        try:
            module = importlib.import_module(f"trigpoint.{name}")
        except ImportError:
            continue
        for public in getattr(module, "__all__", ()):
            if hasattr(module, public):
                setattr(module, public, getattr(module, public))


def link_to_public_name(app: Any, env: Any, node: Any, contnode: nodes.Node) -> nodes.Node | None:
    """Resolve ``trigpoint.graphs.gallery.chain`` or ``LinearAgent`` to the page of the package that exports it."""
    if node.get("refdomain") != "py":
        return None
    wanted = node["reftarget"].rsplit(".", 1)[-1]
    known = env.get_domain("py").objects
    homes = [f"trigpoint.{name}.{wanted}" for name in PACKAGES if f"trigpoint.{name}.{wanted}" in known]
    if not homes:
        return None
    entry = known[homes[0]]
    uri = app.builder.get_relative_uri(node.get("refdoc", env.docname), entry.docname)
    return nodes.reference("", "", contnode, internal=True, refuri=f"{uri}#{entry.node_id}")


def setup(app: Any) -> None:
    load_lazy_names()
    app.connect("missing-reference", link_to_public_name)
