"""Many floorplan environments in one process, as a batch: the bodies as arrays, the pictures of all in one call."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import gymnasium
import numba
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space, create_empty_array
from numpy.typing import NDArray

from galoc import GalocError
from galoc_env import motion, settings
from galoc_env.bodies import Bodies
from galoc_env.env import FloorplanEnv
from galoc_env.registration import MAX_EPISODE_STEPS
from galoc_env.vector_options import checked_mode, lane_options, lane_seeds, reset_mask
from galoc_env.vector_pictures import Pictures
from galoc_env.world import Episode, Snapshot, World
from galoc_env.worlds import Worlds

Observation = dict[str, NDArray[Any]]
Bools = NDArray[np.bool_]
Outcome = tuple[Observation, NDArray[np.float64], Bools, Bools, dict[str, Any]]

MOST_WORLDS = 64
"""Worlds are kept for twice the lanes, but no more than this unless that many are needed at once."""


@contextmanager
def one_thread() -> Iterator[None]:
    """Let kernels use this thread only: threads that share work of microseconds spend twice its time on waiting."""
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(before)


class FloorplanVectorEnv(VectorEnv[Observation, NDArray[Any], NDArray[Any]]):
    """A batch of :class:`galoc_env.env.FloorplanEnv`, each with its own seed, home and episode.

    Lane by lane the observations, rewards, ends and infos are those of the single environment with a time limit, to
    the byte, in the layout of :class:`gymnasium.vector.SyncVectorEnv`. ``gymnasium.make_vec`` makes this class unless
    told otherwise; it refuses ``wrappers``, for which ask for ``vectorization_mode="sync"``.

    Lanes in the same home share it (mesh, light, free space), each with a localizer of its own; all share one detector.
    Homes are kept when lanes leave them, twice as many as there are lanes and at most 64 (one per lane where there are
    more lanes).

    ``reset`` takes the single environment's options for all lanes, or one value per lane: ``"pose"`` (L, 3) and
    ``"plan_seed"`` (L,), also lists with None for "no word"; and ``"reset_mask"``, (L,) bool: which lanes to reset.
    Seeds: s for all means s + i for lane i; or a list with one per lane.

    Args:
        num_envs: number of lanes, L.
        max_episode_steps: an episode is truncated after so many steps; None: never.
        autoreset_mode: when a lane that has ended starts again: with the next step (whose action is ignored there),
            in the same one (the last observation and info are ``infos["final_obs"]`` and ``infos["final_info"]``),
            or when told to by ``reset_mask``.
        copy: return copies of the observations; False: the same arrays every time, overwritten by the next step.
        **arguments: as for :class:`galoc_env.env.FloorplanEnv`, with the same defaults.

    Raises:
        GalocError: an argument out of range.
    """

    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int | None = MAX_EPISODE_STEPS,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        copy: bool = True,
        **arguments: Any,
    ) -> None:
        for name, value in (("num_envs", num_envs), ("max_episode_steps", max_episode_steps)):
            if value is not None and (not isinstance(value, int | np.integer) or isinstance(value, bool) or value < 1):
                raise GalocError(f"{name} = {value!r}", "a whole number from 1", f"Pass {name}=8, say.")
        num_envs = self.num_envs = int(num_envs)
        self.settings = settings.Settings(**arguments)
        self.camera = self.settings.camera()
        self.render_mode = self.settings.render_mode
        self.autoreset_mode = checked_mode(autoreset_mode)
        self.metadata = {**FloorplanEnv.metadata, "autoreset_mode": self.autoreset_mode}
        self.single_action_space = settings.action_space(self.settings)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.single_observation_space = settings.observation_space(self.settings)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._copy, self._limit = copy, max_episode_steps
        self._worlds = Worlds(self.settings, max(num_envs, min(2 * num_envs, MOST_WORLDS)))
        self._bodies = Bodies(num_envs, self.settings)
        self._pictures = Pictures(self.settings, self.camera)
        self._random: list[tuple[np.random.Generator, int] | None] = [None] * num_envs
        self._lanes: list[Episode | None] = [None] * num_envs
        self._out: Any = create_empty_array(self.single_observation_space, num_envs, fn=np.zeros)
        self._ended = np.zeros(num_envs, np.bool_)
        self._painters: dict[int, Any] = {}

    @property  # type: ignore[misc]
    def np_random(self) -> Any:
        """The lanes' random number generators."""
        return tuple(self._random_of(lane)[0] for lane in range(self.num_envs))

    @property
    def np_random_seed(self) -> Any:
        """The seeds of the lanes' random number generators."""
        return tuple(self._random_of(lane)[1] for lane in range(self.num_envs))

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start episodes; see the class docstring for ``seed`` and ``options``.

        Raises:
            GalocError: unknown option, a value that does not fit the lanes, or a start where the body does not fit.
        """
        self.closed = False
        seeds = lane_seeds(seed, self.num_envs)
        mask = reset_mask(options, self.num_envs)
        asked = lane_options(options, self.num_envs, self.settings)
        if not mask.all() and any(episode is None for episode in self._lanes):
            raise gymnasium.error.ResetNeeded("Reset all lanes before resetting some.")
        lanes = np.flatnonzero(mask)
        try:
            self._start(lanes, seeds, asked)
            self._ended[mask] = False
            self._observe(lanes)
        except BaseException:
            # Stopped half-way, some lanes may stand in one home and bump into the walls of another.
            self._lanes = [None if mask[lane] else episode for lane, episode in enumerate(self._lanes)]
            raise
        return self._observations(), self._infos(lanes)

    def step(self, actions: NDArray[Any]) -> Outcome:
        """Move all bodies, draw, localize, score; lanes that have ended start again as ``autoreset_mode`` says.

        Raises:
            GalocError: an action out of the action space (those of lanes that start again are not looked at).
        """
        if any(episode is None for episode in self._lanes):
            raise gymnasium.error.ResetNeeded("Call reset() before step().")
        if self.autoreset_mode == AutoresetMode.DISABLED and self._ended.any():
            raise gymnasium.error.ResetNeeded(f"Lanes {np.flatnonzero(self._ended)} have ended: reset them by mask.")
        fresh = np.flatnonzero(self._ended).tolist()
        self._bodies.wanted[:] = self._wanted(actions)
        self._bodies.step(resting=fresh)
        self._start(fresh)
        everyone = np.arange(self.num_envs)
        self._observe(everyone)
        rewards, terminations = np.zeros(self.num_envs), np.zeros(self.num_envs, np.bool_)
        if self._localizes:
            for lane in np.flatnonzero(~self._ended).tolist():
                rewards[lane], terminations[lane] = self._episode(lane).pay()
        truncations = np.zeros(self.num_envs, np.bool_) if self._limit is None else self._bodies.steps >= self._limit
        ended = terminations | truncations
        infos: dict[str, Any] = {}
        if self.autoreset_mode == AutoresetMode.SAME_STEP:
            infos = self._restart(np.flatnonzero(ended))
        else:
            self._ended = ended
        if self._localizes:
            return self._observations(), rewards, terminations, truncations, self._infos(everyone, infos)
        return self._observations(), rewards, terminations, truncations, self._motion_infos(infos)

    def render(self) -> tuple[Any, ...]:
        """Each lane's picture, as the single environment paints it; Nones without a ``render_mode``."""
        if self.render_mode != "rgb_array":
            return (None,) * self.num_envs
        from galoc_env.film import Painter

        pictures = []
        for lane in range(self.num_envs):
            world = self._episode(lane).world
            painter = self._painters.get(world.number)
            if painter is None or painter.plan is not world.plan:
                painter = self._painters[world.number] = Painter(world.plan, world.furniture)
            pictures.append(painter.paint(self.snapshot(lane)))
        return tuple(pictures)

    def snapshot(self, lane: int) -> Snapshot:
        """Everything about a lane's current step; its trail is kept with ``render_mode="rgb_array"`` only."""
        episode = self._episode(lane)
        episode.image = self._out["image"][lane].copy()
        return Snapshot.of(episode)

    def close_extras(self, **kwargs: Any) -> None:
        """Free worlds and renderers; a reset builds them again."""
        self._pictures.close()
        self._worlds.close()
        self._painters.clear()
        self._lanes = [None] * self.num_envs
        self._ended[:] = False

    @property
    def _localizes(self) -> bool:
        return self.settings.localizer != "none"

    def _episode(self, lane: int) -> Episode:
        episode = self._lanes[lane]
        if episode is None:
            raise gymnasium.error.ResetNeeded("Call reset() before step() or render().")
        return episode

    def _random_of(self, lane: int) -> tuple[np.random.Generator, int]:
        kept = self._random[lane]
        if kept is None:
            kept = self._random[lane] = seeding.np_random()
        return kept

    def _wanted(self, actions: Any) -> NDArray[np.float64]:
        """(L, 3) motions that the actions ask for; nothing is asked of lanes that start again."""
        discrete = self.settings.actions == "discrete"
        shape = (self.num_envs,) if discrete else (self.num_envs, 3)
        try:
            chosen = np.asarray(actions)
        except ValueError:  # lists of unequal lengths
            chosen = np.zeros(0, object)
        if chosen.shape != shape or chosen.dtype.kind not in "iuf":
            got = f"actions of shape {chosen.shape} and type {chosen.dtype}"
            raise GalocError(got, f"numbers of shape {shape}", "Draw actions from envs.action_space.")
        if not discrete:
            chosen = chosen.astype(np.float64)  # -128 of int8 is its own absolute value
        if self._ended.any():
            chosen = chosen.copy()
            chosen[self._ended] = 0
        return motion.commanded_motions(chosen, self.settings.actions)

    def _start(
        self, lanes: Iterable[int], seeds: list[int | None] | None = None, options: list[dict[str, Any]] | None = None
    ) -> None:
        """Begin episodes in some lanes: enter the world, place the body, clear the belief."""
        moved_house = False
        for lane in lanes:
            seed = None if seeds is None else seeds[lane]
            asked: dict[str, Any] = {} if options is None else options[lane]
            if seed is not None:
                self._random[lane] = seeding.np_random(seed)
            rng, last = self._random_of(lane)[0], self._lanes[lane]
            here = None if last is None else last.world
            number = self._worlds.number(seed, asked.get("plan_seed"), here, rng)
            if last is not None and last.world.number == number:
                world, observer = last.world, last.observer
            else:
                self._lanes[lane], last, here = None, None, None
                world = self._worlds.enter(number, [episode.world for episode in self._lanes if episode is not None])
                self._pictures.keep(self._worlds)
                observer = world.make_observer(self.settings, self.camera)
                moved_house = True
            self._lanes[lane] = Episode.start(
                world, observer, self.settings, self.camera, self._bodies, lane, rng, asked.get("pose")
            )
        if moved_house:
            self._settle()

    def _settle(self) -> None:
        """After a move: the obstacles of each body, and no painters of homes that are gone."""
        worlds: list[World | None] = [None if episode is None else episode.world for episode in self._lanes]
        self._bodies.surround([None if world is None else world.obstacles for world in worlds])
        self._painters = {n: painter for n, painter in self._painters.items() if self._worlds.has(n)}

    def _observe(self, lanes: NDArray[np.int64]) -> None:
        """Write the observations of some lanes: draw them all, then localize one by one."""
        out, bodies = self._out, self._bodies
        self._pictures.draw([self._episode(lane) for lane in lanes], bodies, out["image"])
        out["gravity"][lanes], out["odometry"][lanes] = bodies.reading[lanes, :2], bodies.reading[lanes, 2:]
        if not self._localizes and self.render_mode is None:
            return
        with one_thread():
            for lane in lanes:
                episode = self._episode(lane)
                episode.image = out["image"][lane]
                episode.trail.append(bodies.pose[lane].copy())
                if episode.observer is not None:
                    for key, value in episode.localize().items():
                        out[key][lane] = value

    def _restart(self, lanes: NDArray[np.int64]) -> dict[str, Any]:
        """Hand out the last words of lanes that have ended and start them again at once."""
        infos: dict[str, Any] = {}
        for lane in lanes:
            last = {key: value[lane].copy() for key, value in self._out.items()}
            infos = self._add_info(infos, {"final_obs": last, "final_info": self._info(lane)}, lane)
        if len(lanes):
            self._start(lanes)
            self._observe(lanes)
        return infos

    def _observations(self) -> Observation:
        out: Observation = self._out
        return {key: value.copy() for key, value in out.items()} if self._copy else out

    def _info(self, lane: int) -> dict[str, Any]:
        """What the single environment says."""
        bodies = self._bodies
        here = {"pose": bodies.pose[lane].copy(), "collided": bodies.has_collided(lane)}
        return {**here, **self._episode(lane).verdict()}

    def _infos(self, lanes: NDArray[np.int64], infos: dict[str, Any] | None = None) -> dict[str, Any]:
        infos = {} if infos is None else infos
        for lane in lanes:
            infos = self._add_info(infos, self._info(lane), lane)
        return infos

    def _motion_infos(self, infos: dict[str, Any]) -> dict[str, Any]:
        """The infos of all lanes without a localizer, straight from the arrays."""
        everyone = np.ones(self.num_envs, np.bool_)
        infos["pose"], infos["_pose"] = self._bodies.pose.copy(), everyone
        infos["collided"], infos["_collided"] = self._bodies.collided, everyone.copy()
        return infos
