"""The pinhole camera, and the levelling rotation that gravity gives it.

Camera frame: x right, y down, z forward (optical axis); pixel centres at integers.
Level frame: the camera frame turned so that y points along gravity and the optical axis keeps azimuth 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Real

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.errors import GalocError

Array = NDArray[np.float64]

MAX_TILT = math.radians(85.0)
"""Roll and pitch beyond this leave no usable horizon (rad)."""


def _is_finite(value: object) -> bool:
    """Whether a value is one real number, neither NaN nor infinite; strings, booleans and arrays are not."""
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)


def levelling(gravity: ArrayLike) -> Array:
    """Rotation ``R_level_camera = R_x(pitch) @ R_z(roll)`` from measured roll and pitch.

    ``R_level_camera @ K^-1 [u, v, 1]`` is the levelled ray (y down). pitch > 0 looks up, roll > 0 lowers the
    right side of the camera. The paper's ``R_rp`` (Eq. rays).

    Args:
        gravity: (roll, pitch), rad.

    Returns:
        (3, 3) rotation.

    Raises:
        GalocError: not two finite angles below 85 degrees.
    """
    try:
        values = np.asarray(gravity, dtype=np.float64)
    except (TypeError, ValueError):
        values = np.full(2, np.nan)
    if values.shape != (2,) or not np.all(np.isfinite(values)) or np.any(np.abs(values) > MAX_TILT):
        raise GalocError(
            f"gravity = {gravity!r}",
            "(roll, pitch) in radians, both finite and within 85 degrees of level",
            "Check the IMU reading and its unit; pass (0.0, 0.0) for a level camera.",
        )
    roll, pitch = float(values[0]), float(values[1])
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    r_x = np.array([[1.0, 0.0, 0.0], [0.0, cp, -sp], [0.0, sp, cp]])
    r_z = np.array([[cr, -sr, 0.0], [sr, cr, 0.0], [0.0, 0.0, 1.0]])
    return r_x @ r_z


def _check_size(name: str, value: object) -> None:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not 1 <= value <= 16384:
        raise GalocError(f"{name} = {value!r}", "a whole number of pixels from 1 to 16384", "Resize the image.")


@dataclass(frozen=True, slots=True)
class Camera:
    """Pinhole intrinsics without distortion."""

    width: int
    """Image width, px."""
    height: int
    """Image height, px."""
    fx: float
    """Horizontal focal length, px."""
    fy: float
    """Vertical focal length, px."""
    cx: float
    """Principal point column, px (pixel centres at integers)."""
    cy: float
    """Principal point row, px."""

    def __post_init__(self) -> None:
        """Validate, so that no later formula divides by zero."""
        for name in ("width", "height"):
            _check_size(name, getattr(self, name))
        for name in ("fx", "fy", "cx", "cy"):
            value = getattr(self, name)
            if not _is_finite(value) or (name[0] == "f" and value <= 0):
                what = "a focal length above 0 px" if name[0] == "f" else "a finite pixel coordinate"
                raise GalocError(f"{name} = {value!r}", what, "Check the camera calibration.")

    @classmethod
    def from_hfov(cls, width: int, height: int, hfov_deg: float) -> Camera:
        """Square pixels, centred principal point, given horizontal field of view.

        The field of view spans the ``width`` pixels: ``fx = width / (2 tan(hfov / 2))``.

        Args:
            width: px.
            height: px.
            hfov_deg: horizontal field of view, degrees, between 1 and 175.

        Raises:
            GalocError: field of view out of range, or not a usable image size.
        """
        _check_size("width", width)
        _check_size("height", height)
        if not _is_finite(hfov_deg) or not 1.0 <= hfov_deg <= 175.0:
            raise GalocError(
                f"hfov_deg = {hfov_deg!r}",
                "a horizontal field of view between 1 and 175 degrees",
                "Give the camera's field of view in degrees; a pinhole cannot see 180.",
            )
        fx = width / (2.0 * math.tan(math.radians(hfov_deg) / 2.0))
        return cls(width, height, fx, fx, (width - 1) / 2.0, (height - 1) / 2.0)

    @property
    def hfov_rad(self) -> float:
        """Horizontal field of view across the full width (pixel edges), rad."""
        return math.atan((self.cx + 0.5) / self.fx) + math.atan((self.width - 0.5 - self.cx) / self.fx)

    @property
    def hfov_deg(self) -> float:
        """Horizontal field of view, degrees."""
        return math.degrees(self.hfov_rad)

    @property
    def matrix(self) -> Array:
        """Calibration matrix K, (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def rays_camera(self, pixels: ArrayLike) -> Array:
        """``K^-1 [u, v, 1]`` of pixels (..., 2): camera-frame rays (..., 3) with z = 1."""
        uv = np.asarray(pixels, dtype=np.float64)
        out = np.ones((*uv.shape[:-1], 3))
        out[..., 0] = (uv[..., 0] - self.cx) / self.fx
        out[..., 1] = (uv[..., 1] - self.cy) / self.fy
        return out

    def rays_level(self, pixels: ArrayLike, gravity: ArrayLike) -> Array:
        """Levelled rays ``R_rp K^-1 [u, v, 1]`` (paper Eq. rays at theta = 0), (..., 3), y down."""
        return self.rays_camera(pixels) @ levelling(gravity).T

    def project_level(self, points: ArrayLike, gravity: ArrayLike) -> Array:
        """Project level-frame points (..., 3) to pixels (..., 2); NaN for points at or behind the camera plane."""
        camera_points = np.asarray(points, dtype=np.float64) @ levelling(gravity)
        z = camera_points[..., 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            u = self.fx * camera_points[..., 0] / z + self.cx
            v = self.fy * camera_points[..., 1] / z + self.cy
        return np.where((z > 1e-9)[..., None], np.stack([u, v], axis=-1), np.nan)

    def contains(self, pixels: ArrayLike) -> NDArray[np.bool_]:
        """Whether pixels (..., 2) lie on the image (pixel edges included); NaN is outside."""
        uv = np.asarray(pixels, dtype=np.float64)
        u, v = uv[..., 0], uv[..., 1]
        return (u >= -0.5) & (u <= self.width - 0.5) & (v >= -0.5) & (v <= self.height - 0.5)


def azimuth(rays_level: ArrayLike) -> Array:
    """Azimuth atan2(x, z) of levelled rays (..., 3), rad, positive to the right: plan bearing = heading - azimuth."""
    rays = np.asarray(rays_level, dtype=np.float64)
    return np.asarray(np.arctan2(rays[..., 0], rays[..., 2]))


def level_directions(azimuths: ArrayLike, elevations: ArrayLike) -> Array:
    """(..., 3) unit directions in the level frame of azimuths (right positive) and elevations (up positive), rad."""
    az, el = np.asarray(azimuths, dtype=np.float64), np.asarray(elevations, dtype=np.float64)
    flat = np.cos(el)
    return np.stack(np.broadcast_arrays(np.sin(az) * flat, -np.sin(el), np.cos(az) * flat), axis=-1)


def level_angles(directions: ArrayLike) -> tuple[Array, Array]:
    """Azimuth and elevation, rad, of level-frame directions (..., 3) of any length."""
    x, y, z = np.moveaxis(np.asarray(directions, dtype=np.float64), -1, 0)
    return np.arctan2(x, z), np.arctan2(-y, np.hypot(x, z))
