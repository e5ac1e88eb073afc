//! The memory that the parameters of a stage ask for, and how much there may be.

use std::fs;

use anyhow::ensure;

use super::Refusal;

/// The most bytes that the parameters of a stage may ask for: 64 GiB, on every machine.
pub const MOST_MEMORY: u64 = 64 << 30;

/// An estimate of the memory that parameters ask for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Memory {
    /// The parameter to lower.
    pub path: &'static str,
    /// Bytes.
    pub bytes: u64,
}

impl Memory {
    /// Refuses more than [`MOST_MEMORY`].
    pub(super) fn refusal(self) -> Option<Refusal> {
        let why = || format!("needs about {}; the most is {}", gib(self.bytes), gib(MOST_MEMORY));
        (self.bytes > MOST_MEMORY).then(|| Refusal::new(self.path, why()))
    }
}

/// Refuses parameters and inputs that together need more than a machine has. Without this, the system would end the
/// process once the memory is full.
pub(super) fn must_fit(asked: Option<Memory>, inputs: u64, machine: Option<u64>) -> anyhow::Result<()> {
    let machine = machine.unwrap_or(u64::MAX);
    ensure!(
        inputs <= machine,
        "the inputs need about {} of memory; this machine has {}: make smaller inputs",
        gib(inputs),
        gib(machine)
    );
    let Some(Memory { path, bytes }) = asked else { return Ok(()) };
    ensure!(
        inputs.saturating_add(bytes) <= machine,
        "`{path}` needs about {} of memory beside {} of inputs; this machine has {}: lower the parameter",
        gib(bytes),
        gib(inputs),
        gib(machine)
    );
    Ok(())
}

/// The memory of this machine in bytes; `None` where the system does not tell.
pub(super) fn of_this_machine() -> Option<u64> {
    of_system("MemTotal")
}

/// The memory of this machine that is free, in bytes; `None` where the system does not tell.
pub(crate) fn free() -> Option<u64> {
    of_system("MemAvailable")
}

fn of_system(name: &str) -> Option<u64> {
    let told = fs::read_to_string("/proc/meminfo").ok()?;
    let line = told.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))?;
    line.trim().strip_suffix(" kB")?.parse::<u64>().ok()?.checked_mul(1024)
}

fn gib(bytes: u64) -> String {
    format!("{:.1} GiB", bytes as f64 / (1_u64 << 30) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_than_the_bound_or_the_machine_is_refused_in_words() {
        let memory = |bytes| Memory { path: "samples", bytes };
        assert_eq!(memory(MOST_MEMORY).refusal(), None);
        assert_eq!(memory(96 << 30).refusal().unwrap().why, "needs about 96.0 GiB; the most is 64.0 GiB");
        let refusal = |asked, inputs, machine| must_fit(asked, inputs, machine).err().map(|error| error.to_string());
        let asked = Some(memory(3 << 30));
        assert_eq!(refusal(asked, 9 << 30, None), None);
        assert_eq!(refusal(asked, 1 << 30, Some(4 << 30)), None);
        assert_eq!(
            refusal(asked, 1 << 30, Some(7 << 29)).unwrap(),
            "`samples` needs about 3.0 GiB of memory beside 1.0 GiB of inputs; this machine has 3.5 GiB: lower the parameter"
        );
        assert_eq!(
            refusal(None, 3 << 30, Some(2 << 30)).unwrap(),
            "the inputs need about 3.0 GiB of memory; this machine has 2.0 GiB: make smaller inputs"
        );
        assert!(of_this_machine().is_some_and(|bytes| bytes > 1 << 28));
    }
}
