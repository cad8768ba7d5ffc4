"""What can be set on a localizer."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from galoc.belief import checked_headings, checked_kidnapped, checked_motion
from galoc.checked import number, whole
from galoc.errors import GalocError
from galoc.floorplan import Floorplan
from galoc.heights import Heights


@dataclass(frozen=True, slots=True)
class LocalizerConfig:
    """Everything that can be set. With scoring "cosine" the defaults are the paper's where it states them."""

    resolution: float = 0.1
    """Grid step of the coarse search and of the belief, m (large plans are coarsened, see galoc.profiles)."""
    candidates: int | None = None
    """Cells that :meth:`Localizer.locate` looks at closely; None: 32 refined to 0.01 m (scoring "cosine"), 128
    registered to the map ("likelihood")."""
    exact: bool = False
    """Let :meth:`Localizer.locate` search the 0.01 m x 1 degree lattice exactly (scoring "cosine"; galoc.match). The
    pyramid that this needs takes seconds to minutes to build, once per plan."""
    heights: tuple[float, float] | None = None
    """Known height of the camera and of the ceiling above the floor, m (geometry "ml"); None: unknown. Over a sequence
    they are learned."""
    heights_sd: float = 0.03
    """Relative standard deviation of known heights."""
    ceiling_from_plan: bool = False
    """Take the ceiling's height from the plan, to ``heights_sd``, and leave the camera's unknown (geometry "ml"). For
    plans that state the real height: it fixes the scale of every view."""
    columns: bool = True
    """Take the rays straight from what a network said column by column, where the detector is one (geometry "ml");
    False: from the walls drawn from that."""
    imu_sigma_deg: float = 1.0
    """Standard deviation of measured roll and pitch, degrees (geometry "ml")."""
    odometry_noise: float = 0.02
    """Standard deviation of a motion as a share of its length (scoring "likelihood")."""
    odometry_turn_deg: float = 0.5
    """Standard deviation of the heading change of a step that moves, degrees (scoring "likelihood")."""
    abstain_below: float = 0.0
    """Estimates with a lower confidence count as abstained; their pose is still given (scoring "likelihood")."""
    diffusion_m: float | None = None
    """Position diffusion of the filter per metre moved, m/m. None: 0 ("cosine", as the paper), ``odometry_noise``
    ("likelihood")."""
    diffusion_rad: float | None = None
    """Heading diffusion of the filter per moving step, rad. None: 0 ("cosine") or ``odometry_turn_deg``."""
    motion: str = "carried"
    """What the filter does with the part of a motion below one cell: "carried" or "paper" (see galoc.belief)."""
    headings: int | None = None
    """Heading cells of the filter, a divisor of 360. None: 360 ("cosine", as the paper) or 72 ("likelihood", which
    averages over the degrees of a cell)."""
    kidnapped: float = 0.0
    """Probability per step that the camera was put anywhere."""

    def __post_init__(self) -> None:
        """Refuse what is no number of the right kind (heights are checked where they are used)."""
        for name in (
            "resolution",
            "heights_sd",
            "imu_sigma_deg",
            "odometry_noise",
            "odometry_turn_deg",
            "abstain_below",
        ):
            number(name, getattr(self, name), 0.0, sys.float_info.max, cure="Fix the LocalizerConfig.")
        for name in ("diffusion_m", "diffusion_rad"):
            if getattr(self, name) is not None:
                number(name, getattr(self, name), 0.0, sys.float_info.max, cure="Leave it out, or fix it.")
        for name in ("exact", "ceiling_from_plan", "columns"):
            if not isinstance(getattr(self, name), bool):
                raise GalocError(f"{name} = {getattr(self, name)!r}", "True or False", "Fix the LocalizerConfig.")
        if self.candidates is not None:
            whole("candidates", self.candidates, 1, "Leave it out.")
        if self.heights is not None and not (isinstance(self.heights, tuple | list) and len(self.heights) == 2):
            raise GalocError(f"heights = {self.heights!r}", "(camera, ceiling) above the floor, m", "Fix it.")
        checked_motion(self.motion)
        checked_kidnapped(self.kidnapped)
        if self.headings is not None:
            checked_headings(self.headings)

    def prior(self, plan: Floorplan) -> Heights:
        """What is known of the heights before the first image."""
        if self.heights is not None:
            return Heights.known(*self.heights, sd=self.heights_sd)
        return Heights.under(plan.ceiling_height, self.heights_sd) if self.ceiling_from_plan else Heights()
