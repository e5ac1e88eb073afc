"""A training step with CARL's loss in PyTorch: networks, the loss of `lce::objective`, its gradient, Adam."""

import math
import sys

import torch
from torch import nn
from torch.nn import functional as F

import torch_data
from torch_data import TASKS
from torch_parts import Mlp, adam, maker

BATCH = 128
SAMPLES = 2048
CURVATURE_SIGMA = 0.1
HALF_LN_TAU = 0.5 * math.log(2 * math.pi)


class ConvEncoder(nn.Module):
    """Two stacked 80x80 pictures -> Gaussian over z."""

    def __init__(self, hidden, latent):
        super().__init__()
        widths, strides = (2, 32, 32, 32, 10), (1, 2, 2, 2)
        self.convs = nn.ModuleList(
            nn.Conv2d(i, o, 5, stride=s, padding=2) for i, o, s in zip(widths, widths[1:], strides)
        )
        self.head = Mlp(1000, hidden, 2 * latent)

    def forward(self, x):
        for conv in self.convs:
            x = F.relu(conv(x))
        return self.head(x.flatten(1))


class ConvDecoder(nn.Module):
    """z -> Bernoulli logits of two 80x80 pictures. ReLU comes before the upsampling: the same values on fewer pixels."""

    def __init__(self, latent, channels_last):
        super().__init__()
        self.head = Mlp(latent, 200, 1000)
        # At stride 1 a transposed convolution is a convolution with its kernel turned around, and oneDNN is faster at it;
        # with two channels out it is the other way round.
        self.convs = nn.ModuleList(nn.Conv2d(i, 32, 5, padding=2) for i in (10, 32, 32))
        self.convs.append(nn.ConvTranspose2d(32, 2, 5, padding=2))
        self.format = torch.channels_last if channels_last else torch.contiguous_format

    def forward(self, z):
        x = F.relu(self.head(z)).unflatten(1, (10, 10, 10)).contiguous(memory_format=self.format)
        for conv in self.convs[:-1]:
            x = F.interpolate(F.relu(conv(x)), scale_factor=2, mode="nearest")
        return self.convs[-1](x)


class Backward(nn.Module):
    """B(z', u, x) -> Gaussian over z."""

    def __init__(self, latent, action, pixels, widths):
        super().__init__()
        n_z, n_u, n_x, n_joint = widths
        self.z, self.u, self.x = nn.Linear(latent, n_z), nn.Linear(action, n_u), nn.Linear(pixels, n_x)
        self.joint, self.head = nn.Linear(n_z + n_u + n_x, n_joint), nn.Linear(n_joint, 2 * latent)

    def forward(self, z, u, x):
        return self.head(F.relu(self.joint(torch.cat([self.z(z), self.u(u), self.x(x)], 1))))


class Dynamics(Mlp):
    """F: (z, u) -> Gaussian over z', its means relative to z."""

    def forward(self, z_u, way, latent):
        """Heads for all rows, and for the third block the means' directional derivative along `way`."""
        first, second, last = self.layers
        h_1 = F.relu(first(z_u))
        h_2 = F.relu(second(h_1))
        block = slice(2 * BATCH, 3 * BATCH)
        tangent = F.linear(way, first.weight) * (h_1[block] > 0)
        tangent = F.linear(tangent, second.weight) * (h_2[block] > 0)
        return last(h_2), F.linear(tangent, last.weight[:latent])


class Bernoulli(torch.autograd.Function):
    """-ln of the probability of every picture under its logits. One pass back: sigmoid(logits) - x."""

    @staticmethod
    def forward(ctx, logits, pictures):
        ctx.save_for_backward(logits, pictures)
        rows = F.softplus(logits).sum(1)
        return rows.sub_(torch.linalg.vecdot(logits, pictures))

    @staticmethod
    def backward(ctx, d_rows):
        logits, pictures = ctx.saved_tensors
        return torch.sigmoid(logits).sub_(pictures).mul_(d_rows[:, None]), None


def bernoulli_compiled(logits, pictures):
    """The same for the compiler, which fuses it."""
    return (F.softplus(logits) - logits * pictures).sum(1)


def kl(mu_q, log_q, mu_p, log_p):
    inverse = (-2 * log_p).exp()
    return (log_p - log_q + 0.5 * ((2 * log_q).exp() + (mu_q - mu_p).square()) * inverse - 0.5).sum(1)


def log_density(z, mu, log_sigma):
    return -(0.5 * ((z - mu) * (-log_sigma).exp()).square() + log_sigma + HALF_LN_TAU).sum(1)


class Carl(nn.Module):
    """The networks of a task and CARL's loss of a batch."""

    def __init__(self, task, channels_last, bernoulli):
        super().__init__()
        n, a = task.latent, task.action
        self.task, self.channels_last, self.bernoulli = task, channels_last, bernoulli
        if task.convolutional:
            self.encoder, self.decoder = ConvEncoder(task.encoder, n), ConvDecoder(n, channels_last)
            if channels_last:
                self.to(memory_format=torch.channels_last)
        else:
            self.encoder = Mlp(task.pixels, *task.encoder, 2 * n)
            self.decoder = Mlp(n, *task.encoder, task.pixels)
        self.dynamics = Dynamics(n + a, *task.dynamics, 2 * n)
        self.backward_dynamics = Backward(n, a, task.pixels, task.backward)
        p, c = task.prediction, task.consistency
        self.consistency = p + c
        weights = torch.tensor([p, 0.01, 0.3]) / BATCH
        self.register_buffer("picture_weights", weights.repeat_interleave(BATCH))

    def rows(self, pictures):
        """Pictures as rows in the order that they lie in memory."""
        return pictures.permute(0, 2, 3, 1).flatten(1) if self.channels_last else pictures.flatten(1)

    def forward(self, pictures, u, noise):
        """The loss; `pictures` holds x', x, x' one after the other."""
        n, a = self.task.latent, self.task.action
        for_z_1, for_z_q, for_z_e, way = noise.split([n, n, n, n + a], 1)
        rows = self.rows(pictures)
        mu, log_sigma = self.encoder(pictures[: 2 * BATCH]).chunk(2, 1)
        (mu_next, mu_now), (log_next, log_now) = mu.chunk(2), log_sigma.chunk(2)
        z_1 = mu_next + log_next.exp() * for_z_1
        z_e = mu_now + log_now.exp() * for_z_e
        mu_q, log_q = self.backward_dynamics(z_1, u, rows[BATCH : 2 * BATCH]).chunk(2, 1)
        z_q = mu_q + log_q.exp() * for_z_q

        way = CURVATURE_SIGMA * way
        at = torch.cat([z_e.detach(), u], 1)
        z_u = torch.cat([torch.cat([z_q, u], 1), torch.cat([mu_now, u], 1), at, at + way])
        heads, tangent = self.dynamics(z_u, way, n)
        relative, log_f = heads.split(n, 1)
        r_q, r_mean, r_at, r_near = relative.chunk(4)
        curvature = (r_near - r_at - tangent).square().sum()

        logits = self.rows(self.decoder(torch.cat([z_1, z_e, mu_now + r_mean])))
        decoded = (self.bernoulli(logits, rows) * self.picture_weights).sum()
        entropy = log_next.sum() + BATCH * n * (HALF_LN_TAU + 0.5)
        consistency = (kl(mu_q, log_q, mu_now, log_now) - log_density(z_1, z_q + r_q, log_f[:BATCH])).sum() - entropy
        return decoded + (self.consistency * consistency + curvature) / BATCH


class CarlStep:
    """A training step: noise, loss, gradient, Adam with L2. Batches lie ready in memory."""

    def __init__(self, work, variant, _arguments):
        task = TASKS[work]
        if variant == "channels-last" and not task.convolutional:
            sys.exit("torch_peer.py: channels-last is for the convolutional networks of cart_pole and three_pole")
        # The compiler does best with channels last, too.
        is_compiled, channels_last = variant == "compile", variant != "default" and task.convolutional
        self.model = Carl(task, channels_last, bernoulli_compiled if is_compiled else Bernoulli.apply)
        self.loss = maker(variant)(self.model)
        self.optimizer = adam(self.model.parameters(), lr=5e-4, weight_decay=1e-3)
        self.batches = [self.lay(*batch) for batch in torch_data.batches(task, SAMPLES, BATCH)]
        self.steps = 0

    def lay(self, now, actions, after):
        pictures = torch.cat([after, now, after])
        if self.model.channels_last:
            pictures = pictures.contiguous(memory_format=torch.channels_last)
        return pictures, actions

    def step(self):
        pictures, u = self.batches[self.steps % len(self.batches)]
        self.steps += 1
        noise = torch.randn(BATCH, 4 * self.model.task.latent + self.model.task.action)
        loss = self.loss(pictures, u, noise)
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        self.optimizer.step()
        return loss.detach()
