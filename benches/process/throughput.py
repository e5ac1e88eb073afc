"""Steps a second of 8 environments of Pendulum-v1 at 64 x 64: in one process, across carl-pipe's protocol, and in Gymnasium's
AsyncVectorEnv. Needs `pip install ./python pygame`.

    python benches/process/throughput.py
"""

import json
import statistics
import struct
import subprocess
import sys
import time

import carl_env
import gymnasium
import numpy

ENVS, STEPS, REPEATS = 8, 100, 5
SETTINGS = {"size": 64, "frames": 1, "goal": lambda env: env.render()}


def make():
    return gymnasium.make("Pendulum-v1", render_mode="rgb_array")


def in_one_process():
    served = carl_env.Gymnasium(make, SETTINGS, {})
    for number in range(ENVS):
        served.reset(number, number, 0)
    return lambda: [served.step(number, (0.5,)) for number in range(ENVS)]


def across_the_protocol():
    program = subprocess.Popen([sys.executable, __file__, "serve"], stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def ask(kind, body):
        carl_env.write_frame(program.stdin, kind, body)
        return carl_env.read_frame(program.stdout)

    ask(carl_env.HELLO, json.dumps({"protocol": carl_env.PROTOCOL, "options": {}}).encode())
    count = struct.pack("<I", ENVS)
    ask(carl_env.RESET, count + b"".join(struct.pack("<IQI", number, number, 0) for number in range(ENVS)))
    steps = count + b"".join(struct.pack("<Id", number, 0.5) for number in range(ENVS))
    return lambda: ask(carl_env.STEP, steps)


class Pictures(gymnasium.Wrapper):
    """Observations are the pictures that carl-pipe gets."""

    def __init__(self, env):
        super().__init__(env)
        self.served = carl_env.Gymnasium(make, SETTINGS, {})
        self.observation_space = gymnasium.spaces.Box(0, 255, (64, 64), numpy.uint8)

    def reset(self, **options):
        _, info = self.env.reset(**options)
        return self.served.processed(self.env.render()), info

    def step(self, action):
        _, reward, terminated, truncated, info = self.env.step(action)
        return self.served.processed(self.env.render()), reward, terminated, truncated, info


def in_a_vector():
    vector = gymnasium.vector.AsyncVectorEnv([lambda: Pictures(make())] * ENVS)
    vector.reset(seed=0)
    actions = numpy.full((ENVS, 1), 0.5, dtype=numpy.float32)
    return lambda: vector.step(actions)


def main():
    ways = {"one process": in_one_process(), "protocol": across_the_protocol(), "AsyncVectorEnv": in_a_vector()}
    taken = {name: [] for name in ways}
    for _ in range(REPEATS):
        for name, step in ways.items():
            start = time.perf_counter()
            for _ in range(STEPS):
                step()
            taken[name].append(time.perf_counter() - start)
    for name, times in taken.items():
        print(f"{name:15} {ENVS * STEPS / statistics.median(times):7.0f} steps/s")
    overhead = statistics.median(taken["protocol"]) / statistics.median(taken["one process"]) - 1
    print(f"overhead of the protocol: {100 * overhead:.1f} %")


if __name__ == "__main__":
    if sys.argv[1:] == ["serve"]:
        carl_env.serve(make, **SETTINGS)
    else:
        main()
