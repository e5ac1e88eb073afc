"""One action in PyTorch: encoder and policy on one observation of planar, the goal's code known."""

import torch
from torch import nn

import torch_data
from torch_data import TASKS
from torch_parts import Mlp

TASK = TASKS["planar"]


class Policy(nn.Module):
    """Observation -> mean action."""

    def __init__(self):
        super().__init__()
        self.encoder = Mlp(TASK.pixels, *TASK.encoder, 2 * TASK.latent)
        self.actor = Mlp(2 * TASK.latent, 256, 256, 2 * TASK.action)
        self.requires_grad_(False)
        self.register_buffer("mean", torch.rand(TASK.latent))
        self.register_buffer("inverse", torch.rand(TASK.latent) + 0.5)
        self.register_buffer("white_goal", torch.randn(1, TASK.latent))

    def forward(self, x):
        z = self.encoder(x)[:, : TASK.latent]
        state = torch.cat([(z - self.mean) * self.inverse, self.white_goal], 1)
        return torch.tanh(self.actor(state)[:, : TASK.action])


class Act:
    """Acts on one observation after the other."""

    def __init__(self, _work, variant, _arguments):
        self.observations = [row for now, _, _ in torch_data.batches(TASK, 2048, 128) for row in now.split(1)]
        self.policy, self.steps = Policy().eval(), 0
        if variant == "compile":
            torch._inductor.config.freezing = True
            self.policy = torch.compile(self.policy, dynamic=False)
        elif variant == "script":
            traced = torch.jit.trace(self.policy, self.observations[0])
            self.policy = torch.jit.optimize_for_inference(torch.jit.freeze(traced))

    def step(self):
        self.steps += 1
        with torch.inference_mode():
            return self.policy(self.observations[self.steps % len(self.observations)])[0].tolist()
