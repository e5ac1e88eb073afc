//! An agent with its optimisers, as an artifact.

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use super::{
    Artifact, Files, json,
    lce_model::{put_layers, take_layers},
    sizes::check_widths,
    tensors::{TensorFile, Tensors, read_json},
};
use crate::{
    control::{
        Agent,
        agent::{AgentNets, Trained, Whitening},
    },
    nn::{adam::Adam, mlp::Layout},
};

#[derive(Serialize, Deserialize)]
struct About {
    latent: usize,
    action: usize,
    actor_adam_steps: u64,
    critic_adam_steps: [u64; 2],
    temperature_adam_steps: u64,
}

fn put(agent: &mut Tensors, optimizer: &mut Tensors, name: &str, layout: &Layout, trained: &Trained) {
    put_layers(agent, &format!("{name}/"), layout, &trained.arena);
    put_layers(optimizer, &format!("{name}/m."), layout, &trained.adam.m);
    put_layers(optimizer, &format!("{name}/v."), layout, &trained.adam.v);
}

fn take(
    agent: &TensorFile<'_>,
    optimizer: &TensorFile<'_>,
    name: &str,
    layout: &Layout,
    steps: u64,
) -> anyhow::Result<Trained> {
    let m = take_layers(optimizer, &format!("{name}/m."), layout)?;
    let v = take_layers(optimizer, &format!("{name}/v."), layout)?;
    Ok(Trained { arena: take_layers(agent, &format!("{name}/"), layout)?, adam: Adam { m, v, steps } })
}

/// What the file holds for an agent without whitening: mean 0 and standard deviation 1.
fn no_whitening(latent: usize) -> Whitening {
    Whitening { mean: vec![0.0; latent], inverse: vec![1.0; latent] }
}

impl Artifact for Agent {
    const TYPE: &'static str = "agent";

    fn save(self) -> anyhow::Result<Files> {
        let (actor, critic) = (&self.nets.actor.layout, &self.nets.critic.layout);
        let (mut agent, mut optimizer) = (Tensors::default(), Tensors::default());
        put(&mut agent, &mut optimizer, "actor", actor, &self.actor);
        put_layers(&mut agent, "acting/", actor, &self.acting);
        for (i, critic_i) in self.critics.iter().enumerate() {
            put(&mut agent, &mut optimizer, &format!("critic_{i}"), critic, critic_i);
            put_layers(&mut agent, &format!("target_{i}/"), critic, &self.targets[i]);
        }
        agent.f32("log_alpha", &[1], &self.log_alpha.arena);
        optimizer.f32("log_alpha/m", &[1], &self.log_alpha.adam.m).f32("log_alpha/v", &[1], &self.log_alpha.adam.v);
        let Whitening { mean, inverse } = self.whitening.clone().unwrap_or_else(|| no_whitening(self.latent));
        agent.f32("whitening/mean", &[self.latent], &mean);
        agent.f32("whitening/inverse", &[self.latent], &inverse);
        let about = About {
            latent: self.latent,
            action: self.action,
            actor_adam_steps: self.actor.adam.steps,
            critic_adam_steps: [0, 1].map(|i: usize| self.critics[i].adam.steps),
            temperature_adam_steps: self.log_alpha.adam.steps,
        };
        Ok(Files::from([
            ("agent.safetensors", agent.content()?),
            ("optimizer.safetensors", optimizer.content()?),
            ("agent.json", json(&about)?.into()),
        ]))
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        let about: About = read_json(files, "agent.json")?;
        check_widths([&about.latent, &about.action])?;
        let nets = AgentNets::new(about.latent, about.action);
        let agent = TensorFile::open(files, "agent.safetensors")?;
        let optimizer = TensorFile::open(files, "optimizer.safetensors")?;
        let actor = take(&agent, &optimizer, "actor", &nets.actor.layout, about.actor_adam_steps)?;
        let acting = take_layers(&agent, "acting/", &nets.actor.layout)?;
        let critic = |i: usize| {
            take(&agent, &optimizer, &format!("critic_{i}"), &nets.critic.layout, about.critic_adam_steps[i])
        };
        let target = |i: usize| take_layers(&agent, &format!("target_{i}/"), &nets.critic.layout);
        let (critics, targets) = ([critic(0)?, critic(1)?], [target(0)?, target(1)?]);
        let adam = Adam {
            m: optimizer.f32("log_alpha/m")?,
            v: optimizer.f32("log_alpha/v")?,
            steps: about.temperature_adam_steps,
        };
        let log_alpha = Trained { arena: agent.f32("log_alpha")?, adam };
        let whitening = Whitening { mean: agent.f32("whitening/mean")?, inverse: agent.f32("whitening/inverse")? };
        let Adam { m, v, .. } = &log_alpha.adam;
        for (tensor, length) in
            [(&whitening.mean, about.latent), (&whitening.inverse, about.latent), (&log_alpha.arena, 1), (m, 1), (v, 1)]
        {
            ensure!(tensor.len() == length, "whitening or temperature of {} values, not {length}", tensor.len());
        }
        Ok(Self {
            latent: about.latent,
            action: about.action,
            nets,
            actor,
            acting,
            critics,
            targets,
            log_alpha,
            whitening: Some(whitening).filter(|whitening| *whitening != no_whitening(about.latent)),
        })
    }
}
