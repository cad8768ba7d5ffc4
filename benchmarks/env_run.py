"""What the environment benchmark lets step, one contestant per process.

The job says which contestant it is; a case is (width, height, lanes). A lap is a few steps of all lanes with random
actions; episodes end and start again on the way.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from render_serve import Case, serve

LAP_STEPS = 64
"""Steps of a lap, all lanes together, at least one of each lane."""
_processes: list[int] = []


def build(job: dict[str, Any], case: Any) -> Case:
    """The case of a contestant."""
    width, height, lanes = case
    if job["kind"] == "miniworld":
        return _single(_maze(width, height), lambda env: env.reset(seed=0))
    import gymnasium

    import galoc_env.registration

    name = galoc_env.registration.ENV_ID
    galoc_env.registration.register()
    arguments = {**job["arguments"], "width": width, "height": height}
    # One home for all: what a step costs does not depend on how many homes there are, but the time to build them does.
    start = {"seed": 0, "options": {"plan_seed": job["home"]}}
    if job["kind"] == "single":
        env = gymnasium.make(name, disable_env_checker=True, **arguments)
        return _single(env, lambda env: env.reset(**start))
    if job["kind"] == "batch":
        from galoc_env.vector import FloorplanVectorEnv

        return _batch(FloorplanVectorEnv(lanes, **arguments), start)
    more = {"context": "spawn"} if job["kind"] == "async" else {}
    envs = gymnasium.make_vec(name, lanes, vectorization_mode=job["kind"], vector_kwargs=more, **arguments)
    if job["kind"] == "async":
        _processes.extend(process.pid for process in envs.processes)
    return _batch(envs, start)


def _single(env: Any, reset: Callable[[Any], Any]) -> Case:
    reset(env)
    env.action_space.seed(0)

    def lap() -> None:
        for _ in range(LAP_STEPS):
            _, _, terminated, truncated, _ = env.step(env.action_space.sample())
            if terminated or truncated:
                env.reset()

    return LAP_STEPS, lap, None


def _batch(envs: Any, start: dict[str, Any]) -> Case:
    envs.reset(**start)
    envs.action_space.seed(0)
    steps = max(1, LAP_STEPS // envs.num_envs)

    def lap() -> None:
        for _ in range(steps):
            envs.step(envs.action_space.sample())

    return steps * envs.num_envs, lap, None


def _maze(width: int, height: int) -> Any:
    """Farama's MiniWorld."""
    import pyglet

    pyglet.options["headless"] = True
    import gymnasium
    import miniworld  # noqa: F401  # registers its environments

    name = "MiniWorld-Maze-v0"
    return gymnasium.make(name, disable_env_checker=True, obs_width=width, obs_height=height)


if __name__ == "__main__":
    serve(build, lambda: _processes)
