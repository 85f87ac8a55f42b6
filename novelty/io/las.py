"""LAS and LAZ (ASPRS), with laspy."""

from __future__ import annotations

from pathlib import Path

from novelty.errors import InputError
from novelty.io.columns import cut_short
from novelty.scan import Scan


def read_las(path: Path) -> Scan:
    """Read the scaled coordinates of a LAS or LAZ file; its classification is not a ground truth of changes.

    Raises:
        InputError: The file is not LAS or LAZ, or is cut short.
    """
    import laspy

    try:
        with laspy.open(path) as reader:
            announced = reader.header.point_count
            points = reader.read().xyz
    # laspy passes on whatever its decoders raise: LaspyException, LazrsError, struct.error, ValueError ...
    except Exception as error:
        raise InputError(
            f"{path}: laspy cannot read the file, it is damaged or cut short ({error})."
        ) from error
    if len(points) != announced:
        raise cut_short(path, announced, len(points))
    return Scan(points, name=str(path))
