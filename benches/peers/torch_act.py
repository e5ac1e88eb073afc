"""One action in PyTorch: encoder and policy on one observation of planar, the goal's code known.

Vectors rather than batches of one: products of a matrix and a vector, activations in place.
"""

import sys
import warnings

import torch
from torch import nn

import torch_data
from torch_data import TASKS
from torch_parts import Mlp

TASK = TASKS["planar"]


def means(mlp, x, count):
    """The first `count` outputs of an MLP for one input."""
    *hidden, last = mlp.layers
    for layer in hidden:
        x = torch.addmv(layer.bias, layer.weight, x).relu_()
    return torch.addmv(last.bias[:count], last.weight[:count], x)


class Policy(nn.Module):
    """Observation -> mean action."""

    def __init__(self):
        super().__init__()
        self.encoder = Mlp(TASK.pixels, *TASK.encoder, 2 * TASK.latent)
        self.actor = Mlp(2 * TASK.latent, 256, 256, 2 * TASK.action)
        self.requires_grad_(False)
        self.register_buffer("mean", torch.rand(TASK.latent))
        self.register_buffer("inverse", torch.rand(TASK.latent) + 0.5)
        self.register_buffer("white_goal", torch.randn(TASK.latent))

    def forward(self, x):
        z = means(self.encoder, x, TASK.latent)
        state = torch.cat([(z - self.mean) * self.inverse, self.white_goal])
        return means(self.actor, state, TASK.action).tanh_()


class Act:
    """Acts on one observation after the other."""

    def __init__(self, _work, variant, _arguments):
        self.observations = [row for now, _, _ in torch_data.batches(TASK, 2048, 128) for row in now.unbind()]
        self.policy, self.steps = Policy().eval(), 0
        if variant == "script":
            warnings.simplefilter("ignore", FutureWarning)  # its successor takes longer
            with torch.inference_mode():
                self.policy = torch.jit.freeze(torch.jit.trace(self.policy, self.observations[0]))
        elif variant != "default":
            sys.exit("torch_peer.py: act comes as default and script")

    def step(self):
        self.steps += 1
        with torch.inference_mode():
            return self.policy(self.observations[self.steps % len(self.observations)]).tolist()
