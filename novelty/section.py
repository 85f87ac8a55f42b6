"""What every section of the configuration is: a frozen, validated, keyword-only dataclass."""

from __future__ import annotations

from typing import Any, TypeVar, cast, dataclass_transform

from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass as pydantic_dataclass
from pydantic.fields import FieldInfo

T = TypeVar("T")


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(Field,))
def section(cls: type[T]) -> type[T]:
    """Make a class a section: frozen, every value checked, unknown keys refused."""
    decorate = pydantic_dataclass(frozen=True, kw_only=True, config=ConfigDict(extra="forbid"))
    return cast(type[T], decorate(cls))


def section_fields(cls: type[Any]) -> dict[str, FieldInfo]:
    """The keys of a section, with default and description."""
    return dict(cls.__pydantic_fields__)
