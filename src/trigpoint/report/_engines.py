"""The one place where matplotlib and jinja2 are loaded, when the first figure or page is asked for."""

from __future__ import annotations

import hashlib
import io
import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

from trigpoint.errors import MissingExtraError
from trigpoint.report._text import NOTHING, number, printable

if TYPE_CHECKING:
    from jinja2 import Template
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK = "#1b2733"
MUTED = "#5f6b76"
ARC = "#9aa5b1"
GRID = "#dfe4e9"
ACCENT = "#c2410c"
BLUE = "#1d5f9e"

_STYLE: dict[Any, Any] = {
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 11.0,
    "axes.titleweight": "bold",
    "font.size": 9.0,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "path.simplify": False,
    "svg.fonttype": "none",
    "text.color": INK,
    "xtick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.color": MUTED,
    "ytick.labelcolor": INK,
}
_PROLOGUE = re.compile(r"\A.*?(?=<svg\b)", re.DOTALL)
_COUNTED_ID = re.compile(r' id="[A-Za-z0-9]+_\d+"')  # figure_1, axes_1, ...: never referred to, not unique on a page
_KEY = re.compile(r"\bE-\d+-\d+\b")  # an erratum of the papers
_TRAILING = re.compile(r"[ \t]+$", re.MULTILINE)


def draw(size: tuple[float, float], label: str, paint: Callable[[Figure], None]) -> str:
    """Return the SVG text of a figure of ``size`` inches that ``paint`` fills; equal input gives equal text.

    The style is in force only meanwhile, whatever the user's own matplotlib settings are. Text stays text (it can be
    selected, searched and read aloud), so a glyph that matplotlib's own font lacks is left to the reader's fonts.
    """
    with styled(label) as new_figure:
        buffer, figure = io.StringIO(), new_figure(figsize=size, layout="constrained")
        paint(figure)
        nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        figure.savefig(buffer, format="svg", metadata=nothing, facecolor="white", dpi=200)
    return _embeddable(buffer.getvalue(), label)


@contextmanager
def styled(label: str = "") -> Iterator[type[Figure]]:
    """matplotlib's ``Figure`` with our style in force meanwhile; ``label`` salts what is drawn as SVG."""
    try:
        import matplotlib
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingExtraError("matplotlib", "report", "drawing a figure") from error
    with matplotlib.rc_context(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        matplotlib.rcdefaults()
        salt = hashlib.sha256(label.encode("utf-8", "replace")).hexdigest()
        matplotlib.rcParams.update({**_STYLE, "svg.hashsalt": salt})
        yield Figure


def _embeddable(svg: str, label: str) -> str:
    """Drop the XML prologue (a DOCTYPE names an outside file) and say what the picture shows."""
    svg = _COUNTED_ID.sub("", _PROLOGUE.sub("", svg))
    svg = _TRAILING.sub("", svg)
    return svg.replace("<svg ", f'<svg role="img" aria-label={quoteattr(printable(label))} ', 1)


def plain_ticks(axes: Axes, low: float, high: float) -> None:
    """Label a logarithmic vertical axis from ``low`` to ``high``, both positive, as people write numbers.

    Less than two decades get 1, 2 and 5 of each, less than a half one evenly spaced places; more get powers of ten
    with unlabelled ticks between them.
    """
    from matplotlib.ticker import AutoLocator, FuncFormatter, LogLocator, NullFormatter

    axes.yaxis.set_minor_formatter(NullFormatter())
    if high < 100.0 * low:
        axes.yaxis.set_major_locator(AutoLocator() if high < 3.0 * low else LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: number(value, 4)))


def require_engines() -> None:
    """Check that pages with figures can be made here, before anything is computed for them.

    Raises:
        MissingExtraError: matplotlib or jinja2 is not installed.
    """
    with styled():
        page_template()


def page_template() -> Template:
    """Return the page's template; everything written into it is escaped, unknown names are errors."""
    try:
        import jinja2
        from markupsafe import Markup, escape
    except ImportError as error:
        raise MissingExtraError("jinja2", "report", "rendering a page") from error

    def finished(value: object) -> object:
        if value is None:
            return NOTHING
        return printable(value) if isinstance(value, str) and not isinstance(value, Markup) else value

    def unbroken(text: str) -> Markup:
        marked = _KEY.sub(r'<span class="whole">\g<0></span>', str(escape(printable(text))))
        return Markup(marked)  # escaped above

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("trigpoint.report", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        finalize=finished,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["unbroken"] = unbroken
    return environment.get_template("page.html")
