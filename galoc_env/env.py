"""The Gymnasium environment: walk through a furnished floorplan and be localized from wall geometry."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from galoc_env import motion, settings
from galoc_env.bodies import Bodies
from galoc_env.settings import DEFAULT_DETECTOR, DEFAULT_RENDERER
from galoc_env.world import Episode, Snapshot, World
from galoc_env.worlds import Worlds

Observation = dict[str, Any]


class FloorplanEnv(gymnasium.Env[Observation, Any]):
    """A camera walks through a furnished floorplan; a localizer finds its pose from wall geometry alone.

    ## Description
    Every step the body (radius 0.25 m) moves, the world is drawn from the camera, the detector turns the picture into a
    wall wireframe, and the localizer updates its belief over the pose from the wireframe, the measured gravity and
    the measured odometry. What the agent does decides what the camera sees, so an agent can be trained to localize
    fast. Plan frame: x right, y up, metres; heading counter-clockwise from +x, radians.

    ## Action space
    `actions="discrete"`, `Discrete(4)`:

    | action | motion |
    |---|---|
    | 0 | forward 0.3 m |
    | 1 | backward 0.3 m |
    | 2 | turn left 30 degrees |
    | 3 | turn right 30 degrees |

    `actions="continuous"`, `Box(-1, 1, (3,), float32)`: forward (x 0.3 m), left (x 0.3 m), turn left (x 30 degrees);
    the translation happens first, in the old body frame. A motion ends where the body touches a wall or furniture
    (`info["collided"]`), and odometry reports the motion that took place. An action out of the space raises.

    ## Observation space
    A `Dict`:

    | key | type | content | unit |
    |---|---|---|---|
    | `image` | uint8 (height, width, 3) | RGB view; all zero with `renderer="none"` | 0..255 |
    | `gravity` | float32 (2,) | measured roll, pitch of the camera | rad, +-pi/2 |
    | `odometry` | float32 (3,) | measured forward, left, turn left since the last observation | m, m, rad |
    | `belief` | float32 (2, 64, 64) | position marginal of the belief; free space | 0..1 |
    | `estimate` | float32 (4,) | x, y, heading, confidence | m, m, rad, 0..1 |

    - `gravity`: pitch > 0 looks up, roll > 0 lowers the right side of the camera.
    - `odometry`: zero after a reset; bounds +-(1 m, 1 m, pi).
    - `belief`: a square canvas over the plan's bounding box, equal scale in x and y, plan centred, row 0 at the top
      (largest y). [0] mean probability of the belief's cells in each canvas cell, scaled to maximum 1; zero for a
      localizer without a `belief`. [1] share of the cell that is free.
    - `estimate`: all zero when there is nothing to report; bounds +-2e5 m, +-pi.

    `belief` and `estimate` are absent with `localizer="none"`. Readings are clipped to these bounds.

    ## Rewards
    | `reward` | reward of a step |
    |---|---|
    | `log_belief` | change of log(belief mass within 0.5 m and 15 degrees of the true pose, floored at 1e-6), nats |
    | `infogain` | entropy of the belief before minus after, nats |
    | `error` | -min(position error, 10), m |
    | `success` | 1 at the first step that ends 10 consecutive ones within 0.5 m of the true position, else 0 |

    - The first two need a localizer with a belief. With `localizer="none"` nothing is scored and the reward is 0.
    - They are changes of a potential, so an episode's return is the last value minus that of the reset, whatever lies
      between: at most log(1e6) = 13.8 either way for `log_belief`, and log of the number of cells for `infogain`. A
      belief that does not change earns nothing; standing still earns what a second look tells. Sooner is better only
      under a discount.
    - `error` is -10 to 0 at every step, standing still included, and -10 where there is no estimate. The return of
      `success` is 0 or 1.

    ## Starting state
    A random pose in the largest region in which the body can roam, uniform over its cells, heading uniform. With
    `plan=None` the world is a generated home (of the sort `homes`): `reset(seed=s)` draws home number `s` modulo
    100000 of `split`; later resets without a seed stay in that home. The same seed gives the same bytes.

    `reset` options: `"pose"`: (x, y, heading) to start from; `"plan_seed"`: number of the home (only with
    `plan=None`), whatever the seed.

    ## Episode end
    Terminates with `reward="success"` only, at the step that earns the 1. Truncated after 100 steps by default
    (`max_episode_steps` of `gymnasium.make`). Collisions do not end an episode.

    ## Arguments
    | argument | default | values |
    |---|---|---|
    | `plan` | None | plan file or name of a shipped plan ("apartment"); None: a home generated from the seed |
    | `split` | "train" | "train" or "test": which homes are generated |
    | `homes` | "rooms" | "rooms": :mod:`galoc_env.homes`; "ambiguous" (not with `plan`): :mod:`galoc_env.ambiguous` |
    | `detector` | "onnx" | what finds the walls: "onnx", "lines" or "oracle" (below) |
    | `detector_noise_px` | 5.0 | "oracle" only: sd of each junction coordinate, px of a 640 px wide image |
    | `localizer` | "galoc" | "galoc", "none" or "module:Class" (below) |
    | `geometry` | "ml" | "ml" or "paper" |
    | `scoring` | "likelihood" | "likelihood" or "cosine"; only paper + cosine is the paper's method |
    | `renderer` | "raster" | "raster": numba; "gl": pyrender; "none": `image` stays zero (below) |
    | `quality` | "default" | "fast", "default" or "best" pictures, of "raster" only |
    | `width`, `height` | 320, 240 | image size, px; 16 to 4096 |
    | `hfov_deg` | 108.0 | horizontal field of view, degrees; 10 to 170 |
    | `camera_height` | 1.4 | above the floor, m; below the ceiling |
    | `tilt_deg` | 0.0 | largest true roll and pitch, degrees (0 to 30): a smooth sway over the episode |
    | `imu_noise_deg` | 0.5 | sd of each gravity reading, degrees |
    | `odometry_noise` | 0.02 | sd as a fraction of the motion (:func:`galoc_env.sensors.measure_odometry`) |
    | `furniture` | 0.5 | density, 0 to 1 |
    | `shut_doors` | 0.0 | share of the doors that are shut, 0 to 1: walls to camera and body, not in the map |
    | `imaging` | None | what the camera does to `image`: preset or dict (:mod:`galoc_env.imaging`); None: nothing |
    | `actions` | "discrete" | "discrete" or "continuous" |
    | `reward` | "log_belief" | see Rewards |
    | `render_mode` | None | "rgb_array": 1280 x 720 picture of view, belief, truth and estimate |

    Detectors:

    | `detector` | the wireframe is |
    |---|---|
    | "onnx" | what the learned network that ships with galoc sees in `image`, given the measured gravity |
    | "lines" | what straight line segments in `image` suggest: no weights, far less reliable |
    | "oracle" | the true junctions plus noise: `image` is not looked at |

    "onnx" and "lines" see what the agent sees, `imaging` included; "onnx" is also told what the localizer has learned
    of the heights (a `heights` like galoc's). All environments of a process share one detector. The oracle's noise
    scales with `width` and is refused for the others. `renderer="none"` is for runs in which nobody looks at pixels:
    with it, a localizer or `render_mode` needs the oracle, and then all but `image` is as if it were drawn.

    galoc's own localizer is told `imu_noise_deg` and `odometry_noise`, no height. A localizer "module:Class" is built
    as `Class(plan, camera)` and has `reset()` and `step(wireframe, gravity=..., odometry=...) -> galoc.Estimate`;
    a `belief` like galoc's is optional.

    Each noise has an exact zero and its own random stream: changing one leaves the others' values as they were.
    Nor does it matter who looks: the oracle's noise depends on the episode and the step alone.

    ## Many at once
    :class:`galoc_env.vector.FloorplanVectorEnv` steps many of these in one process, to the same bytes.

    ## Info
    `pose` (3,) true pose; `collided`; and with a localizer `estimate` (3,) (zero when there is nothing to report),
    `error_m`, `error_rad` (infinity and pi when there is nothing to report), `entropy` (nats; only with a belief),
    `coverage` (share of rays that are known), `abstained` (this image showed no usable structure), and `metrics`:
    those of the episode so far (:func:`galoc_env.scoring.episode_metrics`).

    ## Version history
    - v0: first version.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 6}

    def __init__(
        self,
        plan: str | None = None,
        split: str = "train",
        homes: str = "rooms",
        detector: str = DEFAULT_DETECTOR,
        detector_noise_px: float = settings.NOISE_PX,
        localizer: str = "galoc",
        geometry: str = "ml",
        scoring: str = "likelihood",
        renderer: str = DEFAULT_RENDERER,
        quality: str = "default",
        width: int = 320,
        height: int = 240,
        hfov_deg: float = 108.0,
        camera_height: float = 1.4,
        tilt_deg: float = 0.0,
        imu_noise_deg: float = 0.5,
        odometry_noise: float = 0.02,
        furniture: float = 0.5,
        shut_doors: float = 0.0,
        imaging: str | dict[str, Any] | None = None,
        actions: str = "discrete",
        reward: str = "log_belief",
        render_mode: str | None = None,
    ) -> None:
        given = {k: v for k, v in locals().items() if k not in ("self", "__class__")}
        self.settings = settings.Settings(**given)
        self.camera = self.settings.camera()
        self.render_mode = render_mode
        self.action_space = settings.action_space(self.settings)
        self.observation_space = settings.observation_space(self.settings)
        self.world: World | None = None
        self.episode: Episode | None = None
        self._worlds = Worlds(self.settings, 1)
        self._bodies = Bodies(1, self.settings)
        self._imaging = settings.imaging(self.settings)
        self._painter: Any = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode; see the class docstring for ``seed`` and ``options``.

        Raises:
            GalocError: unknown option, or a start pose where the body does not fit.
        """
        super().reset(seed=seed)
        options = settings.checked_options(options, self.settings)
        world = self._enter_world(seed, options.get("plan_seed"))
        self.episode = Episode.start(
            world,
            world.observer,
            self.settings,
            self.camera,
            self._bodies,
            0,
            self.np_random,
            options.get("pose"),
        )
        observation = self._observe(self.episode)
        return observation, self._info(self.episode)

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Move, observe, localize, score.

        Raises:
            GalocError: an action out of the action space.
        """
        episode = self._episode()
        self._bodies.wanted[0] = motion.commanded_motion(action, self.settings.actions)
        self._bodies.step()
        observation = self._observe(episode)
        reward, ends = episode.pay()
        return observation, reward, ends, False, self._info(episode)

    def render(self) -> NDArray[np.uint8] | None:
        """The view with its wireframe beside the plan with belief, truth and estimate: (720, 1280, 3) uint8 RGB."""
        if self.render_mode != "rgb_array":
            return None
        from galoc_env.film import Painter

        world = self._episode().world
        if self._painter is None or self._painter.plan is not world.plan:
            self._painter = Painter(world.plan, world.furniture)
        return self._painter.paint(self.snapshot())

    def snapshot(self) -> Snapshot:
        """Everything about the current step that a picture or a report needs."""
        return Snapshot.of(self._episode())

    def close(self) -> None:
        """Free the renderer."""
        self._worlds.close()
        self.world, self.episode, self._painter = None, None, None

    def _episode(self) -> Episode:
        if self.episode is None:
            raise gymnasium.error.ResetNeeded("Call reset() before step() or render().")
        return self.episode

    def _enter_world(self, seed: int | None, plan_seed: int | None) -> World:
        """The world of this episode; what held on to another one is let go first."""
        number = self._worlds.number(seed, plan_seed, self.world, self.np_random)
        if self.world is None or self.world.number != number:
            self.world, self.episode = None, None
            world = self._worlds.enter(number)
            world.observer = world.make_observer(self.settings, self.camera)
            self._bodies.surround([world.obstacles])
            self.world = world
        return self.world

    def _observe(self, episode: Episode) -> Observation:
        """Draw, and localize where there is a localizer."""
        bodies, world = self._bodies, episode.world
        pose, tilt = bodies.pose[0].copy(), bodies.tilt[0]
        image = world.image(pose, tilt, self.settings, self.camera)
        if self._imaging is not None:
            image = episode.imaged(image, self._imaging)
        episode.image = image
        episode.trail.append(pose)
        reading = bodies.reading[0].copy()
        observation: Observation = {"image": image, "gravity": reading[:2], "odometry": reading[2:]}
        if episode.observer is not None:
            observation.update(episode.localize())
        return observation

    def _info(self, episode: Episode) -> dict[str, Any]:
        bodies = self._bodies
        info: dict[str, Any] = {"pose": bodies.pose[0].copy(), "collided": bodies.has_collided(0)}
        if episode.estimate is not None:
            info.update(episode.verdict())
        return info
