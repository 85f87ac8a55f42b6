"""What one case of an experiment is made of: the place, the platform, the change."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, TypeVar

from pydantic import Field, TypeAdapter, ValidationError, ValidationInfo, field_validator

from novelty.errors import ConfigError
from novelty.section import section
from novelty.simulation.changes import CHANGES
from novelty.simulation.scenes import SCENES
from novelty.simulation.sensors import SENSORS

T = TypeVar("T")


@section
class Setup:
    """One simulated pair but for its random numbers; the keys of `setup` and of every case in an experiment's file."""

    scene: str = Field(description="The place, a name in `SCENES`.")
    layout: int | None = Field(
        default=None, description="Seed of the place; null: another layout for every repetition."
    )
    sensor: str = Field(
        default="utm_30lx",
        description="The sensor, a name in `SENSORS`; one that scans while it drives follows the scene's path.",
    )
    density: float = Field(default=1.0, gt=0, description="Factor on the number of rays.")
    samples: float | None = Field(
        default=None,
        gt=0,
        description="Points per square metre, drawn evenly from all surfaces: an ideal cloud instead of a scan.",
    )
    noise: float | None = Field(
        default=None, ge=0, description="Constant noise, m, instead of the sensor's own; of samples 1 cm."
    )
    changes: tuple[str, ...] = Field(
        default=(), description="What happens between the scans, names in `CHANGES`."
    )
    object_size: float | None = Field(
        default=None,
        gt=0,
        description="Of new objects, m: height of a person or box, diameter of a cylinder; null: the usual one.",
    )
    spot: tuple[float, float] | None = Field(
        default=None,
        description="Where new objects go: m ahead and m to the left of the viewpoint, to within a hand's breadth; "
        "null: anywhere in sight.",
    )
    stand: tuple[float, float, float] = Field(
        default=(0.0, 0.0, 0.0),
        description="Where the sensor stands in both scans, seen from the scene's own viewpoint: m ahead, m to the "
        "left, degrees to the left.",
    )
    aim: float | None = Field(
        default=None,
        description="Height above the spot of the point that the sensor looks at in both scans, where rolled rays are "
        "densest, m; null: straight ahead.",
    )
    viewpoint: tuple[float, float, float] = Field(
        default=(0.0, 0.0, 0.0),
        description="Of the current scan seen from that of the reference: m ahead, m to the left, degrees to the left.",
    )
    reverse: bool = Field(
        default=False,
        description="Whether the changed world is scanned first: what was added is then removed.",
    )
    stretch: tuple[float, float] | None = Field(
        default=None,
        description="The part of the scene's path that a robot drives, first and last x, m; null: all of it.",
    )
    drift: tuple[float, float] = Field(
        default=(0.0, 0.0),
        description="Error of a driving robot's localisation, m and degrees per square root of a metre.",
    )
    mounting: tuple[float, float] = Field(
        default=(0.0, 0.0),
        description="Roll and pitch of a driving robot's laser that its localisation does not know of, degrees.",
    )
    pose_error: tuple[float, float] = Field(
        default=(0.0, 0.0), description="Wrong placement of the current scan: shift, m, and turn, degrees."
    )

    @field_validator("scene", "sensor", "changes")
    @classmethod
    def _known(cls, value: str | tuple[str, ...], info: ValidationInfo) -> str | tuple[str, ...]:
        tables: dict[str, Collection[str]] = {"scene": SCENES, "sensor": SENSORS, "changes": CHANGES}
        known = tables[str(info.field_name)]
        for name in (value,) if isinstance(value, str) else value:
            if name not in known:
                raise ValueError(f"there is no {name!r}; choose from {', '.join(known)}")
        return value


def validated(kind: type[T], keys: Any, where: str) -> T:
    """A section made of what a file or a command line says.

    Raises:
        ConfigError: An unknown key or a value that it cannot have; the message begins with `where`.
    """
    try:
        return TypeAdapter(kind).validate_python(keys)
    except ValidationError as error:
        unknown = [item for item in error.errors() if item["type"] == "unexpected_keyword_argument"]
        if unknown:
            raise ConfigError(f"{where}: there is no key {unknown[0]['loc'][-1]!r}.") from None
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        message = first["msg"].removeprefix("Value error, ")
        raise ConfigError(f"{where}: {key}: {message} (got {first['input']!r}).") from None
