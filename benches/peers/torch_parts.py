"""What the works in PyTorch share."""

import torch
from torch import nn
from torch.nn import functional as F


class Mlp(nn.Module):
    """Affine layers with ReLU between them."""

    def __init__(self, *widths):
        super().__init__()
        self.layers = nn.ModuleList(nn.Linear(i, o) for i, o in zip(widths, widths[1:]))

    def forward(self, x):
        for layer in self.layers[:-1]:
            x = F.relu(layer(x))
        return self.layers[-1](x)


def adam(groups, **settings):
    return torch.optim.Adam(groups, betas=(0.9, 0.999), eps=1e-8, fused=True, **settings)


def maker(variant):
    """Compiles functions in the variant `compile`, and leaves them alone otherwise."""
    if variant != "compile":
        return lambda function: function
    from torch_compiled import compiled  # slow to import

    return compiled
