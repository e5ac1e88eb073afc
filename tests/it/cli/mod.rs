//! The program as a user meets it.

mod chaos;
mod plot;
mod suite;
mod verbs;
mod view;
