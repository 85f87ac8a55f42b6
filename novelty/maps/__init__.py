"""Stored models of a place: made from one scan, compared with later ones, kept up to date by them."""

from novelty.maps.build import fit
from novelty.maps.compare import detect_against
from novelty.maps.renewal import MapUpdate, update
from novelty.maps.scene_map import SceneMap
from novelty.maps.storage import check_replaceable, is_map

__all__ = ["MapUpdate", "SceneMap", "check_replaceable", "detect_against", "fit", "is_map", "update"]
