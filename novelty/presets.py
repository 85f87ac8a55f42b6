"""Named sets of settings: `Config.preset(name)`, `--preset name`, and the files of `configs/presets`."""

from __future__ import annotations

from typing import Any

PAPER: dict[str, Any] = {
    "detector": "greedy_emd",
    "max_components": 20,
    # Section 2.2: Rusu's outliers, which are those of the whole scan; the ground goes as a plane.
    "preprocess.outliers": "statistical",
    "preprocess.feet": False,
    # Section 2.3: a point of the simplified cloud is a point; Bouman's floor; one start, evenly spaced in scan order.
    "fit.moments": "centroid",
    "fit.initializer": "evenly_spaced",
    "fit.n_init": 1,
    "fit.unexplained_components": 0,
    "fit.covariance_floor": "paper",
    # Section 2.4.1: every scan is fitted on its own, components are compared by their means.
    "greedy_emd.fits": "independent",
    "greedy_emd.ground_distance": "mean",
    "greedy_emd.resolution_floor": "none",
    "greedy_emd.until": "distance",
    # Sections 2.4.2 and 3.2: metres beside pure numbers (eq. 9), U_T and U_R as printed.
    "structural_matching.fits": "independent",
    "structural_matching.merging": False,
    "structural_matching.scale": "metre",
    "structural_matching.node_threshold": 3.5,
    "structural_matching.arc_threshold": 1.0,
    "structural_matching.arc_terms": "squared",
    "structural_matching.length_scale": 1.0,
    "structural_matching.resolution_floor": "none",
    # The clusterings that the mixtures are measured against are compared in the same way (section 3.4).
    "kmeans_mixture.ground_distance": "mean",
    "kmeans_mixture.resolution_floor": "none",
    "fuzzy_partition.ground_distance": "mean",
    "fuzzy_partition.resolution_floor": "none",
    # Poses are taken as given, and every point follows its component (Algorithm 2, line 10).
    "registration.method": "none",
    "refine.method": "none",
    "visibility.method": "none",
    "segment.rule": "map",
    "segment.min_points": 1,
}
"""Every choice that the paper prints; where it prints none, the defaults hold."""

PAPER_CALIBRATED: dict[str, Any] = {
    **PAPER,
    "detector": "structural_matching",
    # Section 3.2 on our maps: least probability of error over the 40 labelled ones of `novelty paper`.
    "structural_matching.node_threshold": 3.25,
    "structural_matching.arc_threshold": 12.1,
}
"""Structural matching as the paper prints it, with U_T and U_R found as it finds them, but on our maps."""

PRESETS: dict[str, dict[str, Any]] = {"paper": PAPER, "paper_calibrated": PAPER_CALIBRATED}
"""Dotted keys of `Config` and their values, by the preset's name."""
