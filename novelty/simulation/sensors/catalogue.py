"""The sensors by name.

Every figure has its source beside it, with the page or section that gives it; `python -m benchmarks.simulation --out
DIR` draws the range errors beside them. *As commonly quoted* marks a figure that goes back to a maker's sheet or an
article which says so by all accounts, but was not read there. What the makers do not print is set to moderate values
and called *assumed*: the share of lost returns, the steepest incidence, and how many of the beams that straddle an edge
answer from in between. That they do is documented for the LMS-200 by Ye & Borenstein, Characterization of a 2-D laser
scanner for mobile robot obstacle negotiation (ICRA 2002), and for the URG-04LX by Okubo, Ye & Borenstein (SPIE 7332,
2009). Only what differs from one reading to the next is simulated: a constant offset (30 to 50 mm for the UTM-30LX-EW,
up to 15 mm for the LMS-200, both as commonly quoted) shifts both scans of one device alike.
"""

from __future__ import annotations

import math
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

    0.1-30 m, 270 degrees, 0.25 degrees (1440 steps per turn; here read in clusters of two), standard deviation below 10
    mm to 10 m and below 30 mm to 30 m: Hokuyo's specification as it is listed in github.com/Gastd/cacic,
    docs/source/laser.rst, section Laser Especs; not read in the sheet itself. 1 mm readings: Hokuyo, SCIP 2.0
    (C-42-03320B), table 2. Assumed: dropouts, mixed pixels, steepest incidence.
    """
    return Sensor(
        "utm_30lx", RollingLaser(270, 0.5, 180, 180), LaserRanging(0.0085, 0.0005), 0.1, 30.0,
        dropout=0.003, mixed_pixels=0.2,
    )  # fmt: skip


def lms_200(spacing: float = 0.05) -> Sensor:
    """SICK LMS-200 that looks up and sideways from a driving robot, 361 rays per line.

    361 readings in steps of 0.5 degrees, 8.192 m at readings of 1 mm: documentation of Player 1.6.5, driver sicklms200,
    options `resolution` and `range_res`. Statistical error 5 mm (1 sigma, 1 to 8 m): as commonly quoted from SICK AG,
    LMS 200/211/220/221/291, technical description. Assumed: nearest return, dropouts, mixed pixels, steepest incidence.

    Args:
        spacing: Distance that the robot travels between two lines, m; `novelty.simulation.drive` gives the poses.
    """
    return Sensor(
        "lms_200", PushBroom(180, 0.5, spacing), LaserRanging(0.005), 0.05, 8.0,
        dropout=0.003, mixed_pixels=0.5,
    )  # fmt: skip


def vlp_16() -> Sensor:
    """Velodyne VLP-16 at 10 Hz, 16 beams x 1808 azimuths.

    Velodyne, VLP-16 user manual (63-9243 Rev. E, 2019): 100 m, +-15 degrees in steps of 2, accuracy +-3 cm typical
    (specifications), read as 2.5 standard deviations; 2 mm readings (section 9.3); 2.304 us per beam and 18.432 us of
    rest make one cycle of 55.296 us (section 9.4). Assumed: nearest return (0.5 m, as drivers cut it), dropouts, mixed
    pixels, steepest incidence.
    """
    return Sensor(
        "vlp_16", SpinningBeams(-15, 15, 16, 1808), LaserRanging(0.012, quantum=0.002), 0.5, 100.0,
        dropout=0.005, mixed_pixels=0.2,
    )  # fmt: skip


def hdl_32e() -> Sensor:
    """Velodyne HDL-32E at 10 Hz, 32 beams x 2170 azimuths.

    Velodyne, HDL-32E user's manual and programming guide (63-9113, pages as in Rev. E, 2012): 5 cm to 100 m (principles
    of operation, p. 2) of which returns from less than about 1 m are to be ignored (usage, p. 6), +10.67 to -30.67
    degrees in steps of 1.33 (laser firing sequence, p. 10), 2 mm readings (appendix B, p. 17), a cycle of 46.08 us of
    1.152 us per laser and a pause (appendix E, p. 24: -542.592 + packet offset / 100 * 46.08 + DSR * 1.152). Accuracy 2
    cm, one standard deviation at 25 m: as commonly quoted from its specifications. Assumed: dropouts, mixed pixels,
    steepest incidence.
    """
    return Sensor(
        "hdl_32e", SpinningBeams(-30.67, 10.67, 32, 2170), LaserRanging(0.02, quantum=0.002), 1.0, 100.0,
        dropout=0.005, mixed_pixels=0.2,
    )  # fmt: skip


def kinect() -> Sensor:
    """Microsoft Kinect (of the Xbox 360): 640 x 480 depth image by structured light.

    Khoshelham & Oude Elberink, Accuracy and resolution of Kinect depth data for indoor mapping applications, Sensors 12
    (2012) 1437, say in the abstract that the random error grows from a few millimetres to about 4 cm at the maximum
    range. From the same article, as programs quote it: focal length 5.453 mm of 9.3 um pixels (586 pixels;
    github.com/ChiNasa511/3DReconstruction, toPointCloud.m) and a standard deviation of 1.425 mm z^2 with z in m
    (github.com/pedropro/CAPE, CAPE/Params.h), which is that of half a step of disparity. Baseline 7.5 cm, disparity in
    steps of 1/8 pixel: Konolige & Mihelich, Technical description of Kinect calibration
    (wiki.ros.org/kinect_calibration/technical), section Depth calculation. 0.5-5 m: as commonly quoted. The depth
    images from which they find the noise are rounded, so that here noise and rounding (a step squared over 12) have it
    together. The projector throws shadows. Assumed: dropouts, steepest incidence.
    """
    step = 1 / 8
    noise = step * math.sqrt(1 / 4 - 1 / 12)
    return Sensor(
        "kinect", PinholeCamera(640, 480, 586), DisparityRanging(586, 0.075, noise, step), 0.5, 5.0,
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
