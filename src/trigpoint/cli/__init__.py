"""The command line: composes the spokes, holds no mathematics. Every command but ``node`` has ``--json``."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trigpoint.cli.commands import app

__all__ = ["app", "main"]


def main() -> None:
    """Entry point of the ``trigpoint`` command; Ctrl-C while it still loads ends it without a traceback."""
    try:
        from trigpoint.cli.commands import app
    except KeyboardInterrupt:
        print("Aborted!", file=sys.stderr)  # what click says later on
        sys.exit(130)  # as shells have it; shell.INTERRUPTED is not loaded yet
    app()


def __getattr__(name: str) -> Any:
    if name == "app":
        from trigpoint.cli.commands import app

        return app
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
