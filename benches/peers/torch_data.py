"""The tasks' sizes, and transitions to train on: pictures like the tasks', of motions roughly like theirs.

A step takes the same time whatever is in the pictures; these make sure that losses have something to fall to.
"""

import math
from dataclasses import dataclass

import torch


@dataclass(frozen=True)
class Task:
    """Widths of the networks and weights of the loss (the paper's appendix)."""

    latent: int
    action: int
    pixels: int
    convolutional: bool
    encoder: tuple | int  # hidden layers of encoder and decoder; the convolutional encoder's hidden layer
    dynamics: tuple
    backward: tuple  # N_z, N_u, N_x, N_joint
    prediction: float
    consistency: float
    draw: object
    angles: int


def circle(pictures, row, column):
    """The agent of the planar system, two pixels wide."""
    rows = torch.arange(40.0)[:, None]
    columns = torch.arange(40.0)
    near = ((rows - row[:, None, None]).abs() <= 1) & ((columns - column[:, None, None]).abs() <= 1)
    return (pictures.bool() | near).float()


def planar(state):
    background = torch.zeros(40, 40)
    for row, column in [(20, 5), (20, 13), (20, 27), (20, 35), (10, 20), (30, 20)]:
        background[row - 2 : row + 3, column - 2 : column + 3] = 1
    return circle(background.expand(len(state), 40, 40), 20 + 18 * state[:, 0], 20 + 18 * state[:, 1])


def segments(side, points, width):
    """Pictures of the lines between successive points (x, y)."""
    pixel = torch.stack(torch.meshgrid(torch.arange(float(side)), torch.arange(float(side)), indexing="xy"), -1)
    lit = torch.zeros(len(points[0]), side, side, dtype=torch.bool)
    for start, end in zip(points, points[1:]):
        way, off = (end - start)[:, None, None], pixel - start[:, None, None]
        along = ((off * way).sum(-1) / (way * way).sum(-1)).clamp(0, 1)
        lit |= (off - along[..., None] * way).square().sum(-1) <= width * width / 4
    return lit.float()


def end_of(start, angle, length):
    return start + length * torch.stack([angle.sin(), -angle.cos()], -1)


def pendulum(state):
    centre = torch.full((len(state), 2), 24.0)
    return segments(48, [centre, end_of(centre, math.pi * state[:, 0], 22)], 4)


def cart_pole(state):
    x = 40 + 30 * state[:, 1]
    cart = torch.stack([x, torch.full_like(x, 70.0)], -1)
    half = torch.tensor([8.0, 0.0])
    pole = segments(80, [cart, end_of(cart, 0.3 * state[:, 0], 52)], 6)
    return torch.maximum(pole, segments(80, [cart - half, cart + half], 9))


def three_pole(state):
    points = [torch.full((len(state), 2), 40.0)]
    for angle in (math.pi * state).cumsum(1).unbind(1):
        points.append(end_of(points[-1], angle, 11.3))
    return segments(80, points, 5)


TASKS = {
    "planar": Task(2, 2, 1600, False, (300, 300), (20, 20), (5, 5, 100, 100), 1, 7, planar, 2),
    "swing_up": Task(3, 1, 4608, False, (500, 500), (30, 30), (10, 10, 200, 200), 1, 11, pendulum, 1),
    "cart_pole": Task(8, 1, 12800, True, 200, (40, 40), (10, 10, 300, 300), 1, 7, cart_pole, 2),
    "three_pole": Task(8, 3, 12800, True, 500, (40, 40), (10, 10, 400, 400), 1, 11, three_pole, 3),
}


def batches(task, samples, batch):
    """(x, u, x') of whole batches: floats 0 and 1, one row a picture, or two stacked 80x80 pictures."""
    generator = torch.Generator().manual_seed(1)

    def uniform(width):
        return 2 * torch.rand(samples, width, generator=generator) - 1

    state, speed, actions = uniform(task.angles), 0.05 * uniform(task.angles), uniform(task.action)
    frames = []
    if task.pixels == 1600:
        frames = [task.draw(state.clamp(-1, 1)), task.draw((state + 0.15 * actions).clamp(-1, 1))]
    else:
        for _ in range(3):
            frames.append(task.draw(state))
            state, speed = state + speed, speed + 0.03 * actions.mean(1, keepdim=True)
        frames = [torch.stack(pair, 1) for pair in zip(frames, frames[1:])]
    now, after = (frame if task.convolutional else frame.flatten(1) for frame in frames)
    return list(zip(now.split(batch), actions.split(batch), after.split(batch)))
