"""Pendulum-v1 of Gymnasium as a task: it starts hanging, and the pole is to stand."""

import carl_env
import gymnasium
import numpy


class Hanging(gymnasium.Wrapper):
    def reset(self, *, seed=None, options=None):
        observation, info = self.env.reset(seed=seed)
        self.unwrapped.state = numpy.array([numpy.pi + self.unwrapped.np_random.uniform(-0.1, 0.1), 0.0])
        return observation, info

    def render(self):
        self.unwrapped.last_u = None  # Otherwise an arrow shows the last torque.
        return self.env.render()


def goal(env):
    env.unwrapped.state = numpy.zeros(2)
    return env.render()


def angle(env):
    return (env.state[0] + numpy.pi) % (2 * numpy.pi) - numpy.pi


carl_env.serve(
    lambda **options: Hanging(gymnasium.make("Pendulum-v1", render_mode="rgb_array", **options)),
    size=(48, 48),
    crop=(90, 410, 90, 410),
    invert=True,
    frames=2,
    goal=goal,
    is_at_goal=lambda env: abs(angle(env)) <= numpy.pi / 6,
    state=lambda env: [angle(env), env.state[1]],
)
