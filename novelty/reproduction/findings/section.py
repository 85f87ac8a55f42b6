"""All sentences of section 3 that numbers can support, in the order of the section."""

from __future__ import annotations

from collections.abc import Sequence

from novelty.reproduction.findings import mobile, sensitivity, static
from novelty.reproduction.findings.finding import Finding
from novelty.reproduction.rows import Row, matching
from novelty.reproduction.segmentation import SegmentationRow
from novelty.reproduction.sensitivity import BOX_SIZE, VIEWPOINT
from novelty.reproduction.thresholds import Thresholds


def find(
    rows: Sequence[Row], segmentations: Sequence[SegmentationRow], thresholds: Thresholds
) -> list[Finding]:
    """Weigh every sentence."""
    table = matching(rows, experiment="mobile_platform")
    return [
        static.thresholds_are_the_least_error(thresholds),
        static.changes_are_segmented(matching(rows, experiment="static_platform")),
        static.few_clusters(segmentations),
        static.nine_do_not_tell_the_door(segmentations),
        static.twenty_tell_the_door(segmentations),
        static.mixture_is_faster(segmentations),
        mobile.all_significant(table),
        mobile.person_is_easier(table),
        mobile.ceiling_spoils_the_mixture(table),
        mobile.area_repairs(table),
        mobile.emd_ahead(table),
        mobile.alike_in_the_area(table),
        *(sensitivity.best_orders(rows, name) for name in (BOX_SIZE, VIEWPOINT)),
        sensitivity.alike_at_every_order(rows),
        static.removal_is_found(matching(rows, experiment="removal")),
    ]
