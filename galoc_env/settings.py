"""The environment's arguments: checked once, frozen, and the spaces that follow from them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces

from galoc import Camera, GalocError
from galoc_env.motion import STEP_M
from galoc_env.observe import CANVAS_CELLS
from galoc_env.scoring import REWARDS

HOMES = 100_000
"""Generated homes per split that an environment seed can lead to; larger seeds wrap around."""
DEFAULT_RENDERER = "raster"
"""What draws when nobody says otherwise."""
DEFAULT_DETECTOR = "onnx"
"""What finds the walls."""
CHOICES: dict[str, tuple[str, ...]] = {
    "split": ("train", "test"),
    "homes": ("rooms", "ambiguous"),
    "detector": ("onnx", "oracle", "lines"),
    "geometry": ("ml", "paper"),
    "scoring": ("likelihood", "cosine"),
    "renderer": ("raster", "gl", "none"),
    "quality": ("fast", "default", "best"),
    "actions": ("discrete", "continuous"),
    "reward": REWARDS,
}
"""What this version has, per argument."""
RANGES: dict[str, tuple[float, float, str]] = {
    "detector_noise_px": (0.0, 100.0, "px"),
    "hfov_deg": (10.0, 170.0, "degrees"),
    "camera_height": (0.05, 20.0, "m"),
    "tilt_deg": (0.0, 30.0, "degrees"),
    "imu_noise_deg": (0.0, 10.0, "degrees"),
    "odometry_noise": (0.0, 1.0, "as a fraction of the motion"),
    "furniture": (0.0, 1.0, "as a density"),
    "shut_doors": (0.0, 1.0, "as a share of the doors"),
}
"""Least and largest value of each real argument, and its unit."""
NOISE_PX = 5.0
"""Noise of the oracle's junctions when nobody says otherwise, px of a wide image (the paper's)."""
NOISE_WIDTH_PX = 640
"""Image width that the oracle's noise refers to (the paper's), px."""
MIN_SIDE_PX, MAX_SIDE_PX = 16, 4096
"""Image sides that can be drawn and still show structure, px."""
ODOMETRY_BOUND = np.array([1.0, 1.0, math.pi], dtype=np.float32)
"""Odometry readings lie within this: more than three times the largest motion (m, m, rad)."""
TILT_BOUND = np.full(2, math.pi / 2, dtype=np.float32)
"""Gravity readings lie within this, rad."""
POSITION_BOUND_M = 2e5
"""Coordinates of estimates lie within this (plans lie within half of it), m."""

ESTIMATE_BOUNDS = (
    np.array([-POSITION_BOUND_M, -POSITION_BOUND_M, -math.pi, 0.0], dtype=np.float32),
    np.array([POSITION_BOUND_M, POSITION_BOUND_M, math.pi, 1.0], dtype=np.float32),
)
"""Least and largest estimate in the observation."""

assert STEP_M * 3 < ODOMETRY_BOUND[0]


@dataclass(frozen=True, slots=True)
class Settings:
    """Arguments of :class:`galoc_env.env.FloorplanEnv`; see the tables there."""

    plan: str | None = None
    split: str = "train"
    homes: str = "rooms"
    detector: str = DEFAULT_DETECTOR
    detector_noise_px: float = NOISE_PX
    localizer: str = "galoc"
    geometry: str = "ml"
    scoring: str = "likelihood"
    renderer: str = DEFAULT_RENDERER
    quality: str = "default"
    width: int = 320
    height: int = 240
    hfov_deg: float = 108.0
    camera_height: float = 1.4
    tilt_deg: float = 0.0
    imu_noise_deg: float = 0.5
    odometry_noise: float = 0.02
    furniture: float = 0.5
    shut_doors: float = 0.0
    imaging: str | dict[str, Any] | None = None
    actions: str = "discrete"
    reward: str = "log_belief"
    render_mode: str | None = None

    def __post_init__(self) -> None:
        """Refuse what this version does not have, naming what it has."""
        for name, choices in CHOICES.items():
            if getattr(self, name) not in choices:
                have = " or ".join(f'"{c}"' for c in choices)
                raise GalocError(f"{name} = {getattr(self, name)!r}", have, "This version of galoc_env has only these.")
        for name, (low, high, unit) in RANGES.items():
            value = getattr(self, name)
            if not _is_number(value) or not low <= value <= high:
                raise GalocError(f"{name} = {value!r}", f"{low:g} to {high:g} {unit}", "Pass a number in that range.")
        for name in ("width", "height"):
            value = getattr(self, name)
            if not isinstance(value, int) or isinstance(value, bool) or not MIN_SIDE_PX <= value <= MAX_SIDE_PX:
                expected = f"a whole number of pixels from {MIN_SIDE_PX} to {MAX_SIDE_PX}"
                raise GalocError(f"{name} = {value!r}", expected, "Pass a Python int in that range.")
        for name in ("plan", "localizer"):
            value = getattr(self, name)
            if not isinstance(value, str) and not (name == "plan" and value is None):
                raise GalocError(f"{name} of type {type(value).__name__}", "a string", f"Pass str({name}).")
        if self.plan is not None and self.homes != "rooms":
            cure = "Leave `plan` out to draw such homes, or leave `homes` out."
            raise GalocError(f'homes = "{self.homes}" with plan = "{self.plan}"', "one of the two", cure)
        if not isinstance(self.imaging, str | dict | None):
            expected = "None, the name of a preset, or a dict of its parts"
            raise GalocError(f"imaging of type {type(self.imaging).__name__}", expected, "Pass one of these.")
        if self.render_mode not in (None, "rgb_array"):
            raise GalocError(f"render_mode = {self.render_mode!r}", 'None or "rgb_array"', "Pass one of these.")
        self._check_detector()

    def _check_detector(self) -> None:
        """Refuse a detector that has nothing to look at, and noise that it would not have."""
        if not self.looks:
            return
        if self.detector_noise_px != NOISE_PX:
            got = f'detector_noise_px = {self.detector_noise_px:g} with detector = "{self.detector}"'
            cure = 'Pass detector="oracle", whose noise it is, or leave detector_noise_px out.'
            raise GalocError(got, 'noise for detector = "oracle" alone', cure)
        if not self.draws and (self.localizer != "none" or self.render_mode is not None):
            raise self.refusal()

    def refusal(self) -> GalocError:
        """Why a detector that looks at pictures has none."""
        got = f'detector = "{self.detector}", which looks at pictures, with renderer = "none", which draws none'
        expected = 'a renderer that draws, or detector = "oracle", which knows the walls'
        return GalocError(got, expected, 'Pass detector="oracle", or leave renderer out.')

    def camera(self) -> Camera:
        """The camera that these settings describe."""
        return Camera.from_hfov(self.width, self.height, self.hfov_deg)

    @property
    def looks(self) -> bool:
        """Whether the detector looks at the picture."""
        return self.detector != "oracle"

    @property
    def draws(self) -> bool:
        """Whether the image shows anything."""
        return self.renderer != "none"


def _is_number(value: object) -> bool:
    return isinstance(value, int | float | np.number) and not isinstance(value, bool) and math.isfinite(float(value))


def action_space(settings: Settings) -> spaces.Space[Any]:
    """The action space of one body."""
    return spaces.Discrete(4) if settings.actions == "discrete" else spaces.Box(-1.0, 1.0, (3,), np.float32)


def observation_space(settings: Settings) -> spaces.Dict:
    """The observation space, every bound finite."""
    parts: dict[str, spaces.Space[Any]] = {
        "image": spaces.Box(0, 255, (settings.height, settings.width, 3), np.uint8),
        "gravity": spaces.Box(-TILT_BOUND, TILT_BOUND, dtype=np.float32),
        "odometry": spaces.Box(-ODOMETRY_BOUND, ODOMETRY_BOUND, dtype=np.float32),
    }
    if settings.localizer != "none":
        parts["belief"] = spaces.Box(0.0, 1.0, (2, CANVAS_CELLS, CANVAS_CELLS), np.float32)
        parts["estimate"] = spaces.Box(*ESTIMATE_BOUNDS, dtype=np.float32)
    return spaces.Dict(parts)


def imaging(settings: Settings) -> Any:
    """What lens and sensor do to the picture; None: nothing, or there is none.

    Raises:
        GalocError: no such preset or part.
    """
    if settings.imaging is None:
        return None
    from galoc_env.imaging import Imaging

    camera = Imaging.of(settings.imaging)  # a bad one is refused even where nothing is drawn
    return camera if settings.draws else None


def checked_options(options: dict[str, Any] | None, settings: Settings) -> dict[str, Any]:
    """The options of a reset.

    Raises:
        GalocError: not a dict, unknown option, or a plan seed that does not apply or is out of range.
    """
    if not isinstance(options, dict | None):
        raise GalocError(f"reset options of type {type(options).__name__}", "a dict or None", "Pass a dict.")
    options = dict(options or {})
    unknown = sorted(map(str, set(options) - {"pose", "plan_seed"}))
    if unknown:
        raise GalocError(f"reset options {unknown}", '"pose" and "plan_seed"', "Check the spelling.")
    if "plan_seed" in options:
        value = options["plan_seed"]
        if settings.plan is not None:
            raise GalocError(
                "plan_seed beside a fixed plan", "one of the two", "Leave `plan` out to draw homes by seed."
            )
        if not isinstance(value, int | np.integer) or isinstance(value, bool) or not 0 <= value < HOMES:
            raise GalocError(f"plan_seed = {value!r}", f"a whole number from 0 to {HOMES - 1}", "Pass such a number.")
        options["plan_seed"] = int(value)
    return options
