//! One of two things: for fully connected or for convolutional encoders and decoders.

use crate::nn::columns::Cut;

/// What belongs to fully connected networks (`D`) or to convolutional ones (`C`).
///
/// An encoder's buffers hold the encoder's layers themselves, so that no buffer meets a network of the other kind.
#[derive(Debug, Clone, PartialEq, Eq)]
#[allow(clippy::large_enum_variant, reason = "a model and a training step hold one each")]
pub enum ByKind<D, C> {
    /// For fully connected networks.
    Dense(D),
    /// For convolutional networks.
    Convolutional(C),
}

impl<D: Cut, C: Cut> Cut for ByKind<D, C> {
    fn cut(self, samples: usize) -> (Self, Self) {
        match self {
            Self::Dense(buffers) => {
                let (left, right) = buffers.cut(samples);
                (Self::Dense(left), Self::Dense(right))
            }
            Self::Convolutional(buffers) => {
                let (left, right) = buffers.cut(samples);
                (Self::Convolutional(left), Self::Convolutional(right))
            }
        }
    }
}

/// The same expression for either kind.
macro_rules! either_kind {
    ($of:expr, $it:pat => $body:expr) => {
        match $of {
            $crate::lce::by_kind::ByKind::Dense($it) => $body,
            $crate::lce::by_kind::ByKind::Convolutional($it) => $body,
        }
    };
}
pub(super) use either_kind;
