"""A lamp in a corridor that is to be pushed to the right end, and faults that options ask for. It needs no package."""

import os
import random
import sys
import time

import carl_env

HEIGHT, WIDTH = 4, 12


class Lamps:
    def __init__(self, options):
        self.fault, self.lamps, self.steps = options.get("fault"), {}, 0
        print("a line on standard output", flush=True)
        with open("pids", "a") as pids:
            pids.write(f"{os.getpid()}\n")
        if self.fault == "protocol":
            carl_env.PROTOCOL = 2
        if self.fault == "describe":
            raise OSError("no lamp")
        self.about = {
            "height": HEIGHT,
            "width": WIDTH,
            "channels": 1,
            "shades": True,
            "frames": 2,
            "action_low": [-2.0],
            "action_high": [2.0],
            "horizon": 10,
            "goals": 1,
            "states": 1,
        }
        self.goal_pictures = [picture(WIDTH - 1)]

    def reset(self, number, seed, goal):
        self.lamps[number] = random.Random(seed).uniform(2, 8)
        return self.seen(number)

    def step(self, number, action):
        self.steps += 1
        if self.fault == "start" or (self.fault and self.steps == 3):
            getattr(self, self.fault, lambda: None)()
        self.lamps[number] = min(max(self.lamps[number] + action[0], 0.0), WIDTH - 1.0)
        seen = self.seen(number)
        wrong = {"shape": (seen[0], seen[1], seen[2][1:]), "nan": (seen[0], [float("nan")], seen[2])}
        return wrong.get(self.fault if self.steps == 3 else None, seen)

    def seen(self, number):
        lamp = self.lamps[number]
        return lamp > WIDTH - 2, [lamp], picture(lamp)

    def die(self):
        print("the lamp burns out", file=sys.stderr, flush=True)
        os._exit(3)

    def hang(self):
        time.sleep(1000)

    def fail(self):
        raise ValueError("the lamp is broken")

    def garbage(self):
        carl_env.write_frame = lambda target, kind, body: (target.write(b"\xff" * 64), target.flush())


def picture(lamp):
    """The nearer a column is to the lamp, the lighter it is: shades of grey."""
    row = [max(0, round(255 - 120 * abs(column - lamp))) for column in range(WIDTH)]
    return bytes(row * HEIGHT)


carl_env.speak(Lamps)
