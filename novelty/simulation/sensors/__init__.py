"""Range sensors: planar lasers that are tilted, rolled or driven, spinning beams, depth cameras."""

from novelty.simulation.sensors.camera import PinholeCamera
from novelty.simulation.sensors.catalogue import SENSORS, get_sensor
from novelty.simulation.sensors.pattern import RayPattern
from novelty.simulation.sensors.planar import PlanarLaser, PushBroom, RollingLaser, TiltingLaser
from novelty.simulation.sensors.ranging import DisparityRanging, LaserRanging, Ranging
from novelty.simulation.sensors.sensor import Sensor
from novelty.simulation.sensors.spinning import SpinningBeams

__all__ = [
    "SENSORS",
    "DisparityRanging",
    "LaserRanging",
    "PinholeCamera",
    "PlanarLaser",
    "PushBroom",
    "Ranging",
    "RayPattern",
    "RollingLaser",
    "Sensor",
    "SpinningBeams",
    "TiltingLaser",
    "get_sensor",
]
