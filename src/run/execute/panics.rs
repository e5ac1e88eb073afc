//! Turns the panic of a stage into the error of its node, with the place of the panic, instead of printing it.

use std::{
    any::Any,
    collections::BTreeMap,
    panic,
    sync::{Mutex, Once, PoisonError},
    thread,
};

/// The names of all threads that run stages begin so.
const PREFIX: &str = "nodes, team ";

/// Where panics happened, by the name of the thread.
static PLACES: Mutex<BTreeMap<String, String>> = Mutex::new(BTreeMap::new());

/// The name of every thread of a team.
pub(super) fn team_name(number: usize) -> String {
    format!("{PREFIX}{number}")
}

/// Keeps panics in threads that run stages for [`explain`]. All other panics are printed as usual.
pub(super) fn keep_quiet() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let print = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            let thread = thread::current();
            match thread.name() {
                Some(name) if name.starts_with(PREFIX) => {
                    let place = info.location().map_or_else(String::new, ToString::to_string);
                    PLACES.lock().unwrap_or_else(PoisonError::into_inner).insert(name.to_owned(), place);
                }
                _ => print(info),
            }
        }));
    });
}

/// The error of a stage that panicked on threads of this name.
pub(super) fn explain(threads: &str, payload: &(dyn Any + Send)) -> anyhow::Error {
    let message = payload
        .downcast_ref::<&str>()
        .map(|text| (*text).to_owned())
        .or_else(|| payload.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "it gave no message".to_owned());
    match PLACES.lock().unwrap_or_else(PoisonError::into_inner).remove(threads) {
        Some(place) => anyhow::anyhow!("panicked at {place}: {message}"),
        None => anyhow::anyhow!("panicked: {message}"),
    }
}
