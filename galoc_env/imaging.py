"""What lens, shutter, sensor and file do to a rendered picture. Every knob has an exact zero."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from numbers import Real
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc import Camera, GalocError
from galoc.camera import levelling
from galoc_env import _imaging_kernel as kernel

Image = NDArray[np.uint8]
Light = NDArray[Any]
"""float32, linear, 1 at white; OpenCV's stubs promise no type."""

STEPS = 8192
"""Steps of linear light that have a code of their own: the darkest codes of sRGB are 2.5 steps wide."""
BLUR_STEP_PX = 1.5
"""The shutter's path at the left and right border is sampled this finely, up to ``MOST_SAMPLES``, px."""
MOST_SAMPLES = 16
"""Pictures that make up a blurred one at most."""
HEADROOM = 8.0
"""What the renderer shows as white is up to 1 + this times brighter than white when it spreads as glare."""
HALO = (0.02, 0.12)
"""Radii of the two halos that glare consists of, in picture widths."""
MIXED_LIGHT = 0.4
"""Magenta-green error in units of the amber-blue error."""
LIMITS: dict[str, tuple[float, float]] = {
    "exposure": (0.0, 3.0),
    "white_balance": (0.0, 1.0),
    "vignette": (0.0, 1.0),
    "distortion": (-0.3, 0.3),
    "shutter": (0.0, 1.0),
    "readout": (0.0, 1.0),
    "glare": (0.0, 1.0),
    "shot_noise": (0.0, 0.3),
    "read_noise": (0.0, 0.3),
    "gamma": (0.0, 1.0),
    "contrast": (0.0, 1.0),
    "jpeg": (0, 100),
}
"""Lowest and highest value of each knob."""
MOST_OFF = 2.0
"""Exposures are wrong by so many sd at most: a camera's automatic leaves no picture black or white."""
PRESETS: dict[str, dict[str, Any]] = {
    name: dict(zip(LIMITS, values, strict=True))
    for name, values in {
        "none": (*(0.0,) * 11, 0),
        "phone": (0.15, 0.04, 0.12, -0.005, 0.03, 0.04, 0.03, 0.012, 0.003, 0.05, 0.3, 92),
        "webcam": (0.3, 0.08, 0.25, -0.02, 0.06, 0.07, 0.05, 0.02, 0.006, 0.08, 0.2, 75),
        "poor": (0.5, 0.15, 0.5, -0.05, 0.12, 0.08, 0.12, 0.05, 0.012, 0.15, 0.4, 35),
    }.items()
}
"""Knobs of the named cameras, in the order of ``LIMITS``. Half a second passes between pictures: 0.03 is 1/66 s."""


@dataclass(frozen=True, slots=True)
class Imaging:
    """A camera between the light and the file; the default changes nothing.

    Light passes the moving lens (turn during the exposure, distortion, vignette, glare), the sensor (exposure, white
    balance, noise; all in linear light) and the processing (tone curve, JPEG). Exposure, white balance and gamma
    are drawn anew for every picture.
    """

    exposure: float = 0.0
    """Error of the exposure, sd, stops (factors of 2); no draw is further off than twice that."""
    white_balance: float = 0.0
    """Error of the white balance, sd of the natural logarithm of red's and, against it, blue's gain."""
    vignette: float = 0.0
    """Share of the light that the corners lose; grows with the square of the distance from the centre."""
    distortion: float = 0.0
    """What a calibration left of the lens's distortion: a pinhole has the point at radius r (1: the corner) at
    r (1 - distortion r^2). Negative: barrel. The picture goes on beyond its edges by repeating them."""
    shutter: float = 0.0
    """Time for which a row is exposed, as a share of the time between two pictures (of the environment: its steps)."""
    readout: float = 0.0
    """Time from the top row's exposure to the bottom row's, as a share of the time between two pictures. The middle of
    the exposure of the middle row is the time of the picture."""
    glare: float = 0.0
    """Share of the light that is scattered around bright things."""
    shot_noise: float = 0.0
    """sd of the photon noise at white, as a share of white: 1 / sqrt(electrons at white)."""
    read_noise: float = 0.0
    """sd of the read-out noise, as a share of white: electrons / electrons at white."""
    gamma: float = 0.0
    """Error of the tone curve, sd of the natural logarithm of its exponent."""
    contrast: float = 0.0
    """Strength of the S-shaped tone curve: 1 is smoothstep."""
    jpeg: int = 0
    """JPEG quality from 1 to 100; 0: no compression."""

    def __post_init__(self) -> None:
        """Refuse what is out of range."""
        for name, (low, high) in LIMITS.items():
            value = getattr(self, name)
            whole = name != "jpeg" or isinstance(value, int | np.integer)
            number = isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
            if not (number and whole and low <= value <= high):
                kind = "a whole number" if name == "jpeg" else "a number"
                raise GalocError(f"imaging {name} = {value!r}", f"{kind} from {low:g} to {high:g}", f"Change {name}.")

    @classmethod
    def preset(cls, name: str) -> Imaging:
        """A named camera: "none", "phone", "webcam" or "poor".

        Raises:
            GalocError: unknown name.
        """
        if name not in PRESETS:
            raise GalocError(f"imaging {name!r}", f"one of {', '.join(PRESETS)}", "Pass one of these, or the knobs.")
        return cls(**PRESETS[name])

    @classmethod
    def random(cls, rng: np.random.Generator, strength: float = 1.0) -> Imaging:
        """A camera drawn between "none" and "poor", knob by knob.

        Args:
            rng: drawn from the same number of times whatever the strength.
            strength: 0 (changes nothing) to 1 (each knob uniform up to the one of "poor").

        Raises:
            GalocError: strength out of range.
        """
        if not isinstance(strength, Real) or not 0.0 <= strength <= 1.0:
            raise GalocError(f"strength = {strength!r}", "a number from 0 to 1", "Pass 1 for the full range.")
        share = strength * rng.random(len(LIMITS))
        signs = {"distortion": rng.choice([-1.0, 1.0])}
        poor = PRESETS["poor"]
        knobs = {name: float(signs.get(name, 1.0) * s * poor[name]) for name, s in zip(LIMITS, share, strict=True)}
        quality = 0 if strength == 0.0 else round(100.0 - share[-1] * (100.0 - poor["jpeg"]))
        return cls(**{**knobs, "jpeg": int(quality)})

    @classmethod
    def of(cls, value: Any) -> Imaging:
        """Whatever a caller may give: None (changes nothing), a preset's name, knobs by name, or an ``Imaging``.

        Raises:
            GalocError: none of these, an unknown name or knob, or a value out of range.
        """
        if value is None:
            return cls()
        if isinstance(value, cls):
            return value
        if isinstance(value, str):
            return cls.preset(value)
        if not isinstance(value, Mapping):
            raise GalocError(f"imaging {value!r}", "None, a preset's name, or knobs by name", "Pass 'phone', say.")
        unknown = [str(key) for key in value if key not in LIMITS]
        if unknown:
            raise GalocError(f"imaging knob {', '.join(unknown)}", f"some of {', '.join(LIMITS)}", "Leave it out.")
        return cls(**value)

    def knobs(self) -> dict[str, float]:
        """The knobs by name, as :meth:`of` takes them."""
        return dataclasses.asdict(self)

    def apply(
        self,
        rgb: Image,
        camera: Camera,
        rng: np.random.Generator,
        *,
        turn_rad: float = 0.0,
        gravity: ArrayLike = (0.0, 0.0),
    ) -> Image:
        """What the camera's file shows of a picture.

        Args:
            rgb: (H, W, 3) uint8 sRGB, as a pinhole sees it at the time of the picture.
            camera: intrinsics.
            rng: drawn from in the same way whatever the knobs, so that changing one leaves the others' draws.
            turn_rad: turn to the left over the time between two pictures, rad, about the vertical.
            gravity: true roll and pitch, rad: which way is up, so that the turn is exact in a tilted view.

        Returns:
            (H, W, 3) uint8 sRGB; ``rgb`` itself if nothing changes it.

        Raises:
            GalocError: not such a picture, or a turn or gravity that is not finite.
        """
        _check_picture(rgb, camera, turn_rad)
        draws = rng.standard_normal(4)
        seed = rng.integers(1 << 63, dtype=np.uint64)
        moving = turn_rad != 0.0 and (self.shutter > 0.0 or self.readout > 0.0)
        bent = moving or self.distortion != 0.0
        if bent or self.glare > 0.0 or self._develops():
            light: Light = cv2.LUT(np.ascontiguousarray(rgb), _linear())
            if bent:
                light = self._warped(light, camera, turn_rad if moving else 0.0, gravity)
            if self.glare > 0.0:
                light = (1.0 - self.glare) * light + self.glare * _halo(light)
            rgb = self._developed(light, draws, seed)
        return _compressed(rgb, self.jpeg) if self.jpeg else rgb

    def _develops(self) -> bool:
        """Whether anything happens between lens and file."""
        names = ("exposure", "white_balance", "vignette", "shot_noise", "read_noise", "gamma", "contrast")
        return any(getattr(self, name) for name in names)

    def _warped(self, light: Light, camera: Camera, turn_rad: float, gravity: ArrayLike) -> Light:
        """The picture as a turning, bent lens throws it on the sensor: a mean over the exposure."""
        height, width = light.shape[:2]
        focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
        vertical = levelling(gravity)[1].copy()
        row_time = self.readout * (np.arange(height) - 0.5 * (height - 1)) / height
        half = 0.5 * width
        path_px = abs(turn_rad) * self.shutter * (camera.fx + half * half / camera.fx)
        samples = min(1 + math.ceil(path_px / BLUR_STEP_PX), MOST_SAMPLES)
        maps = np.empty((2, height, width), np.float32)
        total: Light | None = None
        for i in range(samples):
            time = row_time + self.shutter * ((i + 0.5) / samples - 0.5)
            kernel.source_maps(focal, centre, vertical, turn_rad * time, self.distortion, maps[0], maps[1])
            seen = cv2.remap(light, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            total = seen if total is None else cv2.accumulate(seen, total)
        assert total is not None
        return total if samples == 1 else total * np.float32(1.0 / samples)

    def _developed(self, light: Light, draws: NDArray[np.float64], seed: Any) -> Image:
        """Sensor and tone curve."""
        stops, amber, green, bend = draws
        gain = 2.0 ** (self.exposure * min(max(stops, -MOST_OFF), MOST_OFF))
        tint = self.white_balance * np.array([amber, MIXED_LIGHT * green, -amber])
        gains = (gain * np.exp(tint)).astype(np.float32)
        codes = _codes(math.exp(self.gamma * bend), self.contrast)
        out = np.empty(light.shape, np.uint8)
        light = np.ascontiguousarray(light)
        kernel.develop(light, gains, self.vignette, self.shot_noise, self.read_noise, seed, _normal(), codes, out)
        return out


def _check_picture(rgb: Image, camera: Camera, turn_rad: float) -> None:
    shape = (camera.height, camera.width, 3)
    if not isinstance(rgb, np.ndarray) or rgb.dtype != np.uint8 or rgb.shape != shape:
        got = f"{rgb.dtype} {rgb.shape}" if isinstance(rgb, np.ndarray) else type(rgb).__name__
        raise GalocError(f"a picture {got}", f"uint8 {shape}", "Pass the picture that this camera drew.")
    if not math.isfinite(turn_rad):
        raise GalocError(f"turn_rad = {turn_rad!r}", "radians between two pictures", "Pass 0.0 for a still camera.")


def _halo(light: Light) -> Light:
    """(H, W, 3) light scattered by the lens: bright things, which white stands for, spread more than they show."""
    height, width = light.shape[:2]
    small = cv2.resize(light, (max(width // 8, 1), max(height // 8, 1)), interpolation=cv2.INTER_AREA)
    bright = np.clip((small.max(axis=2, keepdims=True) - 0.6) / 0.4, 0.0, 1.0)
    small = small * (1.0 + HEADROOM * bright**2)
    mean = sum(cv2.GaussianBlur(small, (0, 0), max(r * small.shape[1], 0.5)) for r in HALO) / len(HALO)
    return cv2.resize(mean, (width, height), interpolation=cv2.INTER_LINEAR)


def _compressed(rgb: Image, quality: int) -> Image:
    """The picture after a JPEG file."""
    ok, file = cv2.imencode(
        ".jpg", cv2.cvtColor(np.ascontiguousarray(rgb), cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, int(quality)]
    )
    decoded = cv2.imdecode(file, cv2.IMREAD_COLOR)
    assert ok and decoded is not None  # any uint8 picture can be encoded
    return np.asarray(cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB), np.uint8)


@cache
def _linear() -> Light:
    """(256,) linear light of each sRGB code."""
    s = np.arange(256) / 255.0
    return np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4).astype(np.float32)


@cache
def _encoded() -> NDArray[np.float64]:
    """(STEPS,) sRGB value, 0 to 1, of each step of linear light."""
    x = np.arange(STEPS) / (STEPS - 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def _codes(exponent: float, contrast: float) -> Image:
    """(STEPS,) code of each step of linear light, behind the tone curve."""
    s = _encoded()
    if exponent != 1.0:
        s = s**exponent
    if contrast:
        s = s + contrast * (s * s * (3.0 - 2.0 * s) - s)
    return np.rint(255.0 * s).astype(np.uint8)


@cache
def _normal() -> Light:
    """(4096,) quantiles of the standard normal distribution, scaled to variance 1."""
    from scipy.special import ndtri

    z = ndtri((np.arange(4096) + 0.5) / 4096)
    return (z / z.std()).astype(np.float32)
