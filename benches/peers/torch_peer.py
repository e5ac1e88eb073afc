#!/usr/bin/env python3
"""Our training steps written in PyTorch, for `compare`: the same networks, losses and updates in f32.

    torch_peer.py serve --work planar --threads 1 [--variant compile]
    torch_peer.py check --work planar [--steps 200]

`serve` prints one JSON line when it is ready, answers every line `run N` on standard input with one JSON line
{"ms": [milliseconds of each of N steps]}, and ends at `quit`. `check` trains for a while and fails unless losses stay
finite and fall. Works: planar, swing_up, cart_pole, three_pole (a CARL training step), sac (a SAC update), act (an
action for one observation). What each of them holds is said in README.md.
"""

import argparse
import json
import math
import sys
import time
import warnings

warnings.filterwarnings("ignore", message="Failed to initialize NumPy")
try:
    import torch
except ImportError:
    sys.exit("torch_peer.py: torch is not installed for this Python (pip install torch)")

from torch_act import Act
from torch_carl import CarlStep
from torch_data import TASKS
from torch_sac import SacStep

WORKS = {**dict.fromkeys(TASKS, CarlStep), "sac": SacStep, "act": Act}


def open_work(arguments):
    torch.set_num_threads(arguments.threads)
    torch.set_num_interop_threads(1)
    torch.set_flush_denormal(True)
    torch.manual_seed(0)
    return WORKS[arguments.work](arguments.work, arguments.variant, arguments)


def serve(arguments):
    work = open_work(arguments)
    for _ in range(3):
        work.step()
    ready = {"ready": True, "peer": "torch", "version": torch.__version__, "variant": arguments.variant}
    print(json.dumps(ready), flush=True)
    for line in sys.stdin:
        match line.split():
            case ["run", count]:
                ms = []
                for _ in range(int(count)):
                    start = time.perf_counter()
                    work.step()
                    ms.append(1000 * (time.perf_counter() - start))
                print(json.dumps({"ms": ms}), flush=True)
            case ["quit"]:
                return
            case _:
                sys.exit(f"torch_peer.py: unknown request `{line.strip()}`")


def check(arguments):
    work = open_work(arguments)
    if isinstance(work, Act):
        sys.exit(0 if all(abs(u) <= 1 for _ in range(arguments.steps) for u in work.step()) else 1)
    losses = [float(work.step()) for _ in range(arguments.steps)]
    tenth = max(1, len(losses) // 10)
    first, last = (sum(part) / tenth for part in (losses[:tenth], losses[-tenth:]))
    finite = all(map(math.isfinite, losses))
    print(json.dumps({"work": arguments.work, "finite": finite, "first": first, "last": last}))
    sys.exit(0 if finite and last < first else 1)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("verb", choices=["serve", "check"])
    parser.add_argument("--work", required=True, choices=[*TASKS, "sac", "act"])
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--variant", default="default", choices=["default", "channels-last", "compile", "script"])
    parser.add_argument("--steps", type=int, default=200, help="of `check`")
    parser.add_argument("--bootstrap", action="store_true", help="of `sac`: targets end with a critic's value")
    arguments = parser.parse_args()
    {"serve": serve, "check": check}[arguments.verb](arguments)


if __name__ == "__main__":
    main()
