"""InvertedPendulum of Gymnasium as a task: MuJoCo balances a pole on a cart, seen in its own rendering of 64 x 64 pixels."""

import os

os.environ.setdefault("MUJOCO_GL", "egl")

import carl_env
import gymnasium
import numpy


def goal(env):
    env.unwrapped.set_state(numpy.zeros(2), numpy.zeros(2))
    return env.render()


carl_env.serve(
    lambda **options: gymnasium.make("InvertedPendulum-v5", render_mode="rgb_array", width=64, height=64, **options),
    frames=2,
    go_on=True,
    goal=goal,
    # Gymnasium ends an episode where the pole leans further.
    is_at_goal=lambda env: abs(env.data.qpos[1]) <= 0.2,
    state=lambda env: [*env.data.qpos, *env.data.qvel],
)
