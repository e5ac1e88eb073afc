//! A disk that fills up at any moment of a run: the run says so, publishes nothing half, and works once there is room.

use std::{
    fs::{self, File},
    io::Write as _,
    path::Path,
};

use crate::support::{
    cli::{Toy, digests},
    small_disk::SmallDisk,
};

/// Takes all room of a disk but so many pages of 4 KiB.
fn fill(path: &Path, pages: u64) {
    let mut file = File::create(path).unwrap();
    while file.write_all(&[7; 4096]).is_ok() {}
    let length = file.metadata().unwrap().len();
    file.set_len((length / 4096 - pages) * 4096).unwrap();
}

#[test]
fn a_disk_that_fills_up_at_any_moment_costs_nothing_but_time() {
    const RUN: &str =
        "run toy.toml --json -j1 -S rounds=1 -S data.steps=1 -S learn.steps=1 -S evaluate.steps=1 --note x";
    let toy = Toy::new();
    let whole = digests(&toy.run(RUN).json());
    let Some(disk) = SmallDisk::mount(&toy.path("small"), 400) else {
        eprintln!("skipped: may not mount a small file system");
        return;
    };
    let on = |words: &str| toy.run(&format!("--artifacts small/store {words}"));
    let mut was_full = 0;
    for pages in 0.. {
        fill(&disk.path.join("ballast"), pages);
        let first = on(RUN);
        fs::remove_file(disk.path.join("ballast")).unwrap();
        assert!(!first.err.contains("mistake in carl-pipe"), "{first:?}");
        let is_told = first.err.lines().any(|line| line.contains("No space left on device") && line.contains("small/"));
        assert!(first.code == Some(0) || (first.code == Some(4) && is_told), "{pages} pages: {first:?}");
        let again = on(RUN);
        assert_eq!(again.code, Some(0), "{pages} pages: {again:?}");
        assert_eq!(on("verify --repair").code, Some(0));
        assert_eq!(digests(&on(RUN).json()), whole, "{pages} pages");
        fs::remove_dir_all(disk.path.join("store")).unwrap();
        if !is_told {
            break;
        }
        was_full += 1;
    }
    assert!(was_full > 10, "the disk was full {was_full} times");
}
