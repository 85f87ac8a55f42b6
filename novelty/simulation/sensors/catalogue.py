"""The sensors by name.

Figures come from the data sheets named below; `python -m benchmarks.simulation --out DIR` draws the range errors beside
them. What data sheets do not give is set to moderate values and marked so: the share of lost returns, the steepest
incidence, and how many of the beams that straddle an edge answer from in between. That they do is documented for the
LMS-200 by Ye & Borenstein (ICRA 2002) and for the URG-04LX by Okubo, Ye & Borenstein (SPIE 7332, 2009).
"""

from __future__ import annotations

from collections.abc import Callable

from novelty.errors import InputError
from novelty.simulation.sensors.camera import PinholeCamera
from novelty.simulation.sensors.planar import PushBroom, RollingLaser, TiltingLaser
from novelty.simulation.sensors.ranging import DisparityRanging, LaserRanging
from novelty.simulation.sensors.sensor import Sensor
from novelty.simulation.sensors.spinning import SpinningBeams


def urg_04lx() -> Sensor:
    """Hokuyo URG-04LX on a pan-tilt unit (Directed Perception PTU-D46), 682 rays x 64 tilts.

    0.02-5.6 m, 1024 steps per turn, steps 44 to 725 (239.8 degrees), 1 mm readings: Hokuyo SCIP 2.0 specification
    C-42-03320B, table 2 and the reply to PP. Accuracy +-10 mm to 1 m and +-1 % of the range beyond (data sheet of the
    URG-04LX; +-3 % for the later URG-04LX-UG01): taken as a standard deviation of 1 % on top of 5 mm. Dropouts, mixed
    pixels and steepest incidence: assumed.
    """
    step = 360 / 1024
    return Sensor(
        "urg_04lx", TiltingLaser(681 * step, step, -50, 30, 64), LaserRanging(0.005, 0.01), 0.02, 5.6,
        dropout=0.01, mixed_pixels=0.5, max_incidence=84.0,
    )  # fmt: skip


def utm_30lx() -> Sensor:
    """Hokuyo UTM-30LX that a motor rolls about its forward axis, 541 rays x 180 half-turn lines.

    0.1-30 m, 1440 steps per turn, 1081 of them used (270 degrees), read in clusters of two (0.5 degrees), 1 mm
    readings: SCIP 2.0 specification C-42-03320B, table 2, and data sheet; repeated accuracy below 10 mm to 10 m
    and below 30 mm to 30 m (data sheet). Dropouts, mixed pixels and steepest incidence: assumed.
    """
    return Sensor(
        "utm_30lx", RollingLaser(270, 0.5, 180, 180), LaserRanging(0.0085, 0.0005), 0.1, 30.0,
        dropout=0.003, mixed_pixels=0.2,
    )  # fmt: skip


def lms_200(spacing: float = 0.05) -> Sensor:
    """SICK LMS-200 that looks up and sideways from a driving robot, 361 rays per line.

    180 degrees in steps of 0.5 degrees, 8 m in millimetre mode, statistical error 5 mm and readings of 1 mm (technical
    description LMS 200); resolution and error as characterised by Ye & Borenstein (ICRA 2002). Dropouts, mixed pixels
    and steepest incidence: assumed.

    Args:
        spacing: Distance that the robot travels between two lines, m; `novelty.simulation.drive` gives the poses.
    """
    return Sensor(
        "lms_200", PushBroom(180, 0.5, spacing), LaserRanging(0.005), 0.05, 8.0,
        dropout=0.003, mixed_pixels=0.5,
    )  # fmt: skip


def vlp_16() -> Sensor:
    """Velodyne VLP-16 at 10 Hz, 16 beams x 1808 azimuths.

    100 m, +-15 degrees, one firing cycle in 55.296 us, 2 mm readings, accuracy +-3 cm typical (user manual
    63-9243), read as 2.5 standard deviations. Dropouts, mixed pixels and steepest incidence: assumed.
    """
    return Sensor(
        "vlp_16", SpinningBeams(-15, 15, 16, 1808), LaserRanging(0.012, quantum=0.002), 0.5, 100.0,
        dropout=0.005, mixed_pixels=0.2,
    )  # fmt: skip


def hdl_32e() -> Sensor:
    """Velodyne HDL-32E at 10 Hz, 32 beams x 2170 azimuths.

    100 m, +10.67 to -30.67 degrees, one firing cycle in 46.08 us, 2 mm readings, accuracy 2 cm (one standard
    deviation at 25 m): data sheet 97-0038. Dropouts, mixed pixels and steepest incidence: assumed.
    """
    return Sensor(
        "hdl_32e", SpinningBeams(-30.67, 10.67, 32, 2170), LaserRanging(0.02, quantum=0.002), 1.0, 100.0,
        dropout=0.005, mixed_pixels=0.2,
    )  # fmt: skip


def kinect() -> Sensor:
    """Microsoft Kinect: 640 x 480 depth image by structured light.

    Focal length 5.453 mm of 9.3 um pixels (586 pixels), baseline 7.5 cm, disparity in steps of 1/8 pixel with a
    standard deviation of half a step, 0.5-5 m: Khoshelham & Oude Elberink, Sensors 12 (2012) 1437. The projector
    throws shadows. Dropouts and steepest incidence: assumed.
    """
    return Sensor(
        "kinect", PinholeCamera(640, 480, 586), DisparityRanging(586, 0.075, 1 / 16, 1 / 8), 0.5, 5.0,
        dropout=0.002, max_incidence=80.0, emitter=(0.0, 0.075, 0.0),
    )  # fmt: skip


SENSORS: dict[str, Callable[[], Sensor]] = {
    "urg_04lx": urg_04lx,
    "utm_30lx": utm_30lx,
    "lms_200": lms_200,
    "vlp_16": vlp_16,
    "hdl_32e": hdl_32e,
    "kinect": kinect,
}
"""Sensors by name."""


def get_sensor(sensor: str | Sensor) -> Sensor:
    """A sensor by its name in `SENSORS`; a `Sensor` is returned as it is.

    Raises:
        InputError: There is no sensor of that name.
    """
    if isinstance(sensor, Sensor):
        return sensor
    if sensor not in SENSORS:
        raise InputError(f"There is no sensor {sensor!r}; choose one of {', '.join(SENSORS)}.")
    return SENSORS[sensor]()
