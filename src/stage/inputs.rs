//! The ports of a kind: which artifacts it takes, how many of each, and how it reads them.

use anyhow::{Context as _, anyhow, bail};

use super::registry;
use crate::artifact::{Artifact, Files, must_be_finite};

/// How many artifacts a port takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arity {
    /// Exactly one.
    One,
    /// One or none, as in the first round of a loop.
    Optional,
    /// One or more, in the order written.
    Many,
}

/// An input that a kind declares.
#[derive(Debug, Clone, Copy)]
pub struct Port {
    /// The name that pipeline files write under `inputs`.
    pub name: &'static str,
    /// The type of artifact it takes.
    pub artifact: &'static str,
    /// How many artifacts it takes.
    pub arity: Arity,
    /// What the stage uses it for.
    pub about: &'static str,
}

/// The verified files of a stage's inputs, by port.
#[derive(Debug, Default)]
pub struct InputFiles<'a> {
    /// The artifacts of each port, by the port's name and in the order written.
    pub by_port: std::collections::BTreeMap<&'static str, Vec<&'a Files>>,
}

impl InputFiles<'_> {
    /// The bytes of all files. An artifact takes about as many bytes in memory.
    ///
    /// # Errors
    /// The size of a file cannot be read.
    pub(super) fn bytes(&self) -> anyhow::Result<u64> {
        let all = self.by_port.values().flatten().flat_map(|files| files.iter());
        all.map(|(_, content)| Ok(content.size()?)).sum()
    }
}

/// A field of an `inputs!` struct: `T`, `Option<T>` or `Vec<T>` for an artifact `T`.
pub trait PortField: Sized {
    /// How many artifacts it takes.
    const ARITY: Arity;
    /// The type of artifact that it takes.
    const ARTIFACT: &'static str;
    /// Reads them.
    fn load(files: &[&Files]) -> anyhow::Result<Self>;
}

impl<T: Artifact> PortField for T {
    const ARITY: Arity = Arity::One;
    const ARTIFACT: &'static str = T::TYPE;
    fn load(files: &[&Files]) -> anyhow::Result<Self> {
        let [files] = files else { bail!("takes one {}, but got {}", T::TYPE, files.len()) };
        read(files)
    }
}

impl<T: Artifact> PortField for Option<T> {
    const ARITY: Arity = Arity::Optional;
    const ARTIFACT: &'static str = T::TYPE;
    fn load(files: &[&Files]) -> anyhow::Result<Self> {
        match files {
            [] => Ok(None),
            [files] => read(files).map(Some),
            more => bail!("takes at most one {}, but got {}", T::TYPE, more.len()),
        }
    }
}

impl<T: Artifact> PortField for Vec<T> {
    const ARITY: Arity = Arity::Many;
    const ARTIFACT: &'static str = T::TYPE;
    fn load(files: &[&Files]) -> anyhow::Result<Self> {
        files.iter().map(|files| read(files)).collect()
    }
}

/// Reads an artifact, whose numbers must be finite. Those of an older store may not be.
fn read<T: Artifact>(files: &Files) -> anyhow::Result<T> {
    let value = T::load(files)?;
    must_be_finite(files, T::MAY_BE_MISSING).map_err(|error| {
        let makers = registry().iter().filter(|kind| kind.gives(T::TYPE)).map(|kind| format!("`{}`", kind.name));
        let makers = makers.collect::<Vec<_>>().join(" or ");
        let maker = if makers.is_empty() { String::new() } else { format!(", made by {makers}") };
        anyhow!("{error:#}{maker}: `carl-pipe run FILE --force=STAGE` makes it again")
    })?;
    Ok(value)
}

/// The typed inputs of a kind; written with the `inputs!` macro.
pub trait Inputs: Sized {
    /// The ports, in the order of the fields.
    const PORTS: &'static [Port];
    /// Reads every port.
    fn load(files: &InputFiles<'_>) -> anyhow::Result<Self>;
}

/// Reads one port. Its errors name the port.
pub fn load_port<T: PortField>(files: &InputFiles<'_>, port: &'static str) -> anyhow::Result<T> {
    let files = files.by_port.get(port).map_or(&[][..], Vec::as_slice);
    T::load(files).with_context(|| format!("cannot read input `{port}`"))
}

/// Declares the typed inputs of a stage. The documentation of each field is the help text of its port.
#[macro_export]
macro_rules! inputs {
    (
        $(#[$outer:meta])*
        $vis:vis struct $name:ident { $( #[doc = $about:literal] $field:ident : $ty:ty ),* $(,)? }
    ) => {
        $(#[$outer])*
        $vis struct $name { $( #[doc = $about] $field: $ty ),* }

        impl $crate::stage::Inputs for $name {
            const PORTS: &'static [$crate::stage::Port] = &[ $( $crate::stage::Port {
                name: stringify!($field),
                artifact: <$ty as $crate::stage::PortField>::ARTIFACT,
                arity: <$ty as $crate::stage::PortField>::ARITY,
                about: $about,
            } ),* ];

            fn load(_files: &$crate::stage::InputFiles<'_>) -> anyhow::Result<Self> {
                Ok(Self { $( $field: $crate::stage::load_port(_files, stringify!($field))? ),* })
            }
        }
    };
}
pub(crate) use inputs;
