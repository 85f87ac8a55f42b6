"""ROS bags, with rosbags: `sensor_msgs/PointCloud2` messages of ROS 1 (`.bag`) and ROS 2 (`.mcap`, `.db3`, a folder).

The points are in the frame of their message, which need not be the sensor's, so that the origin is unknown.
"""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from novelty.errors import InputError
from novelty.io.columns import cut_short, scan_from_columns
from novelty.io.extras import load_format_library
from novelty.scan import Scan

CLOUD = "sensor_msgs/msg/PointCloud2"

FIELD_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""numpy's names for the `datatype` of a PointField."""


def read_rosbag(path: Path, part: str = "") -> Scan:
    """Read one point cloud of a bag.

    Args:
        path: A `.bag`, `.mcap` or `.db3` file, or the folder of a ROS 2 bag.
        part: Which one: a topic, a number (counted from 0 in the topic), or `topic:number`; what is left out must
            be plain from the bag.

    Raises:
        InputError: The bag is damaged, has no such point cloud, or has more than one that could be meant.
        MissingDependencyError: rosbags is not installed.
    """
    highlevel = load_format_library("rosbags.highlevel", "ROS bags")
    typesys = load_format_library("rosbags.typesys", "ROS bags")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    try:
        with highlevel.AnyReader([path], default_typestore=store) as bag:
            topic, number = _choose(bag, part, path)
            connections = [entry for entry in bag.connections if entry.topic == topic]
            connection, _, raw = next(islice(bag.messages(connections=connections), number, None))
            message = bag.deserialize(raw, connection.msgtype)
    except InputError:
        raise
    # Readers of three storages raise what lies beneath them: AnyReaderError, sqlite's, struct's, yaml's ...
    except Exception as error:
        raise InputError(
            f"{path}: rosbags cannot read the bag, it is damaged or cut short ({error})."
        ) from error
    return scan_from_columns(_columns(message, path), Path(f"{path}#{topic}:{number}"))


def _choose(bag: Any, part: str, path: Path) -> tuple[str, int]:
    """The topic and the number in it that are meant."""
    counts = _count_clouds(bag)
    if not counts:
        raise InputError(f"{path}: the bag holds no {CLOUD} messages.")
    held = "The bag holds " + ", ".join(f"{count} on {topic}" for topic, count in counts.items()) + "."
    topic, _, number = (f":{part}" if part.isdigit() else part).partition(":")
    topic = topic or (next(iter(counts)) if len(counts) == 1 else "")
    if topic not in counts:
        example = f"{path.name}#{next(iter(counts))}:0"
        raise InputError(
            f"{path}: expected a topic with point clouds, as in {example}; found {topic!r}. {held}"
        )
    number = number or ("0" if counts[topic] == 1 else "")
    if not number.isdigit() or int(number) >= counts[topic]:
        raise InputError(
            f"{path}: expected the number of a point cloud, from 0 to {counts[topic] - 1}, as in "
            f"{path.name}#{topic}:0; found {part!r}. {held}"
        )
    return topic, int(number)


def _count_clouds(bag: Any) -> dict[str, int]:
    """How many point clouds each topic has; a topic may have several connections."""
    counts: dict[str, int] = {}
    for connection in sorted(bag.connections, key=lambda entry: entry.topic):
        if connection.msgtype == CLOUD:
            counts[connection.topic] = counts.get(connection.topic, 0) + connection.msgcount
    return counts


def _columns(message: Any, path: Path) -> dict[str, NDArray[np.generic]]:
    """The fields of a PointCloud2 as columns (N,); rows may be padded."""
    order = ">" if message.is_bigendian else "<"
    kind = np.dtype(
        {
            "names": [field.name for field in message.fields],
            "formats": [f"{order}{FIELD_TYPES[field.datatype]}" for field in message.fields],
            "offsets": [field.offset for field in message.fields],
            "itemsize": message.point_step,
        }
    )
    content = np.asarray(message.data, dtype=np.uint8)
    used = message.width * message.point_step
    if len(content) < message.height * message.row_step:
        found = len(content) // message.point_step
        raise cut_short(path, message.height * message.width, found)
    rows = content[: message.height * message.row_step].reshape(message.height, message.row_step)[:, :used]
    points = np.ascontiguousarray(rows).reshape(-1).view(kind)
    return {name: points[name] for name in kind.names or ()}
