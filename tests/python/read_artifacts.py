"""Reads stored artifacts with public packages alone and recomputes what their networks put out.

Usage: read_artifacts.py FOLDER, which holds transitions/, model/ and agent/ as the store lays them out.
Prints JSON: codes of the first pictures, and the mean actions there towards the first goal image.
"""

import json
import pathlib
import sys

import numpy as np
from safetensors.numpy import load_file


def network(tensors, name, x):
    """Layers name.0, name.1, ...: y = x @ weight + bias, with ReLU between them."""
    layers = sum(f"{name}.{i}.weight" in tensors for i in range(10))
    for i in range(layers):
        x = x @ tensors[f"{name}.{i}.weight"] + tensors[f"{name}.{i}.bias"]
        if i + 1 < layers:
            x = np.maximum(x, 0.0)
    return x


def doubles(tensors):
    return {name: t.astype(np.float64) if t.dtype == np.float32 else t for name, t in tensors.items()}


def main(folder):
    transitions = load_file(folder / "transitions" / "transitions.safetensors")
    model = doubles(load_file(folder / "model" / "model.safetensors"))
    sizes = json.loads((folder / "model" / "model.json").read_text())["sizes"]
    agent = doubles(load_file(folder / "agent" / "agent.safetensors"))

    count, height, width = transitions["observations"].shape
    assert transitions["actions"].shape == (count, sizes["action"])
    assert transitions["goal_index"].shape == (count,)
    assert height * width == sizes["pixels"] == model["background"].size
    first = np.arange(min(count, 4))

    def encode(pictures):
        return network(model, "encoder", pictures.reshape(len(pictures), -1) / 255.0)

    codes = encode(transitions["observations"][first])
    latent = sizes["latent"]
    goal = encode(transitions["goals"][:1])[:, :latent]

    def whiten(z):
        return (z - agent["whitening/mean"]) * agent["whitening/inverse"]

    inputs = np.concatenate([whiten(codes[:, :latent]), np.repeat(whiten(goal), len(first), axis=0)], axis=1)
    acting = {name.removeprefix("acting/"): t for name, t in agent.items() if name.startswith("acting/")}
    actions = np.tanh(network(acting, "actor", inputs)[:, : sizes["action"]])
    print(json.dumps({"codes": codes.ravel().tolist(), "actions": actions.ravel().tolist()}))


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]))
