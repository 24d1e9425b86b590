"""What every table of a scenario file is made of."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from trigpoint.io.text import shown


def is_number(value: Any) -> bool:
    """True for whole and real numbers, not for true and false."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _numbers(value: Any) -> Any:
    def good(entry: Any) -> bool:
        return is_number(entry) or (isinstance(entry, list) and bool(entry) and all(map(good, entry)))

    if not good(value):
        raise ValueError(f"got {shown(value)}, expected a number or a list of numbers")
    return value


Numbers = Annotated[Any, AfterValidator(_numbers)]
PositiveNumber = Annotated[float, Field(gt=0)]
Share = Annotated[float, Field(ge=0, lt=1)]
Chance = Annotated[float, Field(gt=0, le=1)]
Size = Annotated[float, Field(ge=0)]


class Section(BaseModel):
    """Frozen, strict, no undeclared key."""

    model_config = ConfigDict(
        frozen=True, strict=True, extra="forbid", arbitrary_types_allowed=True, allow_inf_nan=False
    )
