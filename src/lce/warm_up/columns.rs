//! The warm-up's buffers for some samples.

use super::settings::WarmUpTerms;
use crate::{lce::passes::PassColumns, nn::columns::cut_together};

cut_together! {
    /// Networks and terms.
    pub(super) struct Columns<'a, T> {
        pub(super) nets: PassColumns<'a, T>,
        pub(super) terms: &'a mut [WarmUpTerms<T>],
    }
}
