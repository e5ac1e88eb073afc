"""A SAC update in PyTorch as `control::sac` does it: fresh tuples, a latent rollout of k steps for the critics' targets,
twin critics, the actor, the temperature, and the slow averages.
"""

import math

import torch
from torch.nn import functional as F

from torch_data import TASKS
from torch_parts import adam, maker

BATCH = 128
LATENT, ACTION = 2, 2
HIDDEN = 256
ROLLOUT = 5
DISCOUNT = 0.99
RATE = 0.005
RELABEL = 0.5
BUFFER = 1_000_000
HALF_LN_TAU = 0.5 * math.log(2 * math.pi)


def affine(fan_in, fan_out):
    """Weight and bias of a layer, drawn as `nn.Linear` draws them."""
    bound = fan_in**-0.5
    return [
        torch.empty(fan_out, fan_in).uniform_(-bound, bound).requires_grad_(),
        torch.empty(fan_out).uniform_(-bound, bound).requires_grad_(),
    ]


def mlp(*widths):
    return [tensor for layer in zip(widths, widths[1:]) for tensor in affine(*layer)]


def run(parameters, x):
    """An MLP with two hidden layers."""
    w_1, b_1, w_2, b_2, w_3, b_3 = parameters
    return F.linear(F.relu(F.linear(F.relu(F.linear(x, w_1, b_1)), w_2, b_2)), w_3, b_3)


def squash(gaussian, epsilon):
    """a = tanh(mu + sigma epsilon) and ln pi(a)."""
    mu, log_sigma = gaussian.chunk(2, 1)
    log_sigma = log_sigma.clamp(-5, 2)
    pre = mu + log_sigma.exp() * epsilon
    log_slope = 2 * (math.log(2) - pre - F.softplus(-2 * pre))
    return torch.tanh(pre), -(0.5 * epsilon.square() + log_sigma + HALF_LN_TAU + log_slope).sum(1)


def distance(z, goal):
    return -torch.linalg.vector_norm(z - goal, dim=1)


def detached(parameters):
    return [parameter.detach() for parameter in parameters]


class Agent:
    """Networks, their slow averages and the codes that they are trained on."""

    def __init__(self):
        task = TASKS["planar"]
        self.actor = mlp(2 * LATENT, HIDDEN, HIDDEN, 2 * ACTION)
        self.critics = [mlp(2 * LATENT + ACTION, HIDDEN, HIDDEN, 1) for _ in range(2)]
        self.targets = [[p.detach().clone() for p in critic] for critic in self.critics]
        self.acting = [p.detach().clone() for p in self.actor]
        self.log_alpha = torch.zeros((), requires_grad=True)
        self.dynamics = detached(mlp(LATENT + ACTION, *task.dynamics, 2 * LATENT))
        self.dynamics[5][LATENT:] -= 3  # a model that has been trained is surer than a new one
        self.means = torch.rand(2048, LATENT) * 4 - 2
        self.log_sigmas = torch.full((2048, LATENT), -3.0)
        self.goals = torch.rand(3, LATENT) * 4 - 2
        low, high = self.means.amin(0), self.means.amax(0)
        self.low, self.high = low - 0.2 * (high - low), high + 0.2 * (high - low)
        self.shift, self.scale = self.means.mean(0), 1 / self.means.std(0)

    def whiten(self, z):
        return (z - self.shift) * self.scale

    def predict(self, z, action, epsilon):
        """A sample of F within the data's box."""
        way, log_sigma = run(self.dynamics, torch.cat([z, action], 1)).chunk(2, 1)
        return torch.clamp(z + way + log_sigma.exp() * epsilon, self.low, self.high)


def fresh_tuples(agent, random, normal, which, goal):
    """(z, a, z', z_g) with uniform actions; half of the goals are codes of the data."""
    for_z, for_next = normal.split(LATENT, 1)
    z = agent.means[which[0]] + agent.log_sigmas[which[0]].exp() * for_z
    action = 2 * random[:, :ACTION] - 1
    goals = torch.where(random[:, ACTION:] < RELABEL, agent.means[which[1]], agent.goals[goal])
    return torch.cat([z, action, agent.predict(z, action, for_next), goals], 1)


def critic_targets(agent, tuples, noise, bootstrap):
    """r(z') + sum of gamma^(i+1) (r - alpha ln pi), and the smaller target critic at the end."""
    z, goal = tuples[:, LATENT + ACTION : 2 * LATENT + ACTION], tuples[:, 2 * LATENT + ACTION :]
    white_goal, alpha = agent.whiten(goal), agent.log_alpha.exp()
    target, discount = distance(z, goal), 1.0
    for step in range(ROLLOUT + bootstrap):
        discount *= DISCOUNT
        state = torch.cat([agent.whiten(z), white_goal], 1)
        for_action, for_z = noise[step].split([ACTION, LATENT], 1)
        action, log_pi = squash(run(agent.actor, state), for_action)
        target = target - discount * alpha * log_pi
        if step == ROLLOUT:
            state_action = torch.cat([state, action], 1)
            values = [run(critic, state_action) for critic in agent.targets]
            return target + discount * torch.minimum(*values)[:, 0]
        z = agent.predict(z, action, for_z)
        target = target + discount * distance(z, goal)
    return target


def critic_loss(critics, inputs, targets):
    return sum(0.5 * (run(critic, inputs)[:, 0] - targets).square().mean() for critic in critics)


def actor_loss(actor, critics, alpha, state, noise):
    """Loss and entropy."""
    action, log_pi = squash(run(actor, state), noise)
    inputs = torch.cat([state, action], 1)
    value = torch.minimum(*(run(critic, inputs) for critic in critics))[:, 0]
    return (alpha * log_pi - value).mean(), -log_pi.detach().mean()


class SacStep:
    """One update of critics, actor, temperature and averages."""

    def __init__(self, _work, variant, arguments):
        self.agent, self.bootstrap = Agent(), arguments.bootstrap
        flat = [p for critic in self.agent.critics for p in critic]
        self.of_critics = adam([{"params": flat, "lr": 1e-3}])
        self.of_actor = adam(
            [{"params": self.agent.actor, "lr": 5e-4}, {"params": [self.agent.log_alpha], "lr": 1e-3}]
        )
        self.flat_critics = flat
        self.flat_targets = [p for target in self.agent.targets for p in target]
        self.buffer = torch.zeros(BUFFER, 3 * LATENT + ACTION)
        self.filled = 0
        make = maker(variant)
        self.fresh_tuples, self.critic_targets = make(fresh_tuples), make(critic_targets)
        self.critic_loss, self.actor_loss = make(critic_loss), make(actor_loss)

    @torch.no_grad()
    def draw(self):
        """Fresh tuples into the buffer, a batch out of it, and its targets."""
        agent = self.agent
        random, normal = torch.rand(BATCH, ACTION + 1), torch.randn(BATCH, 2 * LATENT)
        which, goal = torch.randint(len(agent.means), (2, BATCH)), torch.randint(len(agent.goals), (BATCH,))
        at = self.filled % (BUFFER - BATCH)
        self.buffer[at : at + BATCH] = self.fresh_tuples(agent, random, normal, which, goal)
        self.filled += BATCH
        tuples = self.buffer[torch.randint(min(self.filled, BUFFER), (BATCH,))]
        noise = torch.randn(ROLLOUT + 1, BATCH, ACTION + LATENT)
        return tuples, self.critic_targets(agent, tuples, noise, self.bootstrap)

    def step(self):
        agent = self.agent
        tuples, targets = self.draw()
        z, action, goal = tuples[:, :LATENT], tuples[:, LATENT : LATENT + ACTION], tuples[:, 2 * LATENT + ACTION :]
        state = torch.cat([agent.whiten(z), agent.whiten(goal)], 1)
        loss = self.critic_loss(agent.critics, torch.cat([state, action], 1), targets)
        self.of_critics.zero_grad(set_to_none=True)
        loss.backward()
        self.of_critics.step()

        alpha = agent.log_alpha.detach().exp()
        critics = [detached(critic) for critic in agent.critics]
        of_actor, entropy = self.actor_loss(agent.actor, critics, alpha, state, torch.randn(BATCH, ACTION))
        self.of_actor.zero_grad(set_to_none=True)
        of_actor.backward()
        agent.log_alpha.grad = entropy + ACTION
        self.of_actor.step()

        with torch.no_grad():
            if self.bootstrap:
                torch._foreach_lerp_(self.flat_targets, self.flat_critics, RATE)
            torch._foreach_lerp_(agent.acting, agent.actor, RATE)
        return loss.detach()
