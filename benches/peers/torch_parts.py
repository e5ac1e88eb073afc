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


def compiled(function):
    """`torch.compile`, but what the forward pass keeps for the backward pass is what eager keeps.

    The compiler would rather keep ReLU's masks as bytes, and with GCC 12 takes 8 ns for each of them.
    """
    from torch._functorch.partitioners import default_partition
    from torch._inductor.custom_graph_pass import CustomPartitionerFn

    class AsEager(CustomPartitionerFn):
        def __call__(self, gm, joint_inputs, **settings):
            known = ("num_fwd_outputs", "static_lifetime_input_indices", "static_lifetime_input_nodes")
            return default_partition(gm, joint_inputs, **{name: settings[name] for name in known if name in settings})

        def uuid(self):
            return "as eager, 1"

    torch._inductor.config.custom_partitioner_fn = AsEager()
    return torch.compile(function, dynamic=False)
