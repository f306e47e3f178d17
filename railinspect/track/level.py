"""The levelled view: pixels with lens distortion and roll removed, measured from the horizon.

A pixel becomes (X, Y): X to the right and Y downwards from the principal point, in pixels of a
camera without roll and distortion. The horizon is the row ``Y_h = −f·tan θ`` (θ pitch), and
``s = Y − Y_h`` counts pixels below it. In the camera's own ground frame (x ahead along its
horizontal heading, y left, origin under the camera) the plane of the rail tops is then

    x = f·h / (s·cos²θ) − h·tan θ        y = −X·h / (s·cos θ)

so lateral metres need no focal length, and the spacing of two rails grows linearly with s:
``w = k·s`` with ``k = spacing_m·cos θ / h``. An uncalibrated camera therefore still has a
self-consistent model: horizon row and k are measured, only x carries the unknown focal length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numba
import numpy as np
import numpy.typing as npt

from railinspect.camera import Camera

Array = npt.NDArray[np.float64]

# Layout of the parameter vector the compiled loops take.
FOCAL, CX, CY, COS_R, SIN_R, HORIZON, HEIGHT, K1, K2, P1, P2, K3 = range(12)


@dataclass(frozen=True)
class Level:
    """A camera seen as its levelled view, with the horizon of this frame.

    Attributes:
        camera: The camera; its yaw and offset are ignored, its pitch is replaced by the horizon's.
        horizon_px: Y_h, levelled pixels below the principal point.
    """

    camera: Camera
    horizon_px: float

    @staticmethod
    def of(camera: Camera) -> Level:
        """The levelled view at the camera's own pitch."""
        return Level(camera, -camera.focal_px * math.tan(camera.pitch_rad))

    @property
    def pitch_rad(self) -> float:
        """Pitch that puts the horizon where it is, radians."""
        return -math.atan(self.horizon_px / self.camera.focal_px)

    @property
    def bottom_px(self) -> float:
        """Levelled row Y of the image's bottom centre, pixels."""
        width, height = self.camera.size_wh
        return float(self.from_pixels(np.array([[(width - 1) / 2, height - 1.0]]))[0, 1])

    def with_horizon(self, horizon_px: float) -> Level:
        """The same view with another horizon."""
        return replace(self, horizon_px=horizon_px)

    @cached_property
    def vector(self) -> Array:
        """Parameters for the compiled loops, shape (12,)."""
        c = self.camera
        k1, k2, p1, p2, k3 = c.distortion
        return np.array(
            [
                c.focal_px,
                *c.principal_uv,
                math.cos(c.roll_rad),
                math.sin(c.roll_rad),
                self.horizon_px,
                c.height_m,
                *(k1, k2, p1, p2, k3),
            ]
        )

    def from_pixels(self, pixels_uv: npt.ArrayLike) -> Array:
        """Levelled (X, Y) of input pixels, shape (..., 2)."""
        c = self.camera
        shifted = c.undistort(pixels_uv) - np.array(c.principal_uv)
        cr, sr = math.cos(c.roll_rad), math.sin(c.roll_rad)
        turned: Array = shifted @ np.array([[cr, sr], [-sr, cr]])
        return turned

    def to_pixels(self, level_xy: npt.ArrayLike) -> Array:
        """Input pixels of levelled (X, Y), shape (..., 2)."""
        c = self.camera
        cr, sr = math.cos(c.roll_rad), math.sin(c.roll_rad)
        turned = np.asarray(level_xy, float) @ np.array([[cr, -sr], [sr, cr]])
        return c.distort(turned + np.array(c.principal_uv))

    def ground_from_level(self, level_xy: npt.ArrayLike) -> Array:
        """Ground (x, y), metres, of levelled points, shape (..., 2); NaN from the horizon up."""
        points = np.asarray(level_xy, float)
        s = points[..., 1] - self.horizon_px
        s = np.where(s > 1e-6, s, np.nan)
        theta, h, f = self.pitch_rad, self.camera.height_m, self.camera.focal_px
        x = f * h / (s * math.cos(theta) ** 2) - h * math.tan(theta)
        y = -points[..., 0] * h / (s * math.cos(theta))
        return np.stack([x, y], axis=-1)

    def level_from_ground(self, ground_xy: npt.ArrayLike) -> Array:
        """Levelled (X, Y) of ground points; NaN at or behind the camera. Shape (..., 2)."""
        points = np.asarray(ground_xy, float)
        theta, h, f = self.pitch_rad, self.camera.height_m, self.camera.focal_px
        ahead = points[..., 0] + h * math.tan(theta)
        ahead = np.where(ahead > 1e-3, ahead, np.nan)
        s = f * h / (math.cos(theta) ** 2 * ahead)
        return np.stack([-points[..., 1] * s * math.cos(theta) / h, s + self.horizon_px], axis=-1)

    def ground(self, pixels_uv: npt.ArrayLike) -> Array:
        """Ground (x, y), metres, of input pixels; NaN at or above the horizon. Shape (..., 2)."""
        return self.ground_from_level(self.from_pixels(pixels_uv))

    def pixels(self, ground_xy: npt.ArrayLike) -> Array:
        """Input pixels of ground points; NaN at or behind the camera. Shape (..., 2)."""
        points = np.asarray(ground_xy, float)
        flat = np.ascontiguousarray(points).reshape(-1, 2)
        return _pixels(self.vector, flat).reshape(points.shape)


def world_pixels(camera: Camera, world_xy: Array) -> Array:
    """Input pixels of points of the world's ground; NaN at or behind the camera. Shape (N, 2)."""
    cos, sin = math.cos(camera.yaw_rad), math.sin(camera.yaw_rad)
    ahead = (world_xy - np.array([0.0, camera.offset_m])) @ np.array([[cos, -sin], [sin, cos]])
    return Level.of(camera).pixels(ahead)


@numba.njit(cache=True, inline="always")
def project(cam: Array, x: float, y: float) -> tuple[float, float]:
    """Input pixel (u, v) of one ground point, for the compiled loops; x must lie ahead."""
    f, h, horizon = cam[FOCAL], cam[HEIGHT], cam[HORIZON]
    tan_t = -horizon / f
    inv_cos = math.sqrt(1.0 + tan_t * tan_t)
    s = f * h * inv_cos * inv_cos / (x + h * tan_t)
    lx = -y * s / (inv_cos * h)
    ly = s + horizon
    a = (cam[COS_R] * lx + cam[SIN_R] * ly) / f
    b = (cam[COS_R] * ly - cam[SIN_R] * lx) / f
    if cam[K1] != 0.0 or cam[K2] != 0.0 or cam[P1] != 0.0 or cam[P2] != 0.0 or cam[K3] != 0.0:
        r2 = a * a + b * b
        radial = 1.0 + r2 * (cam[K1] + r2 * (cam[K2] + r2 * cam[K3]))
        da = a * radial + 2.0 * cam[P1] * a * b + cam[P2] * (r2 + 2.0 * a * a)
        b = b * radial + cam[P1] * (r2 + 2.0 * b * b) + 2.0 * cam[P2] * a * b
        a = da
    return f * a + cam[CX], f * b + cam[CY]


@numba.njit(cache=True)
def _pixels(cam: Array, ground_xy: Array) -> Array:
    """Input pixels of ground points (N, 2); NaN at or behind the camera."""
    out = np.empty_like(ground_xy)
    for i in range(len(ground_xy)):
        out[i, 0], out[i, 1] = pixel(cam, ground_xy[i, 0], ground_xy[i, 1])
    return out


@numba.njit(cache=True, inline="always")
def pixel(cam: Array, x: float, y: float) -> tuple[float, float]:
    """Input pixel (u, v) of any ground point, for the compiled loops; NaN where not ahead."""
    if x > cam[HEIGHT] * cam[HORIZON] / cam[FOCAL] + 1e-3:
        return project(cam, x, y)
    return np.nan, np.nan


@numba.njit(cache=True, inline="always")
def x_at(cam: Array, s: float) -> float:
    """Ground distance ahead x, metres, of a levelled row s pixels below the horizon."""
    f, h = cam[FOCAL], cam[HEIGHT]
    tan_t = -cam[HORIZON] / f
    x: float = f * h * (1.0 + tan_t * tan_t) / s - h * tan_t
    return x


@numba.njit(cache=True, inline="always")
def inside(rows: int, cols: int, u: float, v: float) -> bool:
    """Whether (u, v) lies between the centres of an image's outermost pixels."""
    return 0.0 <= u <= cols - 1.0 and 0.0 <= v <= rows - 1.0


@numba.njit(cache=True, inline="always")
def bilinear(image: npt.NDArray[np.uint8], u: float, v: float) -> float:
    """Grey value at (u, v), bilinear; −1 outside the image."""
    rows, cols = image.shape
    if not inside(rows, cols, u, v):
        return -1.0
    c, r = int(u), int(v)
    return blend(image, u, v, c, r, min(c + 1, cols - 1), min(r + 1, rows - 1))


@numba.njit(cache=True, inline="always")
def blend(
    image: npt.NDArray[np.uint8], u: float, v: float, c: int, r: int, c1: int, r1: int
) -> float:
    """Grey value at (u, v) between columns c, c1 and rows r, r1, which must lie in the image."""
    a, b = u - c, v - r
    top = image[r, c] * (1.0 - a) + image[r, c1] * a
    low = image[r1, c] * (1.0 - a) + image[r1, c1] * a
    value: float = top * (1.0 - b) + low * b
    return value


@numba.njit(cache=True, inline="always")
def sample_line(
    image: npt.NDArray[np.uint8],
    u: float,
    v: float,
    du: float,
    dv: float,
    first: int,
    parts: float,
    out: Array,
) -> None:
    """Grey values, 0..1 and 0 outside the image, at (u, v) + i/parts·(du, dv), i from ``first``."""
    rows, cols = image.shape
    start, end = first / parts, (first + len(out) - 1) / parts
    low_u, high_u = min(u + start * du, u + end * du), max(u + start * du, u + end * du)
    low_v, high_v = min(v + start * dv, v + end * dv), max(v + start * dv, v + end * dv)
    if low_u >= 0.0 and high_u < cols - 1.0 and low_v >= 0.0 and high_v < rows - 1.0:
        for i in range(len(out)):  # no place needs to be tested by itself
            t = (first + i) / parts
            at_u, at_v = u + t * du, v + t * dv
            c, r = int(at_u), int(at_v)
            out[i] = blend(image, at_u, at_v, c, r, c + 1, r + 1) / 255.0
    else:
        for i in range(len(out)):
            t = (first + i) / parts
            out[i] = max(0.0, bilinear(image, u + t * du, v + t * dv)) / 255.0
