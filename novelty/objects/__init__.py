"""Novel points in contact as objects: their boxes, their neighbours, and which of them were only moved."""

from novelty.objects.box import OrientedBox
from novelty.objects.grouping import describe_objects, number_objects
from novelty.objects.marking import mark_moves
from novelty.objects.moves import Move, Things, find_moves

__all__ = ["Move", "OrientedBox", "Things", "describe_objects", "find_moves", "mark_moves", "number_objects"]
