"""A TOML text with the lines of its values: syntax, types and keys are checked, and every error has its line."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from trigpoint.errors import FileFormatError
from trigpoint.io.sections import SECTIONS
from trigpoint.io.text import nearest, shown
from trigpoint.io.toml_lines import KeyPath, key_lines, line_of

_MEANT = {"nodes": "n", "size": "n", "count": "n", "width": "cols", "columns": "cols", "height": "rows"}
"""Keys that people write where another word is asked for, too far away for spelling to tell."""

Model = TypeVar("Model", bound=BaseModel)


class TomlSource:
    """One TOML text: its values, and where they stand."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        try:
            self.table = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            found = re.search(r"at line (\d+)", str(error))
            line = int(found[1]) if found else text.count("\n") + 1
            reason = re.sub(r" \(at .*\)$", "", str(error))
            raise FileFormatError(path, f"this is no TOML ({reason}); correct the file", line) from None
        except (RecursionError, ValueError) as error:
            raise FileFormatError(path, f"the TOML cannot be read ({error})") from None
        self.lines = key_lines(text)
        self._refuse_infinite(self.table, ())

    def fail(self, at: KeyPath, text: str) -> FileFormatError:
        """The error about the value at the path ``at``."""
        return FileFormatError(self.path, text, line_of(self.lines, at))

    def validated(self, model: type[Model], table: Mapping[str, Any], prefix: KeyPath) -> Model:
        """The table as a model; the first violation is a ``FileFormatError`` with its line and key."""
        try:
            return model.model_validate(table)
        except ValidationError as error:
            details = error.errors(include_url=False, include_context=False)
            # an unknown key is usually the cause of the missing one beside it
            first = next((detail for detail in details if detail["type"] == "extra_forbidden"), details[0])
            raise self._explain(model, first, prefix) from None

    def _explain(self, model: type[BaseModel], detail: ErrorDetails, prefix: KeyPath) -> FileFormatError:
        at = (*prefix, *detail["loc"])
        name = _dotted(at)
        kind, given = detail["type"], detail["input"]
        if kind == "extra_forbidden":
            known = _known_keys(model, detail["loc"][:-1])
            where = f"in [{_dotted(at[:-1])}]" if at[:-1] else "at the top"
            meant = _MEANT.get(str(at[-1]))
            hint = f"; did you mean {meant!r}?" if meant in known else nearest(str(at[-1]), known)
            return self.fail(at, f"got the unknown key {shown(str(at[-1]))} {where}, expected one of {known}{hint}")
        if kind == "missing":
            return self.fail(at[:-1], f"got no {name}, which is required; add it")
        if kind == "value_error":
            return self.fail(at, f"{name}: {detail['msg'].removeprefix('Value error, ')}")
        if kind == "model_type":
            return self.fail(at, f"{name}: got {shown(given)}, expected one table")
        expected = detail["msg"].removeprefix("Input should be ").removeprefix("a valid ")
        kinds = "a number " if expected.startswith(("less than", "greater than")) else ""
        remedy = "correct it, or leave it out where it is not required"
        return self.fail(at, f"{name}: got {shown(given)}, expected {kinds}{expected}; {remedy}")

    def _refuse_infinite(self, value: Any, at: KeyPath) -> None:
        if isinstance(value, float) and not np.isfinite(value):
            raise self.fail(at, f"{_dotted(at)}: got {value}, expected a finite number; correct it, or leave it out")
        items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        for key, entry in items:
            self._refuse_infinite(entry, (*at, key))


def _dotted(at: KeyPath) -> str:
    return ".".join(map(str, at))


def _known_keys(model: type[BaseModel], at: tuple[int | str, ...]) -> list[str]:
    for key in at:
        known = model.model_fields.get(str(key))
        if known is not None:
            model = next((section for section in SECTIONS if section.__name__ in str(known.annotation)), model)
    return [info.alias or name for name, info in model.model_fields.items()]
