"""A map from one scan."""

from __future__ import annotations

from novelty.config import Config
from novelty.errors import ConfigError, InputError
from novelty.fitting import FitPlan, fit_scans
from novelty.maps.scene_map import KEPT, SceneMap
from novelty.maps.views import View
from novelty.preprocess import check_scan, prepare
from novelty.scan import Scan


def fit(scan: Scan, config: Config | None = None) -> SceneMap:
    """Make a map of a place: what later scans are compared with in the place of this one.

    Args:
        scan: The place as it is now. With its origin given, the map also knows what could not be seen.
        config: Settings; the map keeps those of preprocessing and fit.

    Raises:
        InputError: The scan leaves nothing to examine.
        ConfigError: The settings simplify nothing, so that the map would be as large as the scan.
    """
    config = config or Config()
    if config.preprocess.simplify == "none":
        raise ConfigError("a map is made of cells: set preprocess.simplify to 'or' (the default) or 'and'.")
    check_scan(scan)
    # Section 2.2: outliers and ground taken out, the rest simplified to cells.
    prepared = prepare([scan], config.preprocess, config.unit)
    if not len(prepared.points):
        raise InputError(f"{scan.name or 'the scan'}: {' '.join(prepared.notes[0])}")
    # Section 2.3: the mixture, its order chosen by MDL (Algorithm 1).
    model = fit_scans([prepared], FitPlan(config.fit, config.max_components, config.seed))
    return SceneMap(
        cells=prepared.cells,
        model=model,
        views=tuple(View.of(rays) for rays in prepared.stations[0]),
        ground=prepared.grounds[0],
        spacing=float(prepared.spacing[0]),
        cell_size=float(prepared.cell_size[0]),
        config=Config(**{key: getattr(config, key) for key in KEPT}),
        name=scan.name,
    )
