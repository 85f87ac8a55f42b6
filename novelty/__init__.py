"""What is new and what is gone between two scans of one place.

The names below and the packages in `novelty` (`novelty.io`, `novelty.sweep`, ...) are resolved on first use, so that
`import novelty` and the command line start at once.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from novelty.config import Config
    from novelty.errors import ConfigError, InputError, MissingDependencyError, NoveltyError
    from novelty.evaluation import Scores, evaluate
    from novelty.io import read_pairs, read_scan
    from novelty.maps import MapUpdate, SceneMap, detect_against, fit, update
    from novelty.pipeline import detect, detect_many
    from novelty.result import Change, ComponentRecord, NoveltyResult, ObjectRecord, PointState, ResultStatus
    from novelty.scan import Scan, ScanPair

__version__ = "0.1.0"

_HOME = {
    "Change": "novelty.result",
    "ComponentRecord": "novelty.result",
    "Config": "novelty.config",
    "ConfigError": "novelty.errors",
    "InputError": "novelty.errors",
    "MapUpdate": "novelty.maps",
    "MissingDependencyError": "novelty.errors",
    "NoveltyError": "novelty.errors",
    "NoveltyResult": "novelty.result",
    "ObjectRecord": "novelty.result",
    "PointState": "novelty.result",
    "ResultStatus": "novelty.result",
    "Scan": "novelty.scan",
    "ScanPair": "novelty.scan",
    "SceneMap": "novelty.maps",
    "Scores": "novelty.evaluation",
    "detect": "novelty.pipeline",
    "detect_against": "novelty.maps",
    "detect_many": "novelty.pipeline",
    "evaluate": "novelty.evaluation",
    "fit": "novelty.maps",
    "read_pairs": "novelty.io",
    "read_scan": "novelty.io",
    "update": "novelty.maps",
}

_PACKAGES = ("calibration", "evaluation", "io", "maps", "report", "simulation", "sweep")

__all__ = [
    "Change",
    "ComponentRecord",
    "Config",
    "ConfigError",
    "InputError",
    "MapUpdate",
    "MissingDependencyError",
    "NoveltyError",
    "NoveltyResult",
    "ObjectRecord",
    "PointState",
    "ResultStatus",
    "Scan",
    "ScanPair",
    "SceneMap",
    "Scores",
    "__version__",
    "detect",
    "detect_against",
    "detect_many",
    "evaluate",
    "fit",
    "read_pairs",
    "read_scan",
    "update",
]


def __getattr__(name: str) -> Any:
    if name in _PACKAGES:
        return importlib.import_module(f"{__name__}.{name}")
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*__all__, *_PACKAGES])
