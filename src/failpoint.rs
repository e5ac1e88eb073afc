//! Named operations of the system. A test can let such an operation fail, or kill the process before it. A release
//! build contains none of this.
//!
//! `CARL_FAILPOINT="sync file@3=28"` lets the third `sync file` and all later ones fail with error 28 of the system,
//! which says that no space is left. `CARL_FAILPOINT="sync file@3=kill"` kills the process before the third one.
//! `CARL_FAILPOINT_TRACE=FILE` appends the name of each point that the process reaches to a file, one name a line.

/// The operation, or the error that a test wants here: `failpoint!("sync file", file.sync_all())`.
#[cfg(debug_assertions)]
macro_rules! failpoint {
    ($name:literal, $operation:expr) => {
        match $crate::failpoint::reach($name) {
            Ok(()) => $operation,
            Err(error) => Err(error.into()),
        }
    };
}

#[cfg(not(debug_assertions))]
macro_rules! failpoint {
    ($name:literal, $operation:expr) => {
        $operation
    };
}

pub(crate) use failpoint;

#[cfg(debug_assertions)]
pub use armed::POINTS;
#[cfg(debug_assertions)]
pub(crate) use armed::reach;

#[cfg(debug_assertions)]
mod armed {
    use std::{
        collections::BTreeMap,
        env,
        fs::OpenOptions,
        io::{self, Write as _},
        process,
        sync::{LazyLock, Mutex, PoisonError},
    };

    /// The names of all points, in the order of the alphabet.
    pub const POINTS: &[&str] = &[
        "finish recording",
        "link result",
        "lock key",
        "lock store",
        "look at object",
        "make folder",
        "make run folder",
        "make temporary",
        "mark alive",
        "mark latest",
        "move aside",
        "name run folder",
        "open events",
        "open recording",
        "place file",
        "read entry",
        "read manifest",
        "read marker",
        "read object",
        "remove entry or object",
        "remove key lock",
        "remove live recording",
        "remove run",
        "remove stray",
        "rename latest",
        "rename run",
        "replace file",
        "start finished recording",
        "sync file",
        "sync folder",
        "take number",
        "take over",
        "write events",
        "write recording",
        "write temporary",
    ];

    /// What happens when a point is reached for the `nth` time, and each time after that.
    struct Fault {
        point: String,
        nth: usize,
        /// The number of the system's error; `None` kills the process.
        error: Option<i32>,
    }

    impl Fault {
        fn of(text: &str) -> Option<Self> {
            let (place, what) = text.split_once('=')?;
            let (point, nth) = place.split_once('@')?;
            let error = if what == "kill" { None } else { Some(what.parse().ok()?) };
            Some(Self { point: point.to_owned(), nth: nth.parse().ok()?, error })
        }
    }

    static FAULT: LazyLock<Option<Fault>> = LazyLock::new(|| {
        let text = env::var("CARL_FAILPOINT").ok()?;
        Some(Fault::of(&text).unwrap_or_else(|| panic!("CARL_FAILPOINT is `POINT@NTH=ERROR`, not `{text}`")))
    });

    /// How often each point was reached.
    static REACHED: Mutex<BTreeMap<&str, usize>> = Mutex::new(BTreeMap::new());

    /// Called at a point; returns the error that a test wants there.
    pub(crate) fn reach(name: &'static str) -> io::Result<()> {
        debug_assert!(POINTS.contains(&name), "`{name}` is not in the list of points");
        trace(name);
        let Some(fault) = FAULT.as_ref().filter(|fault| fault.point == name) else { return Ok(()) };
        let mut reached = REACHED.lock().unwrap_or_else(PoisonError::into_inner);
        let times = reached.entry(name).or_default();
        *times += 1;
        match fault.error {
            _ if *times < fault.nth => Ok(()),
            // Nothing is cleaned up, as after SIGKILL.
            None => process::abort(),
            Some(error) => Err(io::Error::from_raw_os_error(error)),
        }
    }

    fn trace(name: &str) {
        static FILE: LazyLock<Option<std::ffi::OsString>> = LazyLock::new(|| env::var_os("CARL_FAILPOINT_TRACE"));
        if let Some(file) = FILE.as_ref() {
            // One write for each line: lines of several threads do not mix.
            let opened = OpenOptions::new().create(true).append(true).open(file);
            opened.and_then(|mut file| file.write_all(format!("{name}\n").as_bytes())).expect("a trace can be written");
        }
    }
}
