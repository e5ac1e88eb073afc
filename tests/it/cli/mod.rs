//! The program as a user meets it.

mod chaos;
mod doctor;
mod environment;
mod folders;
mod full_disk;
mod plot;
mod runs;
mod suite;
mod verbs;
mod verify;
mod view;
