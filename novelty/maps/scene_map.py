"""What is known of one place: all that a comparison with a later scan asks of an earlier one, in kilobytes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from gmmtorch import ArgumentError, FitResult, PointClouds, ShapeError
from novelty.config import Config
from novelty.errors import ConfigError, InputError
from novelty.maps.drawing import draw_points
from novelty.maps.packing import pack_cells, pack_model, pack_views, unpack_cells, unpack_model, unpack_views
from novelty.maps.storage import Arrays, load_arrays, save_arrays
from novelty.maps.views import View
from novelty.preprocess import PreparedScans, metres_per
from novelty.preprocess.ground import NoGround, Plane
from novelty.scan import Scan

KEPT = ("unit", "max_components", "seed", "preprocess", "fit")
"""Keys of the configuration that made a map what it is; the others belong to a comparison."""


@dataclass(frozen=True, eq=False)
class SceneMap:
    """A place as `novelty.fit` saw it, and as `novelty.update` keeps it; lengths in metres.

    Attributes:
        cells: One cloud of cells: number, mean and covariance of the points of small patches of surface.
        model: The mixture fitted to the cells, its order chosen by MDL.
        views: What could be seen from where the scans were taken, the latest last; none where that is not known.
        ground: The plane whose points were taken out, or why none was.
        spacing: Typical distance between neighbouring points.
        cell_size: Typical root-mean-square extent of a cell.
        config: The settings it was made with; a scan compared with it is prepared by the same.
        name: What messages call it.
        num_scans: How many scans it has taken in.
    """

    cells: PointClouds
    model: FitResult
    views: tuple[View, ...]
    ground: Plane | NoGround
    spacing: float
    cell_size: float
    config: Config
    name: str = ""
    num_scans: int = 1

    def __len__(self) -> int:
        """Number of cells M."""
        return len(self.cells.points)

    @property
    def unit(self) -> str:
        """Unit of the scans it was made from, which later ones must share."""
        return self.config.unit

    @property
    def num_points(self) -> int:
        """Number of points that the cells stand for."""
        return int(self.cells.total_weights[0])

    def as_scan(self) -> Scan:
        """The centres of the cells as a scan in `unit`: the points that `NoveltyResult.removed` speaks of."""
        return Scan(self.cells.points.numpy() / metres_per(self.unit), name=self.name)

    def prepared(self) -> PreparedScans:
        """The map as a scan after preprocessing: every cell drawn by as many points as it stands for."""
        points, cell_of_point = draw_points(self.cells)
        returns = [view.returns() for view in self.views]
        origins = [
            np.broadcast_to(view.origin, ends.shape) for view, ends in zip(self.views, returns, strict=True)
        ]
        return PreparedScans(
            cells=self.cells,
            points=points,
            cell_of_point=cell_of_point,
            kept=(np.arange(len(points.points)),),
            num_given=(len(points.points),),
            origins=(np.concatenate(origins) if origins else None,),
            returns=(np.concatenate([*returns, np.empty((0, 3))]),),
            dropped=({},),
            spacing=torch.tensor([self.spacing], dtype=torch.float64),
            cell_size=torch.tensor([self.cell_size], dtype=torch.float64),
            notes=((),),
            grounds=(self.ground,),
        )

    def save(self, path: str | Path) -> None:
        """Write a safetensors file, all at once or not at all.

        Raises:
            InputError: The file cannot be written.
        """
        settings = self.config.to_mapping()
        record = {
            "name": self.name,
            "num_scans": self.num_scans,
            "num_views": len(self.views),
            "spacing": self.spacing,
            "cell_size": self.cell_size,
            "ground": _ground_record(self.ground),
            "config": {key: settings[key] for key in KEPT},
        }
        save_arrays(
            path, pack_cells("cells", self.cells) | pack_model(self.model) | pack_views(self.views), record
        )

    @classmethod
    def load(cls, path: str | Path) -> SceneMap:
        """Read a file that `save` wrote.

        Raises:
            InputError: The file is missing, damaged, no map, or of another version.
        """
        arrays, record = load_arrays(path)
        try:
            return cls._unpacked(arrays, record)
        except (KeyError, ValueError, ArgumentError, ShapeError, ConfigError) as error:
            raise InputError(
                f"{path}: the map does not suit this version of novelty ({error}). Make it again from its scan."
            ) from None

    @classmethod
    def _unpacked(cls, arrays: Arrays, record: dict[str, Any]) -> SceneMap:
        return cls(
            cells=unpack_cells("cells", arrays),
            model=unpack_model(arrays),
            views=unpack_views(arrays, record["num_views"]),
            ground=_ground(record["ground"]),
            spacing=record["spacing"],
            cell_size=record["cell_size"],
            config=Config.from_mapping(record["config"]),
            name=record["name"],
            num_scans=record["num_scans"],
        )


def _ground_record(ground: Plane | NoGround) -> dict[str, Any]:
    if isinstance(ground, NoGround):
        return {"reason": ground.reason}
    return {"normal": ground.normal.tolist(), "height": ground.height, "tolerance": ground.tolerance}


def _ground(record: dict[str, Any]) -> Plane | NoGround:
    if "reason" in record:
        return NoGround(record["reason"])
    return Plane(np.array(record["normal"]), record["height"], record["tolerance"])
