"""One hierarchy of errors: misuse is an exception that says what was got, what was expected and what to do.

Numerical failure is not here: it is a value of a result (a bound that is not tight, a verdict *inconclusive*).
"""

from __future__ import annotations


class TrigpointError(Exception):
    """Everything that Trigpoint raises on purpose; the command line turns it into exit code 2."""


class ArgumentError(TrigpointError, ValueError):
    """An argument does not fit: the message names it, what was got, what was expected and the remedy."""


class ShapeError(ArgumentError):
    """Two arrays do not fit together: the message names both and both shapes."""


class FileFormatError(TrigpointError, ValueError):
    """A file cannot be read: the message begins with the file's name and, where there is one, the line."""

    def __init__(self, path: object, text: str, line: int | None = None) -> None:
        self.path = str(path)
        self.line = line
        self.text = text
        where = self.path if line is None else f"{self.path}:{line}"
        super().__init__(f"{where}: {text}")


class MethodError(TrigpointError, ValueError):
    """A method does not accept the problem: the message names the violated requirement, got, expected, remedy."""

    def __init__(self, method: str, requirement: str, got: str, remedy: str) -> None:
        self.method = method
        self.requirement = requirement
        super().__init__(f"{method} needs {requirement}; got {got}. {remedy}")


class MissingExtraError(TrigpointError, ImportError):
    """An optional package is not installed: the message says which extra brings it."""

    def __init__(self, package: str, extra: str, purpose: str) -> None:
        self.package = package
        self.extra = extra
        super().__init__(
            f"{purpose} needs the package {package!r}, which is not installed: pip install 'trigpoint[{extra}]' "
            f"(in a checkout: python -m pip install -e '.[{extra}]')"
        )


class ProtocolError(TrigpointError, ValueError):
    """A frame or a node file does not follow the protocol; the sender is at fault, the receiver goes on."""
