//! Shares the cores among the jobs that run. A job that runs alone gets all of them.

use std::{
    collections::BTreeMap,
    sync::{Mutex, MutexGuard, PoisonError},
};

use crate::num::Threads;

/// The cores, and the jobs that use them.
#[derive(Debug)]
pub(super) struct Cores {
    total: usize,
    users: Mutex<Users>,
}

#[derive(Debug, Default)]
struct Users {
    next: u64,
    by_number: BTreeMap<u64, User>,
}

#[derive(Debug)]
struct User {
    threads: Threads,
    at_most: usize,
}

/// The share of one job. Dropping it gives its cores to the other jobs.
#[derive(Debug)]
pub(super) struct Share<'a> {
    cores: &'a Cores,
    number: u64,
    threads: Threads,
}

impl Cores {
    pub(super) fn new(total: usize) -> Self {
        Self { total: total.max(1), users: Mutex::default() }
    }

    /// A share for a job that starts; the other jobs get less.
    pub(super) fn join(&self, at_most: usize) -> Share<'_> {
        let threads = Threads::new(1);
        let mut users = self.lock();
        let number = users.next;
        users.next += 1;
        users.by_number.insert(number, User { threads: threads.clone(), at_most: at_most.max(1) });
        self.divide(&users);
        Share { cores: self, number, threads }
    }

    fn lock(&self) -> MutexGuard<'_, Users> {
        self.users.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn divide(&self, users: &Users) {
        let share = self.total / users.by_number.len().max(1);
        users.by_number.values().for_each(|user| user.threads.set(share.min(user.at_most)));
    }
}

impl Share<'_> {
    /// The number of threads of this share. It changes as other jobs start and end.
    pub(super) fn threads(&self) -> Threads {
        self.threads.clone()
    }
}

impl Drop for Share<'_> {
    fn drop(&mut self) {
        let mut users = self.cores.lock();
        users.by_number.remove(&self.number);
        self.cores.divide(&users);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lone_job_gets_every_core_and_shares_them_when_others_start() {
        let cores = Cores::new(4);
        let first = cores.join(8);
        assert_eq!(first.threads().get(), 4);
        let second = cores.join(8);
        assert_eq!((first.threads().get(), second.threads().get()), (2, 2));
        drop(first);
        assert_eq!(second.threads().get(), 4);
        let others: Vec<_> = (0..7).map(|_| cores.join(8)).collect();
        assert_eq!((second.threads().get(), others.len()), (1, 7));
    }

    #[test]
    fn a_job_gets_no_more_threads_than_it_may_use() {
        assert_eq!(Cores::new(4).join(3).threads().get(), 3);
    }
}
