"""galoc: find a camera's pose in a floorplan from wall geometry alone."""

from galoc.camera import Camera
from galoc.errors import GalocError
from galoc.floorplan import Floorplan, Opening
from galoc.layout import solve_layout
from galoc.localizer import Localizer, LocalizerConfig
from galoc.match import Matcher
from galoc.types import Estimate, Layout, Rays, Wireframe

__version__ = "0.1.0"

__all__ = [
    "Camera",
    "Estimate",
    "Floorplan",
    "GalocError",
    "Layout",
    "Localizer",
    "LocalizerConfig",
    "Matcher",
    "Opening",
    "Rays",
    "Wireframe",
    "__version__",
    "solve_layout",
]
