"""What every design method is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

from trigpoint.observers.network import NetworkObserver


class Method(ABC):
    """A way to design an observer: a frozen dataclass of its choices.

    ``build`` first checks what it accepts (``MethodError`` names the violated requirement, got and remedy) and only
    then computes. ``label`` is the method's name in scenario files and on the command line.
    """

    label: ClassVar[str]

    @abstractmethod
    def build(self, problem: Any) -> NetworkObserver:
        """Return the observer for ``problem``, or raise ``MethodError``."""
