"""The command line: composes the spokes, holds no mathematics. Every command but ``node`` has ``--json``."""

from trigpoint.cli.app import app, main

__all__ = ["app", "main"]
