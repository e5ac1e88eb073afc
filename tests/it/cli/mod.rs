//! The program as a user meets it.

mod chaos;
mod command;
mod doctor;
mod environment;
#[cfg(debug_assertions)] // Release builds have no failpoints.
mod faults;
mod folders;
mod full_disk;
mod import_data;
mod plot;
mod process;
mod runs;
mod suite;
mod verbs;
mod verify;
mod view;
