#!/usr/bin/env python3
"""Times a run in which nothing has changed: carl-pipe beside DVC and Snakemake, on the same layered graphs.

    cargo build --release
    python3 -m venv peer-venv && peer-venv/bin/pip install dvc snakemake
    PATH=$PWD/peer-venv/bin:$PATH python3 benches/peers/noop.py --sizes 6,200,1000,10000

A graph of N nodes has N/10 groups; in each, nine nodes make a file and a tenth reads all nine (6 nodes: one group of
five and one). The peers run `echo` and `cat`, carl-pipe a short evaluation and a summary. The first run is not timed. A
tool whose first run takes longer than --limit is left out at this size. Every no-op runs --repeats times in turns, and
the table shows the medians in milliseconds and the ratios to carl-pipe.
"""

import argparse
import pathlib
import shutil
import statistics
import subprocess
import tempfile
import time


def shape(size: int) -> tuple[int, int]:
    """Groups, and nodes in the first layer of a group."""
    return (1, size - 1) if size < 10 else (size // 10, 9)


def carl(folder: pathlib.Path, groups: int, width: int) -> None:
    (folder / "layered.toml").write_text(f"""schema = 1
name = "layered"
description = "Short evaluations and their summary, for every seed"

[matrix]
seed = {list(range(groups))}

[task]
env = "planar"

[loop]
rounds = {width}

[stages.evaluate]
kind = "evaluate"
controller = "oracle"
episodes = 1
loop = true

[stages.summary]
kind = "summarize"
inputs = {{ evaluations = ["evaluate@all"] }}
""")


def dvc(folder: pathlib.Path, groups: int, width: int) -> None:
    lines = ["stages:"]
    for group in range(groups):
        parts = [f"{group}_{part}.txt" for part in range(width)]
        for part, name in enumerate(parts):
            lines += [f"  a{group}_{part}:", f"    cmd: echo {name} > {name}", f"    outs: [{name}]"]
        deps = ", ".join(parts)
        lines += [f"  b{group}:", f"    cmd: cat {' '.join(parts)} > {group}.txt", f"    deps: [{deps}]"]
        lines += [f"    outs: [{group}.txt]"]
    (folder / "dvc.yaml").write_text("\n".join(lines) + "\n")
    subprocess.run(["git", "init", "-q"], cwd=folder, check=True)
    subprocess.run(["dvc", "init", "-q"], cwd=folder, check=True)


def snakemake(folder: pathlib.Path, groups: int, width: int) -> None:
    (folder / "Snakefile").write_text(f"""
rule all:
    input: expand("{{g}}.txt", g=range({groups}))
rule a:
    output: "{{g}}_{{p}}.txt"
    shell: "echo {{wildcards.g}}_{{wildcards.p}} > {{output}}"
rule b:
    input: expand("{{{{g}}}}_{{p}}.txt", p=range({width}))
    output: "{{g}}.txt"
    shell: "cat {{input}} > {{output}}"
ruleorder: a > b
wildcard_constraints: g="[0-9]+", p="[0-9]+"
""")


def timed(command: list[str], folder: pathlib.Path, limit: float) -> float | None:
    """Seconds; None where the command fails or takes too long."""
    start = time.perf_counter()
    try:
        ended = subprocess.run(command, cwd=folder, timeout=limit, capture_output=True)
    except subprocess.TimeoutExpired:
        return None
    if ended.returncode != 0:
        print(ended.stderr.decode()[-2000:])
        return None
    return time.perf_counter() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", default="6,200,1000")
    parser.add_argument("--carl", default="target/release/carl-pipe")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--limit", type=float, default=600, help="seconds for a first run")
    args = parser.parse_args()
    program = str(pathlib.Path(args.carl).resolve())
    tools = {
        "carl-pipe": (carl, [program, "run", "layered.toml", "--progress", "none"]),
        "dvc": (dvc, ["dvc", "repro", "-q"]),
        "snakemake": (snakemake, ["snakemake", "--cores", "2", "--quiet", "all"]),
    }
    tools = {name: tool for name, tool in tools.items() if shutil.which(tool[1][0])}
    print("| nodes | " + " | ".join(f"{name}, ms" for name in tools) + " | ratios |")
    print("|---|" + "---|" * (len(tools) + 1))
    for size in map(int, args.sizes.split(",")):
        with tempfile.TemporaryDirectory() as root:
            ready = {}
            for name, (make, command) in tools.items():
                folder = pathlib.Path(root) / name
                folder.mkdir()
                make(folder, *shape(size))
                if timed(command, folder, args.limit) is not None:
                    ready[name] = (command, folder)
            times: dict[str, list[float]] = {name: [] for name in ready}
            for _ in range(args.repeats):
                for name, (command, folder) in ready.items():
                    seconds = timed(command, folder, args.limit)
                    times[name].append(float("nan") if seconds is None else 1e3 * seconds)
            medians = {name: statistics.median(own) for name, own in times.items()}
            cells = [f"{medians[name]:.1f}" if name in medians else "left out" for name in tools]
            ratios = [f"{name} {medians[name] / medians['carl-pipe']:.0f}x" for name in medians if name != "carl-pipe"]
            print(f"| {size} | " + " | ".join(cells) + " | " + ", ".join(ratios) + " |", flush=True)


if __name__ == "__main__":
    main()
